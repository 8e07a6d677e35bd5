"""Settings of scenes, cameras, label matching and the data loader."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import setting


@dataclass(frozen=True)
class SceneSetConfig:
    kind: Literal["single", "single_standard", "multi"] = setting(
        "single", "one object in random stable pose, one in standard pose, or several"
    )
    count: int = setting(1000, "number of scenes")
    min_objects: int = setting(3, "fewest objects of a multi scene")
    max_objects: int = setting(5, "most objects of a multi scene")
    seed: int = setting(0, "seed of the set; scene i depends on (seed, i) alone")


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

    mode: Literal["projected", "literal"] = setting(
        "projected",
        "'projected': the palm reference is projected along the palm normal; 'literal': as printed",
    )
    distance: float = setting(0.005, "d_t of the paper, metres")


@dataclass(frozen=True)
class AugmentationConfig:
    """What the loader does to a training scene, anew in every epoch; test scenes are left alone."""

    yaw: bool = setting(True, "turn the scene about the vertical by any angle")
    shift: float = setting(0.02, "metres; the scene is moved along x and y by up to this")
    noise: float = setting(0.001, "metres; standard deviation of depth, along the camera's ray")
    dropped: float = setting(0.05, "fraction of the points that are lost (others are repeated)")


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
