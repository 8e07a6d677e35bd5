"""Tables are found where there is one, and objects are not taken for tables."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from dmfc.prediction.table_plane import THICKNESS, find_table
from tests.support import clouds

Z = np.array([0.0, 0, 1])


def plate() -> trimesh.Trimesh:
    """A rim about a flat middle, which holds most of what is seen."""
    profile = [(0, 0), (0.08, 0), (0.12, 0.02), (0.12, 0.025), (0.078, 0.006), (0, 0.006)]
    return trimesh.creation.revolve(profile, sections=40)


OBJECTS = {
    "box": clouds.box(),
    "flat box": clouds.box((0.2, 0.15, 0.03)),
    "tall box": clouds.box((0.06, 0.06, 0.25)),
    "plate": plate(),
    "ball": clouds.standing(trimesh.creation.icosphere(radius=0.05)),
    "can": clouds.standing(trimesh.creation.cylinder(radius=0.05, height=0.14)),
    "two boxes": trimesh.util.concatenate(
        [clouds.box(), clouds.box((0.15, 0.1, 0.02)).apply_translation([0.2, 0, 0])]
    ),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_alone_is_no_table(name):
    for noise in (0.0, 0.001):
        assert find_table(clouds.cloud(OBJECTS[name], noise), Z) is None


@pytest.mark.parametrize("name", OBJECTS)
def test_a_table_is_found_and_its_points_with_it(name):
    scene = trimesh.util.concatenate([OBJECTS[name], clouds.TABLE])
    for noise in (0.0, 0.001):
        points = clouds.cloud(scene, noise, stride=5)
        found = find_table(points, Z)
        assert found is not None
        assert found[points[:, 2] < THICKNESS - 4 * noise].mean() > 0.98
        assert not found[points[:, 2] > THICKNESS + 4 * noise].any()


def test_any_direction_may_be_up():
    points = clouds.cloud(clouds.box_on_table(), stride=5)
    turn = Rotation.from_rotvec([1.0, 0.4, -0.7]).as_matrix()
    moved = points @ turn.T + [0.3, -0.2, 1.0]
    found = find_table(moved, turn @ Z)
    assert found is not None
    assert (found != find_table(points, Z)).mean() < 0.001
    assert find_table(moved, turn @ [1.0, 0, 0]) is None


def test_a_table_with_nothing_on_it_is_one():
    assert find_table(clouds.cloud(clouds.TABLE, stride=5), Z).all()
