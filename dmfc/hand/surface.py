"""The surface of one link: exact signed distance, samples and ray hits of its collision geometry.

A link is a union of convex shapes in its own frame. As MuJoCo does, a mesh counts as its convex
hull. Signed distance is positive inside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import igl
import mujoco
import numpy as np
import trimesh

from dmfc.errors import DmfcError

Distance = Callable[[np.ndarray], np.ndarray]

CLEARANCE = 1e-4
"""Metres; where such a step outwards meets another shape of the link, no outer surface is."""


@dataclass(frozen=True)
class Shape:
    """A convex shape placed in its link's frame."""

    distance_local: Distance
    """Signed distance in the shape's own frame, [n, 3] -> [n]."""
    mesh: trimesh.Trimesh
    """Its tessellation, shape frame."""
    rotation: np.ndarray
    position: np.ndarray

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance of points [n, 3] in the link frame, [n]."""
        return self.distance_local((points - self.position) @ self.rotation)

    @property
    def vertices(self) -> np.ndarray:
        return self.mesh.vertices @ self.rotation.T + self.position


@dataclass(frozen=True)
class LinkSurface:
    """The union of a link's collision shapes, link frame; it may be empty."""

    shapes: list[Shape] = field(default_factory=list)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [n, 3] -> [n]: exact outside; inside, to the deepest shape's surface.

        Raises ValueError if the link has no collision shape.
        """
        return np.max([shape.distance(points) for shape in self.shapes], axis=0)

    def normals(self, points: np.ndarray, step: float = 1e-5) -> np.ndarray:
        """Outward unit normals at points [n, 3] on or near the surface, by central differences."""
        offsets = step * np.eye(3)
        ahead = np.stack([self.distance(points + offset) for offset in offsets], axis=1)
        behind = np.stack([self.distance(points - offset) for offset in offsets], axis=1)
        normals = behind - ahead
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the tessellations, [3] each."""
        vertices = np.concatenate([shape.vertices for shape in self.shapes])
        return vertices.min(axis=0), vertices.max(axis=0)

    def sample(self, density: float, seed: int) -> np.ndarray:
        """Points uniform on the outer surface, about `density` per square metre, [n, 3].

        Points inside another shape of the link, or between two that touch, are dropped.
        """
        kept = [np.empty((0, 3))]
        for i, shape in enumerate(self.shapes):
            count = max(round(density * shape.mesh.area), 1)
            points, faces = trimesh.sample.sample_surface(shape.mesh, count, seed=seed + i)
            # The tessellation of a round shape lies inside it: push its samples out to the surface.
            points += shape.distance_local(points)[:, None] * shape.mesh.face_normals[faces]
            outward = shape.mesh.face_normals[faces] @ shape.rotation.T
            points = points @ shape.rotation.T + shape.position
            kept.append(points[self.distance(points + CLEARANCE * outward) < 0])
        return np.concatenate(kept)

    def hit(self, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The last point of the ray start + t direction (both [3]) that is on the surface, [3].

        Sphere tracing backwards along the ray, from beyond the link. Raises DmfcError at a miss.
        """
        direction = direction / np.linalg.norm(direction)
        lower, upper = self.bounds
        reach = float(np.linalg.norm(upper - lower) + np.linalg.norm(start - (lower + upper) / 2))
        while reach > 0:
            point = start + reach * direction
            gap = -float(self.distance(point[None])[0])
            if gap < 1e-9:
                return point
            reach -= gap
        raise DmfcError(f"the ray from {start.tolist()} along {direction.tolist()} misses the link")


def link_surfaces(model: mujoco.MjModel) -> list[LinkSurface]:
    """The collision surfaces of bodies 1, 2, ... of a compiled model, in that order."""
    surfaces = [LinkSurface([]) for _ in range(1, model.nbody)]
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if body > 0 and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            surfaces[body - 1].shapes.append(_shape(model, geom))
    return surfaces


def visual_mesh(model: mujoco.MjModel, body: int, surface: LinkSurface) -> trimesh.Trimesh:
    """What a picture shows of a body: its visual meshes, or else its collision shapes."""
    geoms = [
        g
        for g in range(model.ngeom)
        if model.geom_bodyid[g] == body
        and model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
        and not (model.geom_contype[g] or model.geom_conaffinity[g])
    ]
    meshes = []
    for geom in geoms:
        vertices, faces = _mesh_arrays(model, int(model.geom_dataid[geom]))
        rotation, position = _geom_pose(model, geom)
        meshes.append(trimesh.Trimesh(vertices @ rotation.T + position, faces, process=False))
    if not meshes:
        meshes = [trimesh.Trimesh(s.vertices, s.mesh.faces, process=False) for s in surface.shapes]
    merged = trimesh.util.concatenate(meshes) if meshes else trimesh.Trimesh()
    assert isinstance(merged, trimesh.Trimesh)
    return merged


def _shape(model: mujoco.MjModel, geom: int) -> Shape:
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom].copy()
    rotation, position = _geom_pose(model, geom)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        mesh = trimesh.creation.icosphere(subdivisions=4, radius=size[0])
        distance = _capsule(size[0], 0.0)
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        mesh = trimesh.creation.capsule(height=2 * size[1], radius=size[0], count=[48, 48])
        distance = _capsule(size[0], size[1])
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        mesh = trimesh.creation.cylinder(height=2 * size[1], radius=size[0], sections=96)
        distance = _cylinder(size[0], size[1])
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        mesh = trimesh.creation.box(extents=2 * size)
        distance = _box(size)
    elif kind == mujoco.mjtGeom.mjGEOM_MESH:
        vertices, _ = _mesh_arrays(model, int(model.geom_dataid[geom]))
        mesh = trimesh.convex.convex_hull(vertices)
        distance = _hull(mesh)
    else:
        body = model.body(int(model.geom_bodyid[geom])).name
        raise DmfcError(f"collision geometry of type {kind.name} on body '{body}' is not supported")
    return Shape(distance, mesh, rotation, position)


def _geom_pose(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
    return matrix.reshape(3, 3), model.geom_pos[geom].copy()


def _mesh_arrays(model: mujoco.MjModel, mesh: int) -> tuple[np.ndarray, np.ndarray]:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertices = model.mesh_vert[first : first + count].astype(np.float64)
    return vertices, model.mesh_face[face : face + faces].astype(np.int64)


def _capsule(radius: float, half_length: float) -> Distance:
    def distance(points: np.ndarray) -> np.ndarray:
        axis = np.clip(points[:, 2], -half_length, half_length)
        gap = np.column_stack([points[:, :2], points[:, 2] - axis])
        return radius - np.linalg.norm(gap, axis=1)

    return distance


def _cylinder(radius: float, half_length: float) -> Distance:
    def distance(points: np.ndarray) -> np.ndarray:
        radial = np.linalg.norm(points[:, :2], axis=1) - radius
        return _from_excess(np.column_stack([radial, np.abs(points[:, 2]) - half_length]))

    return distance


def _box(half: np.ndarray) -> Distance:
    return lambda points: _from_excess(np.abs(points) - half)


def _from_excess(excess: np.ndarray) -> np.ndarray:
    """Signed distance of a product of intervals from how far each coordinate exceeds its own."""
    outside = np.linalg.norm(np.maximum(excess, 0.0), axis=1)
    return -outside - np.minimum(excess.max(axis=1), 0.0)


def _hull(mesh: trimesh.Trimesh) -> Distance:
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64)
    pseudonormal = igl.SignedDistanceType.SIGNED_DISTANCE_TYPE_PSEUDONORMAL

    def distance(points: np.ndarray) -> np.ndarray:
        return -igl.signed_distance(np.ascontiguousarray(points), vertices, faces, pseudonormal)[0]

    return distance
