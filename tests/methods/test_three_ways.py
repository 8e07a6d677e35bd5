"""A method of 15 lines in a folder of its own: in a sweep, from Python and by files, one result."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dmfc.errors import DmfcError
from tests.methods.conftest import SETTINGS

SET = [f"--set={key}={json.dumps(value)}" for key, value in SETTINGS.items()]
OWN = ["method_seconds", "method_failure", "method_used"]


def test_a_method_has_one_result_in_three_ways(lab, store, folder, dmfc):
    lines = (folder / "my_method.py").read_text().splitlines()
    body = [line for line in lines if line.strip() and "import" not in line]
    assert len(body) <= 15
    result = lab.sweep("my_table.yaml")
    assert list(result.rates.index) == ["mine", "planner", "random"]
    assert result.complete
    trials = result.trials
    swept = trials[trials["cell"] == "mine"].drop(columns=["cell", "seed"]).reset_index(drop=True)
    assert len(swept) == 4
    assert set(swept["reason"]) != {"no candidate"}

    from_python = lab.evaluate(runpy.run_path("my_method.py")["predict"])
    status, out, err = dmfc(
        "benchmark", "export", "scenes", "--preset=smoke", "--store", store, "--json", *SET
    )
    assert status == 0, err
    assert len(json.loads(out)["scenes"]) == 2
    runpy.run_path("answer.py")
    call = ("--preset=smoke", "--store", store, "--out=out", *SET)
    status, _, err = dmfc("benchmark", "score", "grasps", *call)
    assert status == 0, err
    by_files = pd.read_parquet("out/trials.parquet")

    columns = [name for name in from_python.trials if name not in OWN]
    for other in (from_python.trials, by_files):
        pd.testing.assert_frame_equal(other[columns], swept[columns], check_exact=True)
    row = result.table.rows[0].method
    assert row.failed_scenes == 0
    assert row.seconds > 0
    assert "| s per scene | failed scenes | used |" in (result.folder / "table.md").read_text()

    # The command finds what the sweep has made: it is the same stage.
    status, out, err = dmfc("evaluate", "my_method.py:predict", *call[:3], *SET, "--json")
    assert status == 0, err
    assert json.loads(out)["method"]["seconds"] == pytest.approx(row.seconds)


def test_the_stage_depends_on_the_content_of_the_file(lab, folder):
    def key(name):
        cell = lab._session.builder.cell(lab.config, "method", "x", method=name)
        return cell.evaluations[0].key

    first = key("my_method.py:predict")
    text = (folder / "my_method.py").read_text()
    (folder / "again.py").write_text(text)
    (folder / "other.py").write_text(text.replace("0.6", "0.5"))
    assert key("again.py:predict") == first
    assert key("other.py:predict") != first


def test_a_scene_that_fails_counts_and_says_why(lab):
    def first_scene_alone(seen):
        _ = seen.normals, seen.segments
        if seen.id.startswith("0001"):
            raise ZeroDivisionError("no\nway")
        return answer(seen)

    found = lab.evaluate(first_scene_alone)
    rows = found.trials.set_index("scene")
    assert set(rows.loc[1, "reason"]) == {"no candidate"}
    assert set(rows.loc[1, "method_failure"]) == {"ZeroDivisionError: no"}
    assert set(rows.loc[0, "method_failure"]) == {""}
    assert found.row.method.failures == {"ZeroDivisionError: no": 1}
    assert found.row.method.used == "normals segments"
    assert found.row.trials == 4
    with pytest.raises(DmfcError, match="fails in every scene: the answer has no position"):
        lab.evaluate(lambda seen: {})
    with pytest.raises(DmfcError, match="cannot run here: FileNotFoundError"):
        lab.evaluate(lambda seen: Path("weights.bin").read_bytes())


def answer(seen):
    """One grasp above the cloud."""
    return {
        "position": seen.points.mean(0, keepdims=True) + np.array([0, 0, 0.2]),
        "quaternion": [[0, 1, 0, 0]],
        "joints": [seen.hand.open_joints],
        "joint_names": seen.hand.dof_names,
        "score": [-3.0],
    }


def test_files_that_are_refused_are_one_line(lab, store, dmfc, tmp_path):
    from dmfc.experiment.benchmark import observations
    from dmfc.experiment.session import Session
    from dmfc.methods.files import read_answers

    overrides = [f"{key}={json.dumps(value)}" for key, value in SETTINGS.items()]
    seen = observations(Session.open("smoke", overrides, store))
    good = {"id": seen[0].id, **answer(seen[0])}
    np.savez(tmp_path / "good.npz", **good)
    table = {name: [float(value)] for name, value in zip("xyz", good["position"][0], strict=True)}
    turn = dict(
        zip(["palm_qw", "palm_qx", "palm_qy", "palm_qz"], [[0.0], [1.0], [0.0], [0.0]], strict=True)
    )
    joints = {
        name: [value] for name, value in zip(good["joint_names"], good["joints"][0], strict=True)
    }
    backwards = dict(reversed(joints.items()))
    columns = {
        "id": [seen[1].id],
        **backwards,
        **{f"palm_{k}": v for k, v in table.items()},
        **turn,
    }
    pd.DataFrame({**columns, "score": [-3.0]}).to_parquet(tmp_path / "good.parquet")
    found = read_answers([tmp_path], seen)
    assert set(found) == {seen[0].id, seen[1].id}
    first, second = (found[one.id].answer for one in seen)
    np.testing.assert_array_equal(first.joints, second.joints)
    np.testing.assert_allclose(first.rotation, second.rotation)
    # The point is the one nearest to 4 cm ahead of the palm, by brute force.
    hand = seen[0].hand
    centre = first.position[0] + first.rotation[0] @ (hand.palm_reference + 0.04 * hand.palm_normal)
    assert first.point[0] == np.linalg.norm(seen[0].points - centre, axis=1).argmin()

    for name, text in {
        "id": "0000-ffffffff",
        "seconds": [1.0, 2.0],
        "position": [[0, 0, 0.1, 0]],
    }.items():
        np.savez(tmp_path / "bad.npz", **{**good, name: text})
        status, _, err = dmfc(
            "benchmark", "score", tmp_path / "bad.npz", "--preset=smoke", "--store", store, *SET
        )
        assert status == 1
        assert "bad.npz: " in err
        assert len(err.strip().splitlines()) == 1
    np.savez(tmp_path / "bad.npz", **good)
    with pytest.raises(DmfcError, match="are both of scene 0000"):
        read_answers([tmp_path], seen)
