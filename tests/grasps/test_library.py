"""The library: what is in it can be read, what is not is named, what does not fit is refused."""

import numpy as np
import pytest

from dmfc.engine.context import StageContext
from dmfc.errors import DmfcError
from dmfc.files.digest import file_digest
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.library import file_name, library_file, library_folder
from dmfc.pipeline.stages import GRASPS, plan_grasps


def one_grasp(object_id: str, digest: str) -> GraspSet:
    scalars = (np.ones(1) for _ in range(4))
    return GraspSet(
        np.zeros((1, 3)),
        np.eye(3)[None],
        np.zeros((1, 2)),
        object_id,
        "shadow",
        ["a", "b"],
        np.zeros((1, 3)),
        *scalars,
        notes={"object_digest": digest},
    )


def context(tmp_path, path, name="box/one", digest="d1", library=None) -> StageContext:
    out = tmp_path / "out"
    out.mkdir(exist_ok=True)
    config = {"library": library or file_digest(path), "object": name, "digest": digest}
    hints = {"file": str(path)}
    return StageContext("grasps", name, "k", config, {}, out, tmp_path / "work", hints=hints)


def test_every_file_of_the_library_holds_verified_grasps_of_the_object_that_names_it():
    paths = sorted(library_folder().glob("*/*.parquet"))
    assert paths
    for path in paths:
        found = GraspSet.load(path)
        assert path == library_folder() / file_name(found.hand, found.object_id)
        assert found.notes["object_digest"]
        assert len(found) > 0
        assert (found.penetration < 0.004).all()
        np.testing.assert_allclose(np.linalg.det(found.rotation), 1.0, atol=1e-6)


def test_an_object_that_is_not_in_the_library_is_named():
    with pytest.raises(DmfcError, match="no grasps of 'box/none' for the hand 'shadow'"):
        library_file("shadow", "box/none")


def test_the_stage_copies_the_set_of_the_library(tmp_path):
    path = tmp_path / "one.parquet"
    one_grasp("box/one", "d1").save(path)
    ctx = context(tmp_path, path)
    plan_grasps(ctx)
    assert (ctx.out / GRASPS).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("changed", [{"digest": "d2"}, {"name": "box/two"}])
def test_grasps_of_another_mesh_are_refused(tmp_path, changed):
    path = tmp_path / "one.parquet"
    one_grasp("box/one", "d1").save(path)
    with pytest.raises(DmfcError, match=r"planned for another mesh: set grasps\.source=plan"):
        plan_grasps(context(tmp_path, path, **changed))


def test_a_file_that_changed_under_the_sweep_is_refused(tmp_path):
    path = tmp_path / "one.parquet"
    one_grasp("box/one", "d1").save(path)
    with pytest.raises(DmfcError, match=r"is not the same on .* as where the stage was planned"):
        plan_grasps(context(tmp_path, path, library="0" * 64))
