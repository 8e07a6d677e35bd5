"""Scenes from a user's clouds: a scene set without labels.

A cloud is of the objects alone, in a frame whose z axis points up from the table top at z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from dmfc.config.scenes import ScenesConfig
from dmfc.errors import DmfcError
from dmfc.geometry.points import choose
from dmfc.scenes.scene_set import Scene, write_shard
from dmfc.sensing.cameras import table_cameras
from dmfc.sensing.check_cloud import answered, check_extent, require_points
from dmfc.sensing.read_cloud import read_cloud

_NEIGHBOURS = 16
"""Points whose plane gives a normal."""
_INVERSION = 30.0
"""Radius about a camera in which a cloud is inverted, of the distance of its farthest point."""
_BELOW = 0.02
"""Metres below the table top that errors of a camera explain."""


def cloud_scene(points: np.ndarray, number: int, config: ScenesConfig, seed: int = 0) -> Scene:
    """A cloud [n, 3] as a scene of `scenes.points` points, of no known object and without labels.

    Normals are those of the planes through neighbours, turned towards the camera of
    `scenes.cameras` that sees the point best. Raises DmfcError for fewer than 16 points.
    """
    if len(points) < _NEIGHBOURS:
        raise DmfcError(f"a cloud of {len(points)} points is not a scene: at least {_NEIGHBOURS}")
    positions = np.stack([camera.position for camera in table_cameras(config.cameras)])
    chosen = points[choose(len(points), config.points, np.random.default_rng(seed))]
    near = points[cKDTree(points).query(chosen, _NEIGHBOURS)[1]]
    spread = near - near.mean(1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0]
    camera = _seen_by(chosen, normals, positions)
    away = (normals * (positions[camera] - chosen)).sum(1, keepdims=True) < 0
    none = np.zeros(0, dtype=np.int32)
    return Scene(
        scene=number,
        object_ids=[],
        T_world_object=np.zeros((0, 4, 4)),
        points=chosen.astype(np.float32),
        normals=(normals * np.where(away, -1, 1)).astype(np.float32),
        point_object=np.zeros(len(chosen), dtype=np.uint8),
        point_camera=camera.astype(np.uint8),
        grasp_object=none.astype(np.uint8),
        grasp_index=none,
        dropped={},
    )


def _seen_by(points: np.ndarray, normals: np.ndarray, cameras: np.ndarray) -> np.ndarray:
    """[n] the camera of [C, 3] that sees each point most head-on, of those that see it at all; the
    nearest if none does. Normals [n, 3] may have either sign."""
    towards = cameras - points[:, None]
    distance = np.linalg.norm(towards, axis=2)
    head_on = np.abs((towards * normals[:, None]).sum(2)) / distance
    sees = np.stack([_visible(points, camera) for camera in cameras], axis=1)
    score = np.where(sees, head_on, -distance)
    return score.argmax(1)


def _visible(points: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """[n] bool: which points no other hides (Katz et al. 2007: the hull of the inverted cloud)."""
    rays = points - camera
    length = np.linalg.norm(rays, axis=1, keepdims=True)
    inverted = rays + 2 * (_INVERSION * length.max() - length) * rays / length
    hull = ConvexHull(np.vstack([inverted, np.zeros(3)]), qhull_options="QJ")
    visible = np.zeros(len(points) + 1, dtype=bool)
    visible[hull.vertices] = True
    return visible[:-1]


def import_clouds(
    paths: Sequence[Path],
    out: Path,
    config: ScenesConfig,
    unit: str = "m",
    above: float = -np.inf,
    drop_invalid: bool = False,
) -> int:
    """Write clouds as the shard `out`, in their order; points below z = `above` are left out.

    Raises DmfcError, before anything is written, where one of them is no cloud of things on a
    table; points without an answer are refused unless they are dropped (`check_cloud`).
    """
    scenes = []
    for number, path in enumerate(paths):
        points = read_cloud(path)
        try:
            found = answered(points, unit, drop_invalid)
            found = found[found.points[:, 2] >= above]
            require_points(found, f"{len(points) - len(found.points)} were left out")
            check_extent(found.points, unit)
            _check_frame(found.points, config.table_size)
            scenes.append(cloud_scene(found.points, number, config))
        except DmfcError as error:
            raise DmfcError(f"cloud {path}: {error}") from error
    out.parent.mkdir(parents=True, exist_ok=True)
    manifest = {
        "set": {},
        "scenes": {"points": config.points, "table_size": config.table_size},
        "numbers": [0, len(scenes)],
        "renderer": None,
        "objects": {},
        "hand": "",
        "files": [path.name for path in paths],
    }
    write_shard(out, scenes, manifest)
    return len(scenes)


def _check_frame(points: np.ndarray, table_size: float) -> None:
    """Raises DmfcError for points [n, 3] that are not on the table: a wrong unit or frame."""
    beside = float(np.abs(points[:, :2]).max())
    if beside > table_size / 2:
        raise DmfcError(
            f"it reaches {beside:.3g} m from the table's centre, whose side is {table_size} m "
            "(option --unit, setting scenes.table_size)"
        )
    if points[:, 2].min() < -_BELOW:
        raise DmfcError(
            f"it reaches {-points[:, 2].min():.3g} m below the table top, which is z = 0 with z "
            "upwards (option --above leaves points out)"
        )
