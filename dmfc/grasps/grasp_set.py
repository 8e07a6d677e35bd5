"""`GraspSet`: the verified grasps of one object, and their file.

One Parquet file per object, a row per grasp, the object, the hand and the format's version in the
schema's metadata. Positions are float32 metres, rotations unit quaternions (w x y z), angles
float32 radians.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError, one_line
from dmfc.files.atomic import written_whole
from dmfc.grasps.grasps import Grasps

VERSION = 1


@dataclass(frozen=True)
class GraspSet(Grasps):
    """n grasps of an object, in its frame, with the fingers in contact.

    All arrays become float64. Raises ValueError where they are not of the same length.
    """

    object_id: str
    hand: str
    dof_names: list[str]
    palm_hit: np.ndarray
    """[n, 3] the palm reference projected along the palm normal on the surface; NaN: it misses."""
    q1: np.ndarray
    """[n] upper bound of Q1 at the contacts of the check."""
    penetration: np.ndarray
    """[n] deepest hand-object penetration, metres."""
    robustness: np.ndarray
    """[n] fraction of perturbed repeats that held."""
    contacts: np.ndarray
    """[n] links of the hand that touch the object."""
    notes: dict[str, str] = dataclasses.field(default_factory=dict)
    """Provenance and counts of the planner, as text."""

    def __post_init__(self) -> None:
        n, dofs = len(self.position), len(self.dof_names)
        shapes = {
            "position": (n, 3),
            "rotation": (n, 3, 3),
            "joints": (n, dofs),
            "palm_hit": (n, 3),
            **dict.fromkeys(_SCALARS, (n,)),
        }
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name), dtype=np.float64).reshape(shape)
            object.__setattr__(self, name, value)

    @property
    def T_object_palm(self) -> np.ndarray:
        """[n, 4, 4]."""
        return self.T

    @classmethod
    def empty(
        cls, object_id: str, hand: str, dof_names: list[str], notes: dict[str, str] | None = None
    ) -> GraspSet:
        """No grasps at all."""
        arrays = {name: np.zeros(0) for name in _ARRAYS}
        return cls(object_id=object_id, hand=hand, dof_names=dof_names, notes=notes or {}, **arrays)

    def save(self, path: Path) -> None:
        """Write the Parquet file, whole or not at all; an existing one is replaced."""
        quaternion = _quaternions(self.rotation)
        columns = {
            "position": _vectors(self.position),
            "quaternion": _vectors(quaternion),
            "joints": _vectors(self.joints),
            "palm_hit": _vectors(self.palm_hit),
            **{name: pa.array(getattr(self, name), pa.float32()) for name in _SCALARS},
        }
        metadata = {
            "dmfc.grasp_set": str(VERSION),
            "object_id": self.object_id,
            "hand": self.hand,
            "dof_names": " ".join(self.dof_names),
            **{f"note.{key}": value for key, value in self.notes.items()},
        }
        table = pa.table(columns).replace_schema_metadata(metadata)
        with written_whole(Path(path)) as temporary:
            pq.write_table(table, temporary, compression="zstd")

    @classmethod
    def load(cls, path: Path | BinaryIO) -> GraspSet:
        """Read a file that `save` wrote. Raises DmfcError if it is missing or something else."""
        try:
            return cls._of(pq.read_table(path))
        except Exception as error:  # of a damaged file, Arrow and NumPy raise whatever they like
            raise DmfcError(f"grasp set {path}: cannot be read ({one_line(error)})") from error

    @classmethod
    def _of(cls, table: pa.Table) -> GraspSet:
        metadata = {k.decode(): v.decode() for k, v in (table.schema.metadata or {}).items()}
        if metadata.get("dmfc.grasp_set") != str(VERSION):
            found = metadata.get("dmfc.grasp_set", "none")
            raise DmfcError(f"format version {found}, expected {VERSION}")
        dof_names = metadata["dof_names"].split()
        values = {name: table[name].to_numpy() for name in _SCALARS}
        for name, width in (("position", 3), ("joints", len(dof_names)), ("palm_hit", 3)):
            values[name] = _matrix(table[name], width)
        values["rotation"] = _rotations(_matrix(table["quaternion"], 4))
        for name in ("position", "rotation", "joints"):
            if not np.isfinite(values[name]).all():
                raise DmfcError(f"{name} is not finite")
        notes = {
            key.removeprefix("note."): value
            for key, value in metadata.items()
            if key.startswith("note.")
        }
        return cls(
            object_id=metadata["object_id"],
            hand=metadata["hand"],
            dof_names=dof_names,
            notes=notes,
            **values,
        )


_SCALARS = ("q1", "penetration", "robustness", "contacts")
_ARRAYS = ("position", "rotation", "joints", "palm_hit", *_SCALARS)


def _vectors(rows: np.ndarray) -> pa.FixedSizeListArray:
    flat = pa.array(rows.astype(np.float32).ravel())
    return pa.FixedSizeListArray.from_arrays(flat, rows.shape[1])


def _matrix(column: pa.ChunkedArray, width: int) -> np.ndarray:
    flat = column.combine_chunks().flatten().to_numpy(zero_copy_only=False)
    return flat.astype(np.float64).reshape(-1, width)


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    if not len(rotation):
        return np.zeros((0, 4))
    return Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)


def _rotations(quaternion: np.ndarray) -> np.ndarray:
    if not len(quaternion):
        return np.zeros((0, 3, 3))
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
