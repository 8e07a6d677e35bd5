"""`HandModel`: all that is computed once about a hand, as arrays in one file. No simulator needed.

Link frames are those of the MJCF's bodies; link 0 is the palm, and T_palm_link of link 0 is the
identity. Every other link turns about one axis through its own origin, or is fixed to its parent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from dmfc.config.closing import ClosingConfig
from dmfc.errors import DmfcError
from dmfc.files.atomic import written_whole
from dmfc.geometry.grid import Grid

VERSION = 2


@dataclass(frozen=True)
class HandModel:
    """A hand of L links and D degrees of freedom. Metres and radians, float64 unless stated."""

    name: str
    dof_names: list[str]
    """[D] joint that drives each degree of freedom."""
    lower: np.ndarray
    """[D] lower limits that respect those of coupled joints, rad."""
    upper: np.ndarray
    """[D] upper limits, rad."""
    open_joints: np.ndarray
    """[D] the open hand, rad."""
    flexion: np.ndarray
    """[D] direction in joint space that closes the hand."""
    link_names: list[str]
    """[L] the palm first, parents before children."""
    parents: np.ndarray
    """[L] i64 index of the parent link, -1 for the palm."""
    T_parent_link: np.ndarray
    """[L, 4, 4] at joint angle zero; the identity for the palm."""
    joint_axis: np.ndarray
    """[L, 3] unit axis in the link frame; zeros where the link is fixed to its parent."""
    joint_dof: np.ndarray
    """[L] i64 degree of freedom that turns the link, -1 where it is fixed."""
    joint_scale: np.ndarray
    """[L] joint angle = scale * angle of the degree of freedom (couplings); 0 where fixed."""
    palm_reference: np.ndarray
    """[3] centre of the palm's inner surface, palm frame."""
    palm_normal: np.ndarray
    """[3] out of the inside of the palm, palm frame, unit length."""
    collision_link: np.ndarray
    """[P] i64 link of each collision point."""
    collision_points: np.ndarray
    """[P, 3] on the outer surface of the collision geometry, link frame."""
    inner_link: np.ndarray
    """[V] i64 link of each inner point."""
    inner_points: np.ndarray
    """[V, 3] on the inside of the hand, link frame."""
    inner_normals: np.ndarray
    """[V, 3] outward normals there, towards what is grasped, link frame, unit length."""
    adjacency: np.ndarray
    """[L, L] bool, symmetric, true diagonal: pairs that self-collision leaves out."""
    link_grids: list[Grid]
    """[L] signed distance of each link's collision geometry, link frame."""
    link_vertices: list[np.ndarray]
    """[L] visual mesh of each link, [n, 3], link frame; empty where it has none."""
    link_faces: list[np.ndarray]
    """[L] triangles of the visual meshes, [m, 3] i32."""
    closing: ClosingConfig = field(default_factory=ClosingConfig)
    """How the fingers close; not part of the file."""

    @property
    def dofs(self) -> int:
        return len(self.dof_names)

    @property
    def links(self) -> int:
        return len(self.link_names)

    def opened(self, joints: np.ndarray) -> np.ndarray:
        """The hand before it closes to `joints` [..., D], rad, within the limits."""
        return np.clip(joints - self.closing.opening * self.flexion, self.lower, self.upper)

    def squeezed(self, joints: np.ndarray) -> np.ndarray:
        """What the fingers are commanded once they touch at `joints` [..., D], rad."""
        return np.clip(joints + self.closing.squeeze * self.flexion, self.lower, self.upper)

    def thinned(self, count: int) -> HandModel:
        """The hand with about `count` of its collision points, every k-th."""
        step = max(1, len(self.collision_points) // count)
        return replace(
            self,
            collision_link=self.collision_link[::step],
            collision_points=self.collision_points[::step],
        )

    def save(self, path: Path) -> None:
        """Write everything to one .npz file, whole or not at all."""
        arrays: dict[str, np.ndarray] = {"version": np.array(VERSION)}
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name == "closing":
                continue
            if entry.name == "link_grids":
                for i, grid in enumerate(value):
                    arrays |= grid.arrays(f"link_grids_{i}")
            elif entry.name in ("link_vertices", "link_faces"):
                arrays |= {f"{entry.name}_{i}": array for i, array in enumerate(value)}
            else:
                arrays[entry.name] = np.asarray(value)
        with written_whole(Path(path)) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path, closing: ClosingConfig | None = None) -> HandModel:
        """Read what `save` wrote; the fingers close as `closing` says (None: by default).

        Raises DmfcError if the file is not that, of this version.
        """
        try:
            with np.load(path, allow_pickle=False) as arrays:
                return replace(cls._from_arrays(arrays), closing=closing or ClosingConfig())
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise DmfcError(f"{path} is not a hand model of version {VERSION}: {error}") from error

    @classmethod
    def _from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> HandModel:
        if int(arrays["version"]) != VERSION:
            raise ValueError(f"its version is {int(arrays['version'])}; make the hand again")
        links = range(len(arrays["link_names"]))
        lists = {
            "name": str(arrays["name"]),
            "dof_names": arrays["dof_names"].tolist(),
            "link_names": arrays["link_names"].tolist(),
            "link_grids": [Grid.from_arrays(arrays, f"link_grids_{i}") for i in links],
            "link_vertices": [arrays[f"link_vertices_{i}"] for i in links],
            "link_faces": [arrays[f"link_faces_{i}"] for i in links],
        }
        rest = {e.name: arrays[e.name] for e in fields(cls) if e.name not in (*lists, "closing")}
        return cls(**lists, **rest)  # type: ignore[arg-type]
