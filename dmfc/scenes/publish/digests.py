"""Digests of scene sets, by which a test set is known to be the same one elsewhere."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dmfc.scenes.scene_set import Scene

_POSE, _POINT = 1e-6, 1e-5
"""Steps in which poses (metres, entries of a rotation) and points (metres) are compared."""
PARTS = ("layouts", "clouds")


def set_digest(scenes: Iterable[Scene]) -> dict[str, str]:
    """Part -> eight hexadecimal digits per scene, in order, separated by blanks.

    'layouts' are the objects and their poses, 'clouds' the points with normals and objects. Labels
    are not part of it: they follow the grasp sets.
    """
    words: dict[str, list[str]] = {part: [] for part in PARTS}
    for scene in scenes:
        poses = np.rint(scene.T_world_object / _POSE).astype(np.int64)
        words["layouts"].append(_hash(" ".join(scene.object_ids).encode(), poses))
        points = np.rint(scene.points / _POINT).astype(np.int64)
        normals = np.rint(scene.normals * 100).astype(np.int64)
        words["clouds"].append(_hash(b"", points, normals, scene.point_object.astype(np.int64)))
    return {part: " ".join(found) for part, found in words.items()}


def differing(recorded: Mapping[str, str], found: Mapping[str, str]) -> dict[str, Sequence[int]]:
    """Part -> positions of the scenes that differ."""
    result: dict[str, Sequence[int]] = {}
    for part in PARTS:
        old, new = recorded[part].split(), found[part].split()
        longest = max(len(old), len(new))
        old, new = ([*words, *[""] * (longest - len(words))] for words in (old, new))
        result[part] = [i for i, (a, b) in enumerate(zip(old, new, strict=True)) if a != b]
    return result


def _hash(*parts: bytes | np.ndarray) -> str:
    hashed = hashlib.sha256()
    for part in parts:
        hashed.update(part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes())
    return hashed.hexdigest()[:8]
