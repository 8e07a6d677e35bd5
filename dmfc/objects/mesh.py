"""Meshes: repairs them, and refuses those that cannot be an object."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import igl
import manifold3d
import numpy as np
import trimesh

from dmfc.errors import DmfcError

MIN_EXTENT = 0.005
MAX_EXTENT = 1.0
"""Metres; an object whose longest side is outside is taken for a file in another unit."""
_SLIVER = 1e-6
"""Share of all volume below which the winding of a body does not matter."""


@dataclass(frozen=True)
class CleanMesh:
    """A repaired mesh, wound so that normals point outwards."""

    vertices: np.ndarray
    """[V, 3] float64, metres."""
    faces: np.ndarray
    """[F, 3] int32."""
    closed: bool
    """Every edge is crossed as often in one direction as in the other: the mesh bounds a volume.
    Edges where more than two faces meet are allowed."""
    watertight: bool
    """Closed, and two faces at each edge."""
    notes: list[str] = field(default_factory=list)

    @property
    def trimesh(self) -> trimesh.Trimesh:
        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    @property
    def sha256(self) -> str:
        digest = hashlib.sha256(np.ascontiguousarray(self.vertices, dtype="<f8").tobytes())
        digest.update(np.ascontiguousarray(self.faces, dtype="<i4").tobytes())
        return digest.hexdigest()


def clean(mesh: trimesh.Trimesh, name: str) -> CleanMesh:
    """Merge vertices, drop degenerate and doubled faces, fix winding, fill holes, turn bodies that
    are inside out, unite overlapping ones.

    Raises DmfcError, with `name`, for a mesh that is empty, not finite, without volume, or of an
    impossible size.
    """
    notes: list[str] = []
    if mesh.vertices.shape[1:] != (3,):
        raise DmfcError(f"object '{name}': its mesh has vertices without all three coordinates")
    if len(mesh.faces) == 0 or not np.isfinite(mesh.vertices[mesh.faces]).all():
        raise DmfcError(f"object '{name}': its mesh is empty or has vertices that are not finite")
    longest = float(np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0).max())
    if not MIN_EXTENT <= longest <= MAX_EXTENT:
        raise DmfcError(
            f"object '{name}': its longest side is {longest:.4g} m; is the file in another unit? "
            "(objects are 5 mm to 1 m; a folder takes ?unit=mm)"
        )
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    _drop_degenerate(mesh)
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) < 4:
        raise DmfcError(f"object '{name}': its mesh has no volume (fewer than four proper faces)")
    _drop_doubled(mesh, notes)
    if not mesh.is_winding_consistent and not _closed(mesh.faces):
        trimesh.repair.fix_winding(mesh)
        notes.append("winding repaired")
    if not _closed(mesh.faces):
        trimesh.repair.fill_holes(mesh)
        notes.append("holes filled" if _closed(mesh.faces) else "mesh is open")
    closed = _closed(mesh.faces)
    _turn_bodies(mesh, notes)
    if closed:
        mesh = _united(mesh, notes)
    if _volume(mesh) < 0:
        mesh.invert()
        notes.append("turned inside out")
    _require_volume(mesh, name)
    return CleanMesh(
        vertices=np.asarray(mesh.vertices, dtype=np.float64),
        faces=np.asarray(mesh.faces, dtype=np.int32),
        closed=closed,
        watertight=bool(mesh.is_watertight),
        notes=notes,
    )


def to_manifold(mesh: trimesh.Trimesh) -> manifold3d.Manifold | None:
    """The solid that a closed mesh bounds, or None if it is not one."""
    solid = manifold3d.Manifold(
        manifold3d.Mesh(
            np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.uint32)
        )
    )
    return solid if solid.status() == manifold3d.Error.NoError and solid.volume() > 0 else None


def from_manifold(solid: manifold3d.Manifold) -> tuple[np.ndarray, np.ndarray]:
    """(vertices [V, 3] float64, faces [F, 3] int32) of a solid."""
    mesh = solid.to_mesh()
    vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return vertices, np.asarray(mesh.tri_verts, dtype=np.int32)


def _united(mesh: trimesh.Trimesh, notes: list[str]) -> trimesh.Trimesh:
    """Bodies that are separate closed shells, united so that overlaps count once."""
    bodies = [body for body in mesh.split(only_watertight=False) if _closed(body.faces)]
    if len(bodies) < 2 or sum(len(body.faces) for body in bodies) != len(mesh.faces):
        return mesh
    if any(_volume(body) <= 0 for body in bodies):
        return mesh
    solids = [to_manifold(body) for body in bodies]
    proper = [solid for solid in solids if solid is not None]
    if len(proper) < len(solids):
        return mesh
    notes.append(f"{len(bodies)} bodies united")
    union = manifold3d.Manifold.batch_boolean(proper, manifold3d.OpType.Add)
    return trimesh.Trimesh(*from_manifold(union), process=False)


def _drop_degenerate(mesh: trimesh.Trimesh) -> None:
    """Drop faces without area and doubled ones; of a closed mesh only those that name a vertex
    twice, because it would not stay closed without the slivers."""
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    if not _closed(mesh.faces):
        mesh.update_faces(mesh.nondegenerate_faces(height=1e-9) & mesh.unique_faces())


def _drop_doubled(mesh: trimesh.Trimesh, notes: list[str]) -> None:
    """Keep each face once, of a mesh that is closed and stays so.

    Twice in one winding, faces count their volume twice; in both, as files have them that are to be
    seen from both sides, they cancel it.
    """
    corners = np.sort(mesh.faces, axis=1)
    _, first, face = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(corners) or not _closed(mesh.faces):
        return
    # A face is wound forwards if its corners are an even permutation of the sorted ones.
    forwards = (np.diff(mesh.faces[:, [0, 1, 2, 0]], axis=1) > 0).sum(axis=1) == 2
    ways = np.stack([np.bincount(face, way, len(first)) for way in (forwards, ~forwards)])
    if ways.min() > 0:
        once = trimesh.Trimesh(mesh.vertices, mesh.faces[np.sort(first)], process=False)
        trimesh.repair.fix_winding(once)
        note = "faces in both windings: each kept once"
    else:
        _, first = np.unique(np.column_stack([face, forwards]), axis=0, return_index=True)
        once = trimesh.Trimesh(mesh.vertices, mesh.faces[np.sort(first)], process=False)
        note = f"{len(corners) - len(first)} faces given twice dropped"
    if len(once.faces) < len(mesh.faces) and _closed(once.faces):
        mesh.faces = once.faces
        notes.append(note)


def _turn_bodies(mesh: trimesh.Trimesh, notes: list[str]) -> None:
    """Turn those of several bodies that are wound inside out, with what is inside them.

    A body inside another one may be wound so: it is a cavity. Bodies that all are inside out are
    left to `clean`, which turns the whole.
    """
    bodies = trimesh.graph.connected_components(
        mesh.face_adjacency, nodes=np.arange(len(mesh.faces)), min_len=1
    )
    volumes = np.array([_volume(mesh, body) for body in bodies])
    volumes[np.abs(volumes) < _SLIVER * np.abs(volumes).sum()] = 0
    if len(bodies) < 2 or (volumes >= 0).all() or (volumes <= 0).all():
        return
    faces = np.array(mesh.faces)
    inside = _within(mesh, bodies)
    wrong = [k for k, volume in enumerate(volumes) if volume < 0 and not inside[k].any()]
    for k in wrong:
        for body in [bodies[k], *(bodies[i] for i in np.flatnonzero(inside[:, k]))]:
            faces[body] = faces[body][:, ::-1]
    if wrong:
        mesh.faces = faces
        notes.append(f"{len(wrong)} of {len(bodies)} bodies turned inside out")


def _within(mesh: trimesh.Trimesh, bodies: list[np.ndarray]) -> np.ndarray:
    """[B, B]: whether body i lies inside body j."""
    points = [mesh.vertices[np.unique(mesh.faces[body])] for body in bodies]
    low, high = (np.array([f(p, axis=0) for p in points]) for f in (np.min, np.max))
    inside = np.all((low[:, None] > low) & (high[:, None] < high), axis=2)
    assert isinstance(inside, np.ndarray)
    for i, j in np.argwhere(inside):
        some = points[i][:: max(1, len(points[i]) // 16)]
        turns = igl.fast_winding_number(
            np.asarray(mesh.vertices), np.asarray(mesh.faces[bodies[j]], dtype=np.int64), some
        )
        inside[i, j] = bool((np.abs(turns) > 0.5).all())
    return inside


def _require_volume(mesh: trimesh.Trimesh, name: str) -> None:
    extents, volume = np.ptp(mesh.vertices, axis=0), _volume(mesh)
    if extents.min() < 1e-5 or volume < max(1e-4 * np.prod(extents), 1e-9):
        raise DmfcError(f"object '{name}': its mesh has no volume ({volume:.3g} m^3)")


def _volume(mesh: trimesh.Trimesh, body: np.ndarray | slice = slice(None)) -> float:
    """Signed volume of a mesh, or of some of its faces, m^3 (sum of tetrahedra to the centroid)."""
    faces = mesh.faces[body]
    centre = mesh.vertices.mean(axis=0) if isinstance(body, slice) else mesh.vertices[faces[0, 0]]
    a, b, c = np.moveaxis(mesh.vertices[faces] - centre, 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _closed(faces: np.ndarray) -> bool:
    """Whether each directed edge is matched by one in the other direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    low, high = edges.min(axis=1), edges.max(axis=1)
    _, index = np.unique(low * (int(faces.max()) + 1) + high, return_inverse=True)
    direction = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    return not np.bincount(index, weights=direction).any()
