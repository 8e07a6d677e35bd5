"""The six-direction test against closed forms, and tests in files of the user's own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dmfc.config.load import load_config
from dmfc.config.protocol import executed
from dmfc.errors import DmfcError
from dmfc.execution.protocol_test import Setup, open_test
from dmfc.execution.trial import TrialRunner
from dmfc.pipeline.graph import GraphBuilder
from tests.support.execution_shapes import good, standing
from tests.support.fake_science import fake_refs
from tests.support.grasp_shapes import planned, shadow, shape
from tests.support.pages import write_files


def setup(names=("block",), **physics) -> Setup:
    under = executed(load_config("smoke", ["execution.protocol=six_directions"]))
    hand, description = shadow()
    return Setup(
        dataclasses.replace(hand, closing=under.closing),
        description,
        [shape(name) for name in names],
        np.array([standing(name, 0.25 * k) for k, name in enumerate(names)]),
        dataclasses.replace(under.physics, **physics),
        under.execution,
    )


@pytest.fixture
def grasps(shadow_hand_dir):
    """T_world_palm and joints of the block's planned grasps that the lift holds."""
    found, T = planned("block"), standing("block")
    return [(T @ found.T_object_palm[row], found.joints[row]) for row in good("block")]


def test_an_object_that_nobody_holds_falls_freely(grasps):
    """1/2 a t^2 after the first look: 0.2 m after 0.2 s at 10 m/s^2."""
    (T, joints), *_ = grasps
    away = T.copy()
    away[:3, 3] += [0.0, 0.0, 0.5]
    outcome = open_test(setup()).run(away, joints, 0)
    assert (outcome.planned, outcome.held, outcome.reason) == (True, False, "dropped in hold")
    assert outcome.hold_slip == pytest.approx(0.2, rel=0.03)
    assert outcome.hold_turn == pytest.approx(0.0, abs=1e-6)
    assert outcome.contacts == 0
    assert outcome.seconds == pytest.approx({"close": 0.4, "squeeze": 0.4, "hold": 0.2})


def test_good_grasps_hold_and_need_friction(grasps):
    test = open_test(setup())
    outcomes = [test.run(T, joints, 0) for T, joints in grasps[:3]]
    held = [outcome for outcome in outcomes if outcome.held]
    assert held
    for outcome in held:
        assert outcome.reason == ""
        assert outcome.hold_slip < 0.05
        assert outcome.seconds["hold"] == pytest.approx(12.0)  # six times 2 s
        assert outcome.contacts >= 2
    assert test.run(*grasps[0], 0).row() == outcomes[0].row()  # nothing is left over
    slippery = open_test(setup(hand_friction=0.0, object_friction=0.0, torsional_friction=0.0))
    assert not all(slippery.run(T, joints, 0).held for T, joints in grasps[:3])


def test_a_hand_in_the_object_is_not_tried(grasps):
    (T, joints), *_ = grasps
    hand, _ = shadow()
    deeper = T.copy()
    deeper[:3, 3] += 0.04 * T[:3, :3] @ hand.palm_normal
    outcome = open_test(setup()).run(deeper, joints, 0)
    assert (outcome.planned, outcome.reason) == (False, "plan: object")
    assert outcome.plan_depth > 0.01


def test_other_objects_wait_where_they_are(grasps):
    (T, joints), *_ = grasps
    away = T.copy()
    away[:3, 3] += [0.0, 0.0, 0.5]
    test = open_test(setup(("ball", "block")))
    start = test.world.object_pose(0)
    T_block = standing("block", 0.25)
    alone = open_test(setup()).run(away, joints, 0)
    beside = test.run(T_block @ np.linalg.inv(standing("block")) @ away, joints, 1)
    np.testing.assert_allclose(test.world.object_pose(0), start, atol=1e-6)
    assert beside.reason == alone.reason
    assert beside.hold_slip == pytest.approx(alone.hold_slip, abs=1e-6)


def test_a_test_of_the_page_is_ours_but_stricter(grasps, tmp_path, monkeypatch):
    write_files("execution.md", tmp_path)
    monkeypatch.chdir(tmp_path)
    given = setup()
    config = dataclasses.replace(given.config, test="my_test.py:Still", max_slip=0, max_turn=0)
    config = dataclasses.replace(config, grasp_tolerance=0.03)
    given = dataclasses.replace(given, config=config)
    ours = TrialRunner(given.world(), given.hand, given.T_world_object, config)
    theirs = open_test(given)
    for T, joints in grasps[:2]:
        one, other = ours.run(T, joints, 0), theirs.run(T, joints, 0)
        still = max(one.lift_turn, one.hold_turn) <= 0.17
        assert other.held == (one.held and still)
        assert other.contacts == one.contacts


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ("None", "gave NoneType, no Outcome"),
        ("Outcome(held=True, reason='')", "as held that is not planned"),
        ("Outcome(planned=True, held=True)", "a reason for a grasp that is held"),
        ("Outcome(reason='droped in hold')", "did you mean 'dropped in hold'"),
    ],
)
def test_what_a_test_answers_is_looked_at(tmp_path, shadow_hand_dir, answer, message):
    file = tmp_path / "mine.py"
    file.write_text(
        "from dmfc.execution.outcome import Outcome\n"
        "class Mine:\n"
        "    def __init__(self, setup): self.world = None\n"
        f"    def run(self, T, joints, target, observer=None): return {answer}\n"
    )
    given = setup()
    given = dataclasses.replace(
        given, config=dataclasses.replace(given.config, test=f"{file}:Mine")
    )
    with pytest.raises(DmfcError, match=message):
        open_test(given).run(np.eye(4), np.zeros(18), 0)


def test_the_file_of_a_test_is_part_of_the_evaluation_alone(tmp_path):
    file = tmp_path / "mine.py"
    builder = GraphBuilder(fake_refs)

    def cell(text):
        file.write_text(text)
        config = load_config("smoke", [f"execution.test={file}:Mine"])
        return builder.cell(config, "pretrained", "x")

    first, second = cell("class Mine: ...\n"), cell("class Mine: ...\n\n")
    assert first.evaluations[0].key != second.evaluations[0].key
    assert first.model.key == second.model.key
    with pytest.raises(DmfcError, match="unknown class"):
        cell("class Other: ...\n")
    given = builder.cell(load_config("smoke", ["execution.test=lift"]), "random", "x")
    default = builder.cell(load_config("smoke"), "random", "x")
    assert given.evaluations[0].key == default.evaluations[0].key


def test_an_unknown_test_is_one_line(shadow_hand_dir):
    given = setup()
    config = dataclasses.replace(given.config, test="six_direction")
    with pytest.raises(DmfcError, match="did you mean 'six_directions'"):
        open_test(dataclasses.replace(given, config=config))
