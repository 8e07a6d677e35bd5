"""Bodies and worlds for tests of simulation: masses and inertias that belong together."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World
from tests.support.scene_shapes import model_of


def body(name: str, mesh: trimesh.Trimesh, mass: float) -> ObjectModel:
    """A solid of even density, standing as its mesh does."""
    model = model_of(name, mesh, as_it_stands=True)
    inertia = np.array(mesh.moment_inertia) * mass / mesh.volume
    return dataclasses.replace(model, mass=mass, inertia=inertia)


def block(mass: float = 0.15, size: tuple[float, float, float] = (0.05, 0.06, 0.12)) -> ObjectModel:
    return body("block", trimesh.creation.box(size), mass)


def ball(mass: float = 0.06, radius: float = 0.033) -> ObjectModel:
    return body("ball", trimesh.creation.icosphere(subdivisions=3, radius=radius), mass)


def lopsided(mass: float = 0.3) -> ObjectModel:
    """A wedge whose centre of mass and axes of inertia are no round numbers."""
    corners = np.array([[0, 0, 0], [0.09, 0, 0], [0, 0.05, 0], [0.02, 0.01, 0.07]])
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    return body("wedge", trimesh.convex.convex_hull(corners @ turn.T), mass)


def pose(
    x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: tuple[float, float, float] = (0, 0, 0)
) -> np.ndarray:
    """[4, 4] from a position in metres and a rotation vector in rad."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    T[:3, 3] = x, y, z
    return T


def random_pose(generator: np.random.Generator, reach: float = 0.5) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=generator).as_matrix()
    T[:3, 3] = generator.uniform(-reach, reach, 3)
    return T


GRAVITY = 9.81
AWAY = pose(0.4, 0.0, 0.6)
"""Of the palm, clear of everything."""
STANDING = pose(z=0.06)
"""Of the block on the table."""


def place(world: World, poses: list[np.ndarray], palm: np.ndarray = AWAY) -> None:
    world.reset()
    world.place_palm(palm, world.hand.open_joints)
    for k, T in enumerate(poses):
        world.place_object(k, T)


def step(world: World, seconds: float) -> None:
    mujoco.mj_step(world.model, world.data, round(seconds / world.model.opt.timestep))


def angle(first: np.ndarray, second: np.ndarray) -> float:
    return float(Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).magnitude())
