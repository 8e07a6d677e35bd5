"""Settings of scenes, cameras, label matching and the data loader."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import setting


@dataclass(frozen=True)
class SensorConfig:
    """Errors of the depth cameras. All zero: exact depth, from where the cameras stand."""

    noise: float = setting(0.0, "metres; standard deviation of depth, along the camera's ray")
    dropped: float = setting(0.0, "fraction of the points that are lost (others are repeated)")
    camera_shift: float = setting(
        0.0, "metres; standard deviation along each axis of where a camera is thought to be"
    )
    camera_turn: float = setting(
        0.0, "rad; standard deviation about each axis of how a camera is thought to be turned"
    )


@dataclass(frozen=True)
class SceneSetConfig:
    kind: Literal["single", "single_standard", "multi"] = setting(
        "single", "one object in random stable pose, one in standard pose, or several"
    )
    count: int = setting(1000, "number of scenes")
    min_objects: int = setting(3, "fewest objects of a multi scene")
    max_objects: int = setting(5, "most objects of a multi scene")
    seed: int = setting(0, "seed of the set; scene i depends on (seed, i) alone")
    sensor: SensorConfig = setting(
        SensorConfig, "errors of the cameras that are in the clouds of the set once and for all"
    )


@dataclass(frozen=True)
class CameraConfig:
    renderer: Literal["auto", "mujoco", "embree"] = setting("auto", "depth renderer")
    width: int = setting(480, "pixels")
    height: int = setting(360, "pixels")
    fov_y: float = setting(0.7, "vertical field of view, rad")
    distance: float = setting(0.7, "distance of each camera from what it looks at, metres")
    elevation: float = setting(0.6, "elevation of each camera above the table plane, rad")
    target_height: float = setting(0.04, "height above the table centre that all look at, metres")


@dataclass(frozen=True)
class MatchingConfig:
    """Which ground-truth grasps are attached to which object points."""

    mode: Literal["patch", "projected", "literal"] = setting(
        "patch",
        "'patch': the nearest points under the palm; 'projected': those near the palm reference "
        "projected along the palm normal; 'literal': as printed (see docs/matching.md)",
    )
    distance: float = setting(0.005, "d_t of the paper, metres; not of 'patch'")
    share: float = setting(0.1, "share of the object's points in a grasp's patch (at least one)")
    reach: float = setting(0.03, "farthest point of a patch from the palm's axis, metres")


@dataclass(frozen=True)
class AugmentationConfig(SensorConfig):
    """What the loader does to a training scene, anew in every epoch; test scenes are left alone."""

    yaw: bool = setting(True, "turn the scene about the vertical by any angle")
    shift: float = setting(0.02, "metres; the scene is moved along x and y by up to this")
    noise: float = setting(0.001, "metres; standard deviation of depth, along the camera's ray")
    dropped: float = setting(0.05, "fraction of the points that are lost (others are repeated)")
    camera_shift: float = setting(
        0.001, "metres; standard deviation along each axis of where a camera is thought to be"
    )
    camera_turn: float = setting(
        0.002, "rad; standard deviation about each axis of how a camera is thought to be turned"
    )

    @property
    def nothing(self) -> bool:
        """Whether all of it is off: then clouds and seeds are the same in every epoch."""
        errors = (self.noise, self.dropped, self.camera_shift, self.camera_turn)
        return not (self.yaw or self.shift or any(errors))


@dataclass(frozen=True)
class ScenesConfig:
    train: SceneSetConfig = setting(SceneSetConfig, "training scenes")
    test: SceneSetConfig = setting(SceneSetConfig(count=100, seed=1), "test scenes")
    cameras: CameraConfig = setting(CameraConfig, "the four depth cameras, one per side")
    points: int = setting(2048, "points of the fused cloud")
    table_size: float = setting(0.8, "side of the square table top, metres; its surface is z = 0")
    spawn_radius: float = setting(
        0.15, "object centres are placed this near to the table centre, metres (if there is room)"
    )
    place_attempts: int = setting(200, "places tried per object before a scene is given up")
    max_grasps: int = setting(256, "ground-truth grasps kept per object of a scene (best first)")
    shard_size: int = setting(25, "scenes per shard; a shard is one stage")
    clearance: float = setting(
        0.0, "penetration of the hand into table or neighbours allowed for labels, metres"
    )
    augmentation: AugmentationConfig = setting(AugmentationConfig, "augmentation in training")
