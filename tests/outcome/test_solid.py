"""What a cloud encloses, against the shapes that it was sampled from."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from trimesh.creation import annulus, box, cylinder, icosphere

from dmfc.outcome.solid import CELL, solid_field


def seen(mesh: trimesh.Trimesh, lowest: float = -0.7, count: int = 2048) -> np.ndarray:
    """Points of a mesh on the table, but for what faces down more than `lowest`: no camera sees it.

    `lowest`: the least height of a unit normal.
    """
    points, faces = trimesh.sample.sample_surface(mesh, 3 * count, seed=0)
    points = points[mesh.face_normals[faces][:, 2] > lowest]
    return np.asarray(points[:count] - [0, 0, mesh.bounds[0, 2]])


@pytest.mark.parametrize("radius", [0.048, 0.07])
def test_depth_in_a_ball_is_the_distance_to_its_surface(radius: float) -> None:
    field = solid_field(seen(icosphere(4, radius)))
    generator = np.random.default_rng(0)
    places = generator.uniform(-1, 1, (3000, 3)) * radius * 1.3 + [0, 0, radius]
    true = radius - np.linalg.norm(places - [0, 0, radius], axis=1)
    found, _ = field(places)
    deep = true > 0.015
    assert deep.sum() > 200
    assert np.abs(found - true)[deep].mean() < CELL / 2
    assert (found[true < -CELL] == 0).mean() > 0.97


def test_a_box_is_solid_to_the_table_though_its_bottom_was_not_seen() -> None:
    field = solid_field(seen(box((0.08, 0.1, 0.06))))
    places = np.array([[0, 0, z] for z in (0.01, 0.02, 0.03)])
    found, blocked = field(places)
    # The nearest side is 4 cm away, the top 5, 4 and 3; the table hides nothing.
    assert found == pytest.approx([0.04, 0.04, 0.03], abs=0.8 * CELL)
    assert blocked == pytest.approx(1.0)


def test_the_inside_of_an_open_cup_is_free() -> None:
    cup = trimesh.util.concatenate(
        [
            annulus(0.036, 0.04, 0.08),
            cylinder(0.04, 0.004).apply_translation([0, 0, -0.038]),
        ]
    )
    field = solid_field(seen(cup, count=4000))
    inside, _ = field(np.array([[0.0, 0.0, z] for z in (0.03, 0.05, 0.07)]))
    assert inside.max() == 0


def test_nothing_is_enclosed_beyond_the_cloud_and_a_far_point_makes_wider_voxels() -> None:
    points = seen(icosphere(3, 0.05))
    field = solid_field(np.concatenate([points, [[40.0, 30.0, 20.0]]]))
    assert field.cell > CELL
    assert field.blocked.size < 10_000_000
    depth, blocked = field(np.array([[100.0, 0, 0], [0, 0, -5.0]]))
    assert depth.max() == 0
    assert blocked.max() == 0


def test_ways_are_those_of_marching_voxel_by_voxel() -> None:
    """Brute force: from each voxel, each way is walked to the end of the grid."""
    from dmfc.outcome.solid import _WAYS, blocked_ways

    voxels = np.random.default_rng(1).random((6, 7, 5)) < 0.05
    expected = np.zeros(voxels.shape, dtype=np.uint8)
    for start in np.ndindex(voxels.shape):
        for way in _WAYS:
            place = np.array(start) + way
            while np.all((place >= 0) & (place < voxels.shape)):
                if voxels[tuple(place)]:
                    expected[start] += 1
                    break
                place = place + way
    np.testing.assert_array_equal(blocked_ways(voxels, _WAYS), expected)
