"""`ObjectModel`: everything that is computed once per object, and its file.

One compressed `.npz` per object. Needs NumPy alone, so that training can read it anywhere.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from dmfc.errors import DmfcError
from dmfc.files.atomic import written_whole
from dmfc.geometry.grid import Grid

VERSION = 1
MAX_DROP = 0.001
"""Metres that an object may fall when a simulation begins."""
SDF_QUANTUM = 1e-5
"""Metres; the file keeps signed distances as int16 multiples of it (five microns of error)."""


@dataclass(frozen=True)
class ObjectModel:
    """One prepared object. Object frame: that of its mesh file, metres."""

    id: str
    vertices: np.ndarray
    """[V, 3] float64, the repaired mesh."""
    faces: np.ndarray
    """[F, 3] int32, wound so that normals point outwards."""
    watertight: bool
    mass: float
    """kg."""
    com: np.ndarray
    """[3] centre of mass, object frame."""
    inertia: np.ndarray
    """[3, 3] kg m^2 about the centre of mass, object axes."""
    convex_parts: list[np.ndarray]
    """Each [n, 3] float64: the vertices of a convex hull; their union stands for the object."""
    sdf: Grid
    """Signed distance, positive inside."""
    surface_points: np.ndarray
    """[P, 3] float32, spread evenly over the surface."""
    surface_normals: np.ndarray
    """[P, 3] float32, outward, unit length."""
    stable_rotations: np.ndarray
    """[k, 3, 3] R_world_object of quasi-stable poses, most probable first; the one of its class
    that turns the object least."""
    stable_heights: np.ndarray
    """[k] z of the object's origin at which the object rests on z = 0."""
    stable_probabilities: np.ndarray
    """[k], sum 1."""
    standard_pose: int
    """Index of the stable pose that is closest to the mesh's own upright frame."""
    source: str
    licence: str
    mesh_sha256: str
    """Of the repaired mesh's vertices and faces."""
    notes: list[str]
    """What the preparation had to mend or assume, for people."""

    @cached_property
    def hull_vertices(self) -> np.ndarray:
        """[h, 3] those of `vertices` that lie on the convex hull: enough for bounds in any pose."""
        from scipy.spatial import ConvexHull

        return np.asarray(self.vertices[ConvexHull(self.vertices).vertices])

    @cached_property
    def rest_heights(self) -> np.ndarray:
        """[k] z of the object's origin when it is put down in a stable pose.

        `stable_heights`, by which the mesh stands on the table; but where the convex parts, on
        which a simulator rests it, would hang more than `MAX_DROP` above it, it is put lower.
        """
        support = np.concatenate(self.convex_parts)
        lowest = (support @ self.stable_rotations[:, 2].T).min(0)
        drop = lowest + self.stable_heights
        return self.stable_heights - np.maximum(0.0, drop - MAX_DROP)

    @property
    def extents(self) -> np.ndarray:
        """[3] sides of the bounding box in the object frame, metres."""
        return self.vertices.max(axis=0) - self.vertices.min(axis=0)

    def save(self, path: Path) -> None:
        """Write the file at once: it is there complete, or not at all."""
        sizes = np.array([len(part) for part in self.convex_parts], dtype=np.int32)
        header = {
            "version": VERSION,
            "id": self.id,
            "watertight": self.watertight,
            "mass": self.mass,
            "standard_pose": self.standard_pose,
            "source": self.source,
            "licence": self.licence,
            "mesh_sha256": self.mesh_sha256,
            "notes": self.notes,
        }
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as temporary, temporary.open("wb") as out:
            np.savez_compressed(
                out,
                header=np.array(json.dumps(header)),
                vertices=self.vertices,
                faces=self.faces,
                com=self.com,
                inertia=self.inertia,
                part_vertices=np.concatenate(self.convex_parts),
                part_sizes=sizes,
                sdf_values=_quantised(self.sdf.values),
                sdf_origin=self.sdf.origin,
                sdf_spacing=np.array(self.sdf.spacing),
                surface_points=self.surface_points,
                surface_normals=self.surface_normals,
                stable_rotations=self.stable_rotations,
                stable_heights=self.stable_heights,
                stable_probabilities=self.stable_probabilities,
            )

    @classmethod
    def load(cls, path: Path) -> ObjectModel:
        """Read what `save` wrote. Raises DmfcError if the file is missing, damaged or of another
        version."""
        try:
            with np.load(path, allow_pickle=False) as arrays:
                data = {name: arrays[name] for name in arrays.files}
            header = json.loads(str(data.pop("header")))
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise DmfcError(f"prepared object {path} cannot be read: {error}") from error
        if header.pop("version") != VERSION:
            raise DmfcError(f"prepared object {path} is of another version; prepare it again")
        ends = np.cumsum(data.pop("part_sizes"))[:-1]
        parts = np.split(data.pop("part_vertices"), ends)
        values = data.pop("sdf_values").astype(np.float32) * np.float32(SDF_QUANTUM)
        sdf = Grid(values, data.pop("sdf_origin"), float(data.pop("sdf_spacing")))
        return cls(convex_parts=parts, sdf=sdf, **data, **header)


def _quantised(values: np.ndarray) -> np.ndarray:
    limit = np.iinfo(np.int16).max
    return np.clip(np.rint(values / SDF_QUANTUM), -limit, limit).astype(np.int16)
