"""`Scene`, and a set of them in Parquet shards, one row per scene.

Points are stored as 16-bit multiples of a quantum per scene (about 0.01 mm), normals as 16-bit
fractions; both are read back as float32. Grasps are references into the objects' grasp sets.
"""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dmfc.errors import DmfcError, first_line
from dmfc.files.atomic import written_whole
from dmfc.files.storage import located

VERSION = 2
_KIND = b"dmfc.scene_set"
_MANIFEST = b"dmfc.manifest"
_RANGE = 32767  # of a 16-bit integer
KEPT_BYTES = 2**30
"""Shards that a process has read are kept up to this size; the one not used for longest goes."""


@dataclass(frozen=True)
class Scene:
    """One scene: objects on the table, what the cameras see of them, and its labels."""

    scene: int
    """Number in its set."""
    object_ids: list[str]
    T_world_object: np.ndarray
    """[k, 4, 4] float64."""
    points: np.ndarray
    """[N, 3] float32, world frame, metres, in random order, free of noise."""
    normals: np.ndarray
    """[N, 3] float32, outward, unit length."""
    point_object: np.ndarray
    """[N] uint8: index into `object_ids`."""
    point_camera: np.ndarray
    """[N] uint8: index of the camera that saw the point."""
    grasp_object: np.ndarray
    """[n] uint8: index into `object_ids`."""
    grasp_index: np.ndarray
    """[n] int32: row of that object's grasp set."""
    dropped: dict[str, int]
    """Reason -> labels that were dropped."""


_SCHEMA = pa.schema(
    [
        ("scene", pa.int64()),
        ("object_ids", pa.list_(pa.string())),
        ("T_world_object", pa.list_(pa.float64())),
        ("point_origin", pa.list_(pa.float64())),
        ("point_quantum", pa.float64()),
        ("points", pa.list_(pa.int16())),
        ("normals", pa.list_(pa.int16())),
        ("point_object", pa.list_(pa.uint8())),
        ("point_camera", pa.list_(pa.uint8())),
        ("grasp_object", pa.list_(pa.uint8())),
        ("grasp_index", pa.list_(pa.int32())),
        ("dropped", pa.string()),
    ]
)


def write_shard(path: Path, scenes: Iterable[Scene], manifest: Mapping[str, Any]) -> None:
    """Write a shard with its manifest (a JSON-able mapping), whole or not at all.

    The same scenes and manifest give the same bytes. An existing file is replaced.
    """
    columns = [_row(scene) for scene in scenes]
    table = pa.Table.from_pylist(columns, schema=_SCHEMA)
    text = json.dumps(manifest, sort_keys=True)
    table = table.replace_schema_metadata({_KIND: str(VERSION), _MANIFEST: text})
    try:
        with written_whole(path) as temporary:
            pq.write_table(table, temporary, compression="zstd", use_dictionary=False)
    except OSError as error:
        raise DmfcError(f"scene shard {path} cannot be written: {error}") from error


class SceneSet(Sequence[Scene]):
    """Scenes of shards, in the order of the shards; each is read when it is asked for."""

    def __init__(self, shards: list[_Shard]) -> None:
        self._shards = shards
        self._ends = np.cumsum([shard.rows for shard in shards])
        self._kept: OrderedDict[int, int] = OrderedDict()  # shard -> bytes, longest unused first

    @classmethod
    def open(cls, paths: Iterable[str | Path]) -> SceneSet:
        """Open shards: files, or URLs of an object store (s3://, gs://, https://, ...).

        Raises DmfcError if there are none, or naming the one that is missing, damaged or of
        another version.
        """
        shards = [_Shard(str(path)) for path in paths]
        if not shards:
            raise DmfcError("a scene set needs at least one shard; none was given")
        return cls(shards)

    @property
    def manifests(self) -> list[dict[str, Any]]:
        """Of each shard, as it was written."""
        return [shard.manifest for shard in self._shards]

    def __len__(self) -> int:
        return int(self._ends[-1])

    def __getitem__(self, index):  # type: ignore[no-untyped-def,override]
        """Scene at a position (negative: from the end); a slice gives a list of scenes."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"scene {index} of {len(self)}")
        index = index % len(self)
        number = int(np.searchsorted(self._ends, index, side="right"))
        shard = self._shards[number]
        scene = shard.read(index - int(self._ends[number]) + shard.rows)
        self._kept[number] = shard.kept_bytes
        self._kept.move_to_end(number)
        while len(self._kept) > 1 and sum(self._kept.values()) > KEPT_BYTES:
            self._shards[self._kept.popitem(last=False)[0]].forget()
        return scene

    def __iter__(self) -> Iterator[Scene]:
        return (self[i] for i in range(len(self)))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_kept": OrderedDict()}


class _Shard:
    """One file: its metadata are read at once, its rows when they are asked for."""

    def __init__(self, path: str) -> None:
        self.path = path
        metadata = self._guard(lambda: self._file().metadata)
        stored = metadata.metadata or {}
        version = stored.get(_KIND, b"none").decode()
        if version != str(VERSION):
            raise DmfcError(
                f"scene shard {path}: format version {version}, expected {VERSION}; make it again"
            )
        self.rows = metadata.num_rows
        self.manifest = json.loads(stored[_MANIFEST])
        self._table: pa.Table | None = None

    def read(self, row: int) -> Scene:
        if self._table is None:
            self._table = self._guard(lambda: self._file().read())
        return _scene(self._table, row)

    @property
    def kept_bytes(self) -> int:
        return 0 if self._table is None else self._table.nbytes

    def forget(self) -> None:
        """Let go of the rows; they are read again when they are asked for."""
        self._table = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_table": None}  # a worker process reads for itself

    def _file(self) -> pq.ParquetFile:
        system, path = located(self.path)
        return pq.ParquetFile(path, filesystem=system)

    def _guard(self, read):  # type: ignore[no-untyped-def]
        try:
            return read()
        except FileNotFoundError as error:
            raise DmfcError(f"scene shard {self.path} does not exist") from error
        except (OSError, pa.ArrowException) as error:
            reason = first_line(error)
            raise DmfcError(
                f"scene shard {self.path} is damaged or cut short ({reason}); "
                "`dmfc scenes make` makes it again"
            ) from error


def _row(scene: Scene) -> dict[str, Any]:
    points = scene.points.astype(np.float64)
    low, high = points.min(0), points.max(0)
    origin = (low + high) / 2
    quantum = max(float((high - low).max()) / 2 / _RANGE, 1e-9)
    return {
        "scene": scene.scene,
        "object_ids": scene.object_ids,
        "T_world_object": scene.T_world_object.ravel(),
        "point_origin": origin,
        "point_quantum": quantum,
        "points": np.rint((points - origin) / quantum).astype(np.int16).ravel(),
        "normals": np.rint(scene.normals.astype(np.float64) * _RANGE).astype(np.int16).ravel(),
        "point_object": scene.point_object,
        "point_camera": scene.point_camera,
        "grasp_object": scene.grasp_object,
        "grasp_index": scene.grasp_index,
        "dropped": json.dumps(scene.dropped, sort_keys=True),
    }


def _scene(table: pa.Table, row: int) -> Scene:
    def array(name: str) -> np.ndarray:
        return table[name][row].values.to_numpy(zero_copy_only=False)

    integers = array("points").reshape(-1, 3).astype(np.float64)
    points = array("point_origin") + table["point_quantum"][row].as_py() * integers
    return Scene(
        scene=table["scene"][row].as_py(),
        object_ids=table["object_ids"][row].as_py(),
        T_world_object=array("T_world_object").reshape(-1, 4, 4),
        points=points.astype(np.float32),
        normals=(array("normals").reshape(-1, 3) / _RANGE).astype(np.float32),
        point_object=array("point_object"),
        point_camera=array("point_camera"),
        grasp_object=array("grasp_object"),
        grasp_index=array("grasp_index"),
        dropped=json.loads(table["dropped"][row].as_py()),
    )
