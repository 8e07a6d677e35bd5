"""Grasp sets on disk and in memory."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.grasps.grasp_set import GraspSet

DOFS = ["a", "b", "c"]
ARRAYS = (
    *("position", "rotation", "joints", "palm_hit"),
    *("q1", "penetration", "robustness", "contacts"),
)


def some(count: int = 7) -> GraspSet:
    generator = np.random.default_rng(0)
    hit = generator.uniform(-0.1, 0.1, (count, 3))
    hit[::3] = np.nan
    return GraspSet(
        object_id="ycb/mug",
        hand="claw",
        dof_names=DOFS,
        position=generator.uniform(-0.2, 0.2, (count, 3)),
        rotation=Rotation.random(count, random_state=generator).as_matrix(),
        joints=generator.uniform(-1, 1, (count, 3)),
        palm_hit=hit,
        q1=generator.uniform(0, 1, count),
        penetration=generator.uniform(0, 0.004, count),
        robustness=generator.uniform(0, 1, count),
        contacts=generator.integers(2, 9, count),
        notes={"checked": "40", "spaced key": "held: 7"},
    )


def test_round_trip(tmp_path: Path) -> None:
    before = some()
    before.save(tmp_path / "grasps.parquet")
    after = GraspSet.load(tmp_path / "grasps.parquet")
    assert len(after) == 7
    assert (after.object_id, after.hand, after.dof_names) == ("ycb/mug", "claw", DOFS)
    assert after.notes == before.notes
    for name in ARRAYS:
        read = getattr(after, name)
        assert read.dtype == np.float64
        assert read == pytest.approx(getattr(before, name), abs=1e-6, nan_ok=True), name
    # Half a turn, where quaternions change sign, and what was read is a rotation.
    product = after.rotation @ np.swapaxes(after.rotation, 1, 2)
    assert product == pytest.approx(np.tile(np.eye(3), (7, 1, 1)), abs=1e-9)


def test_the_same_set_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        some().save(tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_an_empty_set_is_a_set(tmp_path: Path) -> None:
    before = GraspSet.empty("ycb/anvil", "claw", DOFS, {"checked": "2000"})
    assert len(before) == 0
    before.save(tmp_path / "empty.parquet")
    after = GraspSet.load(tmp_path / "empty.parquet")
    assert len(after) == 0
    assert after.object_id == "ycb/anvil"
    assert after.notes == {"checked": "2000"}
    assert after.position.shape == (0, 3)
    assert after.rotation.shape == (0, 3, 3)
    assert after.joints.shape == (0, 3)
    assert after.T_object_palm.shape == (0, 4, 4)


def test_rows_are_chosen_together() -> None:
    grasps = some()
    for rows in (np.array([4, 1]), np.arange(7) > 4, slice(2, 5)):
        chosen = grasps[rows]
        assert chosen.dof_names == DOFS
        for name in ARRAYS:
            expected = getattr(grasps, name)[rows]
            assert np.array_equal(getattr(chosen, name), expected, equal_nan=True), name
    T = grasps[np.array([3])].T_object_palm[0]
    assert T[3].tolist() == [0, 0, 0, 1]
    assert np.array_equal(T[:3, 3], grasps.position[3])
    assert np.array_equal(T[:3, :3], grasps.rotation[3])


def test_arrays_of_different_lengths_are_no_set() -> None:
    whole = some()
    with pytest.raises(ValueError, match="reshape"):
        dataclasses.replace(whole, contacts=np.ones(3))


@pytest.mark.parametrize("kind", ["missing", "not Parquet", "another table", "another version"])
def test_what_is_no_grasp_set_is_refused_on_one_line(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "grasps.parquet"
    if kind == "not Parquet":
        path.write_bytes(b"PAR1 but not really")
    elif kind == "another table":
        pq.write_table(pa.table({"x": [1]}), path)
    elif kind == "another version":
        some().save(path)
        table = pq.read_table(path)
        metadata = {**table.schema.metadata, b"dmfc.grasp_set": b"99"}
        pq.write_table(table.replace_schema_metadata(metadata), path)
    message = {"another table": "version none", "another version": "version 99, expected 1"}
    with pytest.raises(DmfcError, match=message.get(kind, "cannot be read")) as caught:
        GraspSet.load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
