"""Importing grasps of other projects for the user's own meshes: one object, or a folder of them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from dmfc.errors import DmfcError
from dmfc.experiment.evaluation import _source
from dmfc.experiment.grasp_import import ImportRequest, _by_name, import_grasps
from dmfc.experiment.session import Session
from dmfc.grasps.exchange.hand_map import load_hand_map

COARSE = [
    "hand.link_sdf_spacing=0.02",
    "hand.collision_points=300",
    "objects.prepare.sdf_max_voxels=20000",
    "objects.prepare.surface_points=500",
]
SIZE = np.array([1.0, 0.8, 1.6])
"""Of a normalised box: its corners are 1.02 from its centre."""


def net_grasps(*scales: float) -> np.ndarray:
    names = ["WRJTx", "WRJTy", "WRJTz", "WRJRx", "WRJRy", "WRJRz"]
    qpos = dict.fromkeys([*names, *load_hand_map("dexgraspnet").joints], 0.0) | {"WRJTy": -0.08}
    return np.array([{"qpos": dict(qpos), "scale": scale} for scale in scales], dtype=object)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The layout of DexGraspNet: whole meshes beside their convex pieces, and a file per object."""
    folder = tmp_path_factory.mktemp("net")
    for name, stretch in (("core-mug-1", 1.0), ("core-mug-12", 0.9), ("sem-jar", 1.0)):
        coacd = folder / "meshes" / name / "coacd"
        coacd.mkdir(parents=True)
        trimesh.creation.box(SIZE * stretch).export(coacd / "decomposed.obj")
        trimesh.creation.box(SIZE / 2).export(coacd / "coacd_convex_piece_0.obj")
    (folder / "grasps").mkdir()
    np.save(folder / "grasps" / "core-mug-1.npy", net_grasps(0.06, 0.06, 0.08))
    np.save(folder / "grasps" / "core-mug-12.npy", net_grasps(0.06))
    np.save(folder / "grasps" / "sem-jar.npy", net_grasps(0.1))
    np.save(folder / "grasps" / "sem-pan.npy", net_grasps(0.06))
    return folder


@pytest.fixture(scope="module")
def session(folder, shadow_hand_dir) -> Session:
    """A store with the hand and the boxes of size 0.06; made one by one, which needs no cluster."""
    session = Session.open("smoke", COARSE, folder / "store")
    meshes = f"folder:{folder / 'meshes'}?scale=0.06&file="
    names = [f"{name}/coacd/decomposed.obj" for name in ("core-mug-1", "core-mug-12")]
    for stage in [
        session.builder.hand(session.config),
        *session.builder.selected_objects(session.config, [meshes + name for name in names]),
    ]:
        session.make([stage])
    return session


def test_each_of_several_objects_takes_its_file(session, folder):
    request = ImportRequest(
        "dexgraspnet", [folder / "grasps"], f"folder:{folder / 'meshes'}", scale=0.06
    )
    found = import_grasps(session, request)
    one, other = (f"folder/core-mug-{n}-coacd-decomposed-0.06" for n in (1, 12))
    assert {name: len(grasps) for name, grasps in found.sets.items()} == {one: 2, other: 1}
    np.testing.assert_allclose(found.sets[one].position, [[0, -0.08, 0]] * 2, atol=1e-9)
    (reason,) = found.failed.values()
    assert "no grasp for --scale 0.06; there are 0.1" in reason
    assert [file.name for file in found.strangers] == ["sem-pan.npy"]


def test_what_was_imported_can_be_evaluated(session, folder, tmp_path):
    """The set says which mesh, and in which size, it is for."""
    mesh = f"folder:{folder / 'meshes' / 'core-mug-1'}"
    grasps = folder / "grasps" / "core-mug-1.npy"
    selector = f"folder:{folder / 'meshes'}?scale=0.06&file=core-mug-1/coacd/decomposed.obj"
    request = ImportRequest("dexgraspnet", [grasps], selector, scale=0.06)
    ((name, found),) = import_grasps(session, request).sets.items()
    found.save(tmp_path / "a.parquet")
    source = _source(str(tmp_path))
    assert source.files == {name: tmp_path / "a.parquet"}
    assert source.objects == [selector]
    (stage,) = session.builder.selected_objects(session.config, source.objects)
    assert (stage.name, stage.config["digest"]) == (name, found.notes["object_digest"])
    found.save(tmp_path / "b.parquet")
    with pytest.raises(DmfcError, match=r"two grasp sets of .*a\.parquet and .*b\.parquet"):
        _source(str(tmp_path))
    with pytest.raises(DmfcError, match=r"several sizes of the object \(0\.06, 0\.08\)"):
        import_grasps(session, ImportRequest("dexgraspnet", [grasps], mesh))


def test_no_file_by_the_name_of_an_object(session, folder):
    request = ImportRequest(
        "dexgraspnet", [folder / "grasps" / "sem-pan.npy"], f"folder:{folder / 'meshes'}"
    )
    with pytest.raises(DmfcError, match="is named after one of the 3 objects"):
        import_grasps(session, request)


@pytest.mark.parametrize(
    ("objects", "files", "expected"),
    [
        (["ycb/mug", "ycb/can"], ["mug/0.npy", "can/scale006/1.npy"], [["mug/0.npy"], 1]),
        (["a/x-1", "a/x-12"], ["x-1.npy", "x-12.npy"], [["x-1.npy"], 1]),
        (["own/b", "own/a"], ["own__b/0.npy", "own__a/0.npy"], [["own__b/0.npy"], 1]),
        (["f/m-coacd-d", "f/n-coacd-d"], ["m/0.npy", "n/0.npy"], [["m/0.npy"], 1]),
    ],
)
def test_files_by_name(tmp_path, objects, files, expected):
    stages = [Named(name) for name in objects]
    paths = [tmp_path / file for file in files]
    found = _by_name(stages, paths, [tmp_path])
    assert found[stages[0]] == [tmp_path / name for name in expected[0]]
    assert len(found[stages[1]]) == expected[1]


def test_a_name_of_several_objects_is_refused(tmp_path):
    stages = [Named("f/m-left"), Named("f/m-right")]
    with pytest.raises(DmfcError, match=r"'m' names several objects \(f/m-left, f/m-right\)"):
        _by_name(stages, [tmp_path / "m.npy"], [tmp_path])


class Named(SimpleNamespace):
    """A stage of which only the name counts."""

    def __init__(self, name: str) -> None:
        super().__init__(name=name)

    def __hash__(self) -> int:
        return hash(self.name)
