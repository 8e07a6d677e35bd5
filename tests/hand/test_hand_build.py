"""The built Shadow Hand against MuJoCo's geometry and the paper's counts."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dmfc.errors import DmfcError
from dmfc.hand.mjcf import PREFIX
from dmfc.hand.model import HandModel

INNER = {"palm": 5, "lfmetacarpal": 2, "thproximal": 2, "thmiddle": 2, "thdistal": 2}
INNER |= {
    f"{f}{part}": n
    for f in ("ff", "mf", "rf", "lf")
    for part, n in (("proximal", 2), ("middle", 3), ("distal", 3))
}


def test_degrees_of_freedom_and_limits(hand: HandModel, mujoco_model: mujoco.MjModel) -> None:
    assert hand.dofs == 18
    assert hand.link_names[0] == "rh_palm"
    ranges = np.array([mujoco_model.joint(PREFIX + name).range for name in hand.dof_names])
    assert np.array_equal(hand.lower, ranges[:, 0])
    assert np.array_equal(hand.upper, ranges[:, 1])
    assert (hand.open_joints >= hand.lower).all()
    assert (hand.open_joints <= hand.upper).all()
    turning = np.bincount(hand.joint_dof[hand.joint_dof >= 0], minlength=18)
    names = np.array(hand.dof_names)
    assert set(names[turning == 2]) == {"rh_FFJ2", "rh_MFJ2", "rh_RFJ2", "rh_LFJ2"}
    assert (turning >= 1).all()


def test_collision_points_are_on_mujocos_surface(
    hand: HandModel, mujoco_model: mujoco.MjModel
) -> None:
    assert hand.collision_points.shape == (2000, 3)
    assert set(hand.collision_link) == set(range(hand.links))
    for i in range(0, 2000, 7):
        assert (
            abs(mujoco_gap(mujoco_model, hand.collision_link[i], hand.collision_points[i])) < 1e-5
        )


def test_collision_points_are_spread_by_area(hand: HandModel) -> None:
    """Free area: a proximal link is a whole capsule of radius 9 mm, 4 cm between its centres."""
    capsule = 2 * np.pi * 0.009 * 0.04 + 4 * np.pi * 0.009**2
    base = 4 * np.pi * 0.013**2
    counts = np.bincount(hand.collision_link)
    proximal = hand.link_names.index("rh_ffproximal")
    thumb = hand.link_names.index("rh_thbase")
    assert counts[proximal] / counts[thumb] == pytest.approx(capsule / base, rel=0.05)


def test_inner_points_are_the_papers_and_face_the_grasp(hand: HandModel) -> None:
    count = Counter(hand.link_names[i].removeprefix("rh_") for i in hand.inner_link)
    assert count == INNER
    assert len(hand.inner_link) == 45
    assert np.allclose(np.linalg.norm(hand.inner_normals, axis=1), 1)
    # Fingers flex towards -y of their links, the first links of the thumb towards -x.
    inward = np.tile([0.0, -1.0, 0.0], (45, 1))
    thumb = [hand.link_names[i] in ("rh_thproximal", "rh_thmiddle") for i in hand.inner_link]
    inward[thumb] = [-1, 0, 0]
    assert (np.einsum("ij,ij->i", hand.inner_normals, inward) > 0.85).all()


def test_inner_points_are_on_mujocos_surface(hand: HandModel, mujoco_model: mujoco.MjModel) -> None:
    for link, point in zip(hand.inner_link, hand.inner_points, strict=True):
        assert abs(mujoco_gap(mujoco_model, link, point)) < 1e-5


def mujoco_gap(model: mujoco.MjModel, link: int, point: np.ndarray) -> float:
    """Distance between a point of a link and the link's collision geometry, by MuJoCo.

    A ball of radius 0.1 mm at the point, in a model of the link's shapes alone.
    """
    radius, spec = 1e-4, mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], pos=point)
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] != link + 1 or not model.geom_contype[geom]:
            continue
        kind, extra = mujoco.mjtGeom(model.geom_type[geom]), {}
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            first = model.mesh_vertadr[model.geom_dataid[geom]]
            last = first + model.mesh_vertnum[model.geom_dataid[geom]]
            spec.add_mesh(name="mesh", uservert=model.mesh_vert[first:last].ravel())
            extra = {"meshname": "mesh"}
        spec.worldbody.add_geom(
            type=kind,
            size=model.geom_size[geom],
            pos=model.geom_pos[geom],
            quat=model.geom_quat[geom],
            **extra,
        )
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_forward(compiled, data)
    gaps = [
        mujoco.mj_geomDistance(compiled, data, 0, geom, 1.0, None)
        for geom in range(1, compiled.ngeom)
    ]
    return float(min(gaps)) + radius


@pytest.mark.parametrize("name", ["rh_ffproximal", "rh_lfmetacarpal", "rh_thbase", "rh_ffdistal"])
def test_link_grids_against_exact_distance(
    hand: HandModel, mujoco_model: mujoco.MjModel, name: str
) -> None:
    link = hand.link_names.index(name)
    grid = hand.link_grids[link]
    points = np.random.default_rng(0).uniform(grid.origin, grid.upper, (200, 3))
    exact = -np.array([mujoco_gap(mujoco_model, link, point) for point in points])
    outside = exact < 0
    # Trilinear interpolation cuts the corners of what it samples every 2 mm.
    assert np.abs(grid.distance(points) - exact)[outside].max() < 4e-4
    assert (grid.distance(points)[~outside] > -4e-4).all()


def test_adjacency(hand: HandModel) -> None:
    assert (hand.adjacency == hand.adjacency.T).all()
    assert hand.adjacency.diagonal().all()
    for i in range(1, hand.links):
        assert hand.adjacency[i, hand.parents[i]]
    index = hand.link_names.index
    assert not hand.adjacency[index("rh_thdistal"), index("rh_ffdistal")]
    assert not hand.adjacency[index("rh_thdistal"), index("rh_palm")]
    assert not hand.adjacency[index("rh_ffmiddle"), index("rh_mfmiddle")]


def test_save_and_load(hand: HandModel, tmp_path: Path) -> None:
    hand.save(tmp_path / "hand.npz")
    again = HandModel.load(tmp_path / "hand.npz")
    assert again.link_names == hand.link_names
    assert again.dof_names == hand.dof_names
    assert again.name == "shadow"
    assert np.array_equal(again.inner_points, hand.inner_points)
    assert np.array_equal(again.adjacency, hand.adjacency)
    assert np.array_equal(again.link_grids[3].values, hand.link_grids[3].values)
    assert np.array_equal(again.link_faces[3], hand.link_faces[3])


def test_a_file_that_is_no_hand_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "hand.npz"
    path.write_bytes(b"nothing")
    with pytest.raises(DmfcError, match="not a hand model"):
        HandModel.load(path)
    np.savez(path, version=np.array(99), link_names=np.array(["a"]))
    with pytest.raises(DmfcError, match="version is 99"):
        HandModel.load(path)
    with pytest.raises(DmfcError, match="not a hand model"):
        HandModel.load(tmp_path / "absent.npz")
