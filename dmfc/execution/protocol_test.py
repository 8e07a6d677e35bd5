"""How a grasp is executed and judged: ours, or somebody else's class (setting `execution.test`).

    class Mine:
        def __init__(self, setup: Setup) -> None: ...

        def run(self, T_world_palm, joints, target, observer=None) -> Outcome: ...

One is made per scene. `run` executes a grasp, [4, 4] and [D] rad, on object `target` of the scene,
each time from the same state, and says what became of it: `planned` (it fits), `held`, and where it
is not held the `reason`, one of `dmfc.execution.outcome.REASONS`. `observer(phase, world)`, where
there is one, is called every now and then, for pictures. `world` is the simulation.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np

from dmfc.config.custom_function import custom_class, is_custom
from dmfc.config.execution import ExecutionConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.errors import DmfcError, unknown_name
from dmfc.execution.outcome import REASONS, Outcome
from dmfc.execution.trial import Observer, TrialRunner
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World

SETTING = "execution.test"
LIFT = "lift"
SHIPPED = {"six_directions": "dmfc.execution.six_directions:SixDirections"}
TABLE_SIZE = 2.0
"""Side of the table that pictures show, metres; for contacts it has no end."""


@dataclass(frozen=True)
class Setup:
    """A scene to execute grasps in."""

    hand: HandModel
    description: HandDescription
    objects: list[ObjectModel]
    T_world_object: np.ndarray
    """[k, 4, 4] where the objects rest on the table z = 0."""
    physics: PhysicsConfig
    config: ExecutionConfig
    visual: bool = False
    """Whether pictures will be taken: with full meshes."""

    def world(self, table: bool = True) -> World:
        """The simulation of the hand and the objects, which are not placed yet."""
        return World(
            self.description,
            self.objects,
            self.physics,
            table_size=TABLE_SIZE if table else None,
            visual=self.visual,
        )


class ProtocolTest(Protocol):
    """Executes and judges the grasps of one scene."""

    @property
    def world(self) -> World:
        """The simulation."""

    def run(
        self,
        T_world_palm: np.ndarray,
        joints: np.ndarray,
        target: int,
        observer: Observer | None = None,
    ) -> Outcome:
        """Execute a grasp [4, 4], [D] rad on object `target` of the scene."""


def open_test(setup: Setup) -> ProtocolTest:
    """The test of `setup.config.test` in a scene. Raises DmfcError where there is none."""
    name = setup.config.test
    if name == LIFT:
        return TrialRunner(setup.world(), setup.hand, setup.T_world_object, setup.config)
    if is_custom(name):
        return _Checked(custom_class(name, SETTING).load()(setup), name)
    if name not in SHIPPED:
        raise unknown_name(f"test ({SETTING})", name, [LIFT, *SHIPPED])
    module, _, made = SHIPPED[name].partition(":")
    return cast(ProtocolTest, getattr(importlib.import_module(module), made)(setup))


class _Checked:
    """A user's test, whose answers are looked at before they are counted."""

    def __init__(self, test: Any, name: str) -> None:
        self._test, self._name = test, name

    @property
    def world(self) -> World:
        return cast(World, self._test.world)

    def run(
        self,
        T_world_palm: np.ndarray,
        joints: np.ndarray,
        target: int,
        observer: Observer | None = None,
    ) -> Outcome:
        outcome = self._test.run(T_world_palm, joints, target, observer)
        if not isinstance(outcome, Outcome):
            raise DmfcError(f"{SETTING}: '{self._name}' gave {type(outcome).__name__}, no Outcome")
        if outcome.held and not outcome.planned:
            raise DmfcError(f"{SETTING}: '{self._name}' gave a grasp as held that is not planned")
        if not outcome.held and outcome.reason not in REASONS:
            raise DmfcError(f"{SETTING}: {unknown_name('reason', outcome.reason, REASONS)}")
        if outcome.held and outcome.reason:
            raise DmfcError(f"{SETTING}: '{self._name}' gave a reason for a grasp that is held")
        return outcome
