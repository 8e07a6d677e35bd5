"""The input of a method for a scene: the views of its cameras, and the hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dmfc.config.scenes import CameraConfig
from dmfc.hand.model import HandModel
from dmfc.scenes.publish.digests import set_digest
from dmfc.scenes.scene_set import Scene
from dmfc.sensing.cameras import table_cameras


@dataclass(frozen=True)
class Observation:
    """A scene as its cameras see it. World frame: the table is z = 0, z points up; metres.

    `normals` and `segments` are there for a method that asks for them; which ones it asked for
    stands in its trial rows.
    """

    id: str
    """Names the scene and what is seen of it: '0003-562ba353'. Files of grasps repeat it."""
    points: np.ndarray
    """[N, 3] float32, the fused cloud of the objects; the table is left out."""
    point_camera: np.ndarray
    """[N] int64 row of `cameras` that saw the point."""
    cameras: np.ndarray
    """[C, 3] float64 where the cameras stand; empty for scenes without cameras."""
    hand: HandModel
    """Joints and their limits, kinematics, surface points, the palm's reference and normal."""
    seen_normals: np.ndarray = field(repr=False)
    """See `normals`."""
    seen_segments: np.ndarray = field(repr=False)
    """See `segments`."""
    used: set[str] = field(default_factory=set)
    """What has been asked for besides the cloud: normals, segments."""

    @property
    def normals(self) -> np.ndarray:
        """[N, 3] float32 outward unit normals of the surface that was seen."""
        self.used.add("normals")
        return self.seen_normals

    @property
    def segments(self) -> np.ndarray:
        """[N] int64: points of one object have one number, from 0 up."""
        self.used.add("segments")
        return self.seen_segments


def observe(scene: Scene, hand: HandModel, manifest: Mapping[str, Any]) -> Observation:
    """What is seen of a scene. `manifest`: that of its set, which knows the cameras."""
    cloud = set_digest([scene])["clouds"]
    cameras = manifest.get("scenes", {}).get("cameras")
    there = table_cameras(CameraConfig(**cameras)) if cameras else []
    return Observation(
        id=f"{scene.scene:04d}-{cloud}",
        points=scene.points,
        point_camera=scene.point_camera.astype(np.int64),
        cameras=np.array([camera.position for camera in there]).reshape(-1, 3),
        hand=hand,
        seen_normals=scene.normals,
        seen_segments=scene.point_object.astype(np.int64),
    )
