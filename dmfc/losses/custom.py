"""Terms of the task loss that are custom functions (setting `losses.custom`).

    def spread(hands: PlacedHands) -> Tensor: ...   # [n], one value per grasp

A term is small where a grasp is good, not negative, and of the order of 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

from torch import Tensor

from dmfc.config.custom_function import custom_function
from dmfc.errors import DmfcError
from dmfc.hand.kinematics import HandKinematics
from dmfc.objects.atlas import SceneObjects

SETTING = "losses.custom"


@dataclass(frozen=True)
class PlacedHands:
    """n predicted grasps among the objects of their scenes. World frame, table at z = 0, metres."""

    position: Tensor
    """[n, 3] origin of the palm frame."""
    rotation: Tensor
    """[n, 3, 3] R_world_palm."""
    joints: Tensor
    """[n, D] rad, within the hand's limits."""
    T_world_link: Tensor
    """[n, L, 4, 4] in the order of `kinematics.hand.link_names`."""
    objects: SceneObjects
    """Those around each grasp: distance(points [n, P, 3]) -> [n, K, P], positive inside."""
    kinematics: HandKinematics

    @cached_property
    def points(self) -> Tensor:
        """[n, P, 3] collision points, all over the hand; fewer where the hardest are looked for."""
        return self.kinematics.collision_points_of_links(self.T_world_link)

    @cached_property
    def inner(self) -> Tensor:
        """[n, V, 3] points on the inside of the hand."""
        return self.kinematics.inner_points_of_links(self.T_world_link)[0]


def term_name(text: str) -> str:
    """'custom_spread' for 'my_losses.py:spread': the name of the term's metric."""
    return f"custom_{text.partition(':')[2]}"


class CustomTerms:
    """The user's functions by the names of their terms."""

    def __init__(self, texts: Iterable[str]) -> None:
        """`texts`: each 'file.py:function'. Raises DmfcError where there is no such function."""
        self._functions: dict[str, Callable[[PlacedHands], Tensor]] = {}
        for text in texts:
            if term_name(text) in self._functions:
                raise DmfcError(f"{SETTING}: two functions are named '{text.partition(':')[2]}'")
            self._functions[term_name(text)] = custom_function(text, SETTING).load()

    @property
    def names(self) -> list[str]:
        return list(self._functions)

    def __call__(self, name: str, hands: PlacedHands) -> Tensor:
        """The term `name` of each grasp, [n]. Raises DmfcError where it is of another shape."""
        value = self._functions[name](hands)
        wanted = (len(hands.position),)
        if not isinstance(value, Tensor) or tuple(value.shape) != wanted:
            given = list(value.shape) if isinstance(value, Tensor) else type(value).__name__
            raise DmfcError(
                f"{SETTING}: '{name.removeprefix('custom_')}' gave {given} where one value per "
                f"grasp is wanted, a tensor {list(wanted)}"
            )
        return value
