"""A scene set as one folder, here or in an object store: a manifest that names all its files.

`manifest.json` is written last: a set is there if its manifest is. The files it names lie beside it
(`publish(..., copy=True)`: a set that can be sent anywhere) or where they were made (an index).
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dmfc.assets.packs import list_packs
from dmfc.config.scenes import MatchingConfig
from dmfc.errors import DmfcError
from dmfc.files.digest import bytes_digest, file_digest
from dmfc.files.storage import join, read_file, write_file
from dmfc.grasps.grasp_set import GraspSet
from dmfc.scenes.publish.stats import scene_stats
from dmfc.scenes.scene_set import SceneSet

VERSION = 2
KIND = "dmfc.scene_set"
MANIFEST = "manifest.json"
ENTRIES = {"shards", "grasps", "grasps_sha256", "palm_reference", "scenes", "matching"}
"""What every manifest has, as far as it is read."""


@dataclass(frozen=True)
class PublishedSet:
    """What a manifest describes; its files are read when they are asked for."""

    place: str
    """Path or URL of the folder."""
    manifest: dict[str, Any]

    @classmethod
    def open(cls, place: str) -> PublishedSet:
        """Raises DmfcError if no manifest of this version is there."""
        text = read_file(join(place, MANIFEST))
        try:
            manifest = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise DmfcError(f"{join(place, MANIFEST)} is damaged: {error}") from error
        if not isinstance(manifest, dict) or (manifest.get("kind"), manifest.get("version")) != (
            KIND,
            VERSION,
        ):
            raise DmfcError(
                f"{join(place, MANIFEST)} is no scene set of version {VERSION}: "
                "`dmfc scenes make` or `import` writes it again"
            )
        missing = ENTRIES - set(manifest)
        if missing:
            raise DmfcError(f"{join(place, MANIFEST)} is damaged: no {', '.join(sorted(missing))}")
        return cls(place, manifest)

    @cached_property
    def scenes(self) -> SceneSet:
        shards = self.manifest["shards"]
        return SceneSet.open([join(self.place, shard["file"]) for shard in shards])

    @cached_property
    def grasps(self) -> dict[str, GraspSet]:
        """By object; empty for scenes without labels."""
        files = self.manifest["grasps"]
        return {name: self._grasp_set(file) for name, file in files.items()}

    @property
    def palm_reference(self) -> np.ndarray:
        """[3], palm frame."""
        return np.array(self.manifest["palm_reference"])

    def damaged(self) -> list[str]:
        """The files whose bytes are missing, or not those that were published."""
        shards = {shard["file"]: shard["sha256"] for shard in self.manifest["shards"]}
        digests = self.manifest["grasps_sha256"]
        files = {file: digests[name] for name, file in self.manifest["grasps"].items()}
        return [file for file, sha in (shards | files).items() if not self._holds(file, sha)]

    def _holds(self, file: str, sha256: str) -> bool:
        try:
            return bytes_digest(read_file(join(self.place, file))) == sha256
        except DmfcError:
            return False

    def _grasp_set(self, file: str) -> GraspSet:
        return GraspSet.load(io.BytesIO(read_file(join(self.place, file))))


def publish(
    place: str,
    shards: Sequence[Path],
    grasps: Mapping[str, Path],
    palm_reference: np.ndarray | Sequence[float],
    matching: MatchingConfig,
    *,
    seeds: int = 512,
    copy: bool,
    made_by: Mapping[str, str],
    hand_pack: str = "",
) -> PublishedSet:
    """Write the manifest of a set of shards, and copy its files beside it if `copy`.

    `grasps`: the grasp set's file of each object. `made_by`: whatever tells code and command.
    `hand_pack`: the pack that holds the hand, if one does.
    """
    scenes = SceneSet.open(shards)
    sets = {name: GraspSet.load(path) for name, path in grasps.items()}
    manifests = scenes.manifests
    shared = {key: manifests[0].get(key) for key in ("set", "scenes", "renderer", "hand")}
    objects: dict[str, str] = {}
    for manifest in manifests:
        objects |= manifest["objects"]
    used = sorted(set(grasps) & set(objects))
    listed = _listed(place, shards, scenes, copy)
    manifest = {
        "kind": KIND,
        "version": VERSION,
        "made_by": dict(made_by),
        **shared,
        "objects": dict(sorted(objects.items())),
        "packs": packs_of(objects, hand_pack),
        "matching": vars(matching),
        "palm_reference": np.asarray(palm_reference).tolist(),
        "statistics": scene_stats(
            scenes, sets or None, np.asarray(palm_reference), matching, seeds
        ),
        "bytes": sum(shard["bytes"] for shard in listed),
        "shards": listed,
        "grasps": {name: _grasp_file(place, name, grasps[name], copy) for name in used},
        "grasps_sha256": {name: file_digest(grasps[name]) for name in used},
    }
    text = json.dumps(manifest, indent=1) + "\n"
    write_file(join(place, MANIFEST), text.encode())
    return PublishedSet(place, json.loads(text))


def packs_of(object_ids: Iterable[str], hand_pack: str = "") -> dict[str, str]:
    """SHA-256 of the packs that hand and objects come from; generated and own ones have none."""
    sources = {hand_pack, *(name.split("/")[0] for name in object_ids)}
    return {pack.name: pack.sha256 for pack in list_packs() if pack.name in sources}


def _listed(
    place: str, shards: Sequence[Path], scenes: SceneSet, copy: bool
) -> list[dict[str, Any]]:
    """What a manifest says of every shard; they are copied there or not."""
    return [
        {
            "file": _put(place, path, f"shards/{number:05d}.parquet", copy),
            "scenes": shard["numbers"],
            "bytes": path.stat().st_size,
            "sha256": file_digest(path),
        }
        for number, (path, shard) in enumerate(zip(shards, scenes.manifests, strict=True))
    ]


def _grasp_file(place: str, name: str, path: Path, copy: bool) -> str:
    return _put(place, path, f"grasps/{name.replace('/', '__')}.parquet", copy)


def _put(place: str, path: Path, name: str, copy: bool) -> str:
    """The name by which a manifest at `place` refers to a file, copied there or not."""
    if not copy:
        return os.path.relpath(path, place)
    write_file(join(place, name), path.read_bytes())
    return name
