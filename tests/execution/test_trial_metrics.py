"""Trial metrics, taken a second time from MuJoCo's arrays, by scipy and by brute force."""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmfc.config.losses import Q1Config
from dmfc.execution.outcome import PHASES, Outcome
from dmfc.hand.mjcf import PREFIX
from dmfc.hand.model import HandModel
from dmfc.losses.q1 import lattice_directions
from dmfc.physics.world import World
from tests.support.execution_shapes import good, runner, standing
from tests.support.grasp_shapes import planned, shape


class Recorder:
    """What MuJoCo says at every look of a trial, phase by phase."""

    def __init__(self) -> None:
        self.looks: list[tuple[str, SimpleNamespace]] = []

    def __call__(self, phase: str, world: World) -> None:
        model, data = world.model, world.data
        body, palm = model.body("object0").id, model.body(PREFIX + world.hand.palm).id
        root = model.body_rootid[model.geom_bodyid[data.contact.geom]]
        hand = root == model.body_rootid[palm]
        thing = root == body
        mixed = (hand.any(1) & thing.any(1)), hand.all(1)
        deepest = [max(0.0, -data.contact.dist[rows].min(initial=0.0)) for rows in mixed]
        limits = model.actuator_forcerange[world.index.actuator]
        torque = data.actuator_force[world.index.actuator]
        full = (torque <= 0.99 * limits[:, 0]) | (torque >= 0.99 * limits[:, 1])
        kinematics = mujoco.MjData(model)  # poses of the state now, not of the step before
        kinematics.qpos[:] = data.qpos
        mujoco.mj_kinematics(model, kinematics)
        turn = [Rotation.from_matrix(kinematics.xmat[b].reshape(3, 3)) for b in (palm, body)]
        centre = turn[0].inv().apply(kinematics.xipos[body] - kinematics.xpos[palm])
        self.looks.append(
            (
                phase,
                SimpleNamespace(
                    hand=deepest[0],
                    itself=deepest[1],
                    full=full.mean(),
                    turn=turn[0].inv() * turn[1],
                    centre=centre,
                    world_centre=kinematics.xipos[body].copy(),
                    contacts=_contacts(world, mixed[0], hand, kinematics.xipos[body]),
                ),
            )
        )

    def of(self, *phases: str) -> list[SimpleNamespace]:
        return [seen for phase, seen in self.looks if phase in phases]


def _contacts(
    world: World, rows: np.ndarray, hand: np.ndarray, centre: np.ndarray
) -> tuple[np.ndarray, np.ndarray, set[int]]:
    """Arms [c, 3] about the centre of mass, outward normals [c, 3], links that touch."""
    contact = world.data.contact
    # The normal points from the first geom to the second: outward if the object is the first.
    sign = np.where(hand[rows, 0], -1.0, 1.0)[:, None]
    geoms = contact.geom[rows][hand[rows]]
    links = set(world.model.geom_bodyid[geoms].tolist())
    return contact.pos[rows] - centre, sign * contact.frame[rows, :3], links


@pytest.fixture(scope="module", params=["block", "ball"])
def trial(request: pytest.FixtureRequest, hand: HandModel) -> tuple[Outcome, Recorder]:
    name, recorder = request.param, Recorder()
    T, row = standing(name), good(name)[0]
    trials = runner([shape(name)], [T])
    outcome = trials.run(
        T @ planned(name).T_object_palm[row], planned(name).joints[row], 0, recorder
    )
    assert outcome.held
    return outcome, recorder


def test_penetrations_are_those_of_mujocos_contacts(trial: tuple[Outcome, Recorder]) -> None:
    outcome, recorder = trial
    looks = recorder.of(*PHASES)
    assert outcome.hand_penetration == pytest.approx(max(seen.hand for seen in looks))
    assert outcome.self_penetration == pytest.approx(max(seen.itself for seen in looks))
    assert outcome.contact_penetration >= outcome.hand_penetration > 0


def test_turns_and_slips_in_the_hand_are_scipys(trial: tuple[Outcome, Recorder]) -> None:
    outcome, recorder = trial
    before, after_lift = recorder.of("squeeze")[-1], recorder.of("lift")[-1]
    for start, phase in ((before, "lift"), (after_lift, "hold")):
        looks = recorder.of(phase)
        turn = max((start.turn.inv() * seen.turn).magnitude() for seen in looks)
        slip = max(float(np.linalg.norm(seen.centre - start.centre)) for seen in looks)
        assert getattr(outcome, f"{phase}_turn") == pytest.approx(turn, abs=1e-7)
        assert getattr(outcome, f"{phase}_slip") == pytest.approx(slip, abs=1e-9)
    assert outcome.lift_turn > 1e-3


def test_the_push_is_that_of_the_centre_of_mass(trial: tuple[Outcome, Recorder]) -> None:
    outcome, recorder = trial
    start = recorder.of("raise")[0].world_centre  # nothing has touched it yet
    pushed = float(np.linalg.norm(recorder.of("squeeze")[-1].world_centre - start))
    assert outcome.pushed == pytest.approx(pushed, abs=1e-5)
    assert outcome.pushed > 1e-4


def test_saturation_is_the_mean_share_of_full_torques(trial: tuple[Outcome, Recorder]) -> None:
    outcome, recorder = trial
    looks = recorder.of("close", "squeeze", "lift", "hold")
    assert outcome.saturation == pytest.approx(np.mean([seen.full for seen in looks]))


def test_q1_is_the_bound_by_brute_force(trial: tuple[Outcome, Recorder]) -> None:
    """min over directions of max over contacts and over forces on the rim of the friction cone."""
    outcome, recorder = trial
    arms, outward, links = recorder.of("squeeze")[-1].contacts
    assert outcome.contacts == len(links) >= 1
    config = Q1Config()
    directions = lattice_directions(config.directions).numpy()
    best = np.zeros(len(directions))
    for arm, normal in zip(arms, outward, strict=True):
        across = np.linalg.svd(normal[None])[2][1:]  # two tangents
        angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)[:, None]
        rim = -normal + config.friction * (np.cos(angle) * across[0] + np.sin(angle) * across[1])
        wrench = np.hstack([rim, config.torque_weight * np.cross(arm, rim)])
        best = np.maximum(best, (wrench @ directions.T).max(axis=0))
    assert outcome.q1 == pytest.approx(best.min(), rel=1e-4, abs=1e-6)


def test_seconds_are_those_of_the_phases(trial: tuple[Outcome, Recorder]) -> None:
    outcome, recorder = trial
    for phase in PHASES:
        assert outcome.seconds[phase] == pytest.approx(0.1 * len(recorder.of(phase)))
