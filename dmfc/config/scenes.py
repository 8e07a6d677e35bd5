"""Settings of scenes, cameras, label matching and the data loader."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import GREATEST_SEED, KEYS_VERSION, setting

NOISE = "Standard deviation of depth, along the camera's ray."
DROPPED = "Share of the points that are lost; other points are repeated in their place."
CAMERA_SHIFT = "Standard deviation of each camera's assumed position, along each axis."
CAMERA_TURN = "Standard deviation of each camera's assumed orientation, about each axis."


QUANTUM = "Step in which distance along the camera's ray is measured; 0: none."


@dataclass(frozen=True)
class PointErrorsConfig:
    """Errors of single points of a cloud. All zero: exact, from where the cameras stand."""

    noise: float = setting(0.0, NOISE, unit="m", least=0, greatest=0.1)
    dropped: float = setting(0.0, DROPPED, least=0, greatest=0.99)
    camera_shift: float = setting(0.0, CAMERA_SHIFT, unit="m", least=0, greatest=0.1)
    camera_turn: float = setting(0.0, CAMERA_TURN, unit="rad", least=0, greatest=1)
    quantum: float = setting(0.0, QUANTUM, unit="m", least=0, greatest=0.1, later=KEYS_VERSION)

    @property
    def in_points(self) -> bool:
        """Whether points of the cloud have errors of their own."""
        errors = (self.noise, self.dropped, self.camera_shift, self.camera_turn, self.quantum)
        return any(errors)


@dataclass(frozen=True)
class SensorConfig(PointErrorsConfig):
    """Errors of the depth cameras, and of the masks that cut the objects out of their images."""

    bleeding: int = setting(
        0,
        "Distance from a depth edge within which an object's pixels have a random mix of both "
        "depths; 0: edges are sharp.",
        unit="pixels",
        least=0,
        greatest=50,
        later=KEYS_VERSION,
    )
    grazing: float = setting(
        0.0,
        "Angle a between ray and surface under which points are lost, with probability 1 - angle "
        "/ a; 0: none.",
        unit="rad",
        least=0,
        greatest=1.57,
        later=KEYS_VERSION,
    )
    cameras: list[int] = setting(
        [0, 1, 2, 3],
        "The cameras that are there: 0 at the +x side of the table, then +y, -x, -y.",
        least=0,
        greatest=3,
        later=KEYS_VERSION,
    )
    crop: float = setting(
        0.0,
        "Share of each image's width and height that is cut off, half of it at each side.",
        least=0,
        greatest=0.95,
        later=KEYS_VERSION,
    )
    table: float = setting(
        0.0,
        "Share of the cloud's points that lie on the table, within 5 cm of the objects: it was "
        "not removed there.",
        least=0,
        greatest=0.9,
        later=KEYS_VERSION,
    )
    mask: int = setting(
        0,
        "Pixels by which the objects' masks are too wide, so that they take in table; negative: "
        "too narrow.",
        unit="pixels",
        least=-50,
        greatest=50,
        later=KEYS_VERSION,
    )

    @property
    def in_images(self) -> bool:
        """Whether the images, or the masks, have errors."""
        errors = (self.bleeding, self.grazing, self.crop, self.table, self.mask)
        return any(errors) or sorted(self.cameras) != [0, 1, 2, 3]


@dataclass(frozen=True)
class SceneSetConfig:
    kind: Literal["single", "single_standard", "multi"] = setting(
        "single",
        "'single': one object in a random stable pose; 'single_standard': one in its standard "
        "pose; 'multi': several objects.",
    )
    count: int = setting(1000, "Number of scenes.", least=1, greatest=1_000_000)
    min_objects: int = setting(3, "Fewest objects of a multi scene.", least=1, greatest=100)
    max_objects: int = setting(5, "Most objects of a multi scene.", least=1, greatest=100)
    seed: int = setting(
        0,
        "Seed of the set. A scene depends on this seed and on its own number alone.",
        least=0,
        greatest=GREATEST_SEED,
    )
    sensor: SensorConfig = setting(
        SensorConfig, "Errors of the cameras and masks, fixed in the clouds of the set."
    )


@dataclass(frozen=True)
class CameraConfig:
    renderer: Literal["auto", "mujoco", "embree"] = setting("auto", "Renderer of depth images.")
    width: int = setting(480, "Width of an image.", unit="pixels", least=8, greatest=8192)
    height: int = setting(360, "Height of an image.", unit="pixels", least=8, greatest=8192)
    fov_y: float = setting(0.7, "Vertical field of view.", unit="rad", least=0.05, greatest=2.8)
    distance: float = setting(
        0.7,
        "Distance of each camera from the point that it looks at.",
        unit="m",
        least=0.05,
        greatest=10,
    )
    elevation: float = setting(
        0.6,
        "Elevation of each camera above the table plane.",
        unit="rad",
        least=0.01,
        greatest=1.57,
    )
    target_height: float = setting(
        0.04,
        "Height above the table's centre of the point that all cameras look at.",
        unit="m",
        least=-1,
        greatest=2,
    )


@dataclass(frozen=True)
class MatchingConfig:
    """Which ground-truth grasps are attached to which object points."""

    mode: Literal["patch", "projected", "literal"] = setting(
        "patch",
        "Points that get a grasp as their label. 'patch': the nearest points under the palm; "
        "'projected': points near the palm reference, projected along the palm normal; 'literal': "
        "as the paper prints it (see docs/matching.md).",
    )
    distance: float = setting(
        0.005,
        "Greatest distance of a point from the palm reference, the paper's d_t. Not used by "
        "'patch'.",
        unit="m",
        least=0,
        greatest=1,
    )
    share: float = setting(
        0.1,
        "Share of the object's points in a grasp's patch, at least one point.",
        least=0,
        greatest=1,
    )
    reach: float = setting(
        0.03,
        "Greatest distance of a patch's points from the palm's axis.",
        unit="m",
        least=0,
        greatest=1,
    )


@dataclass(frozen=True)
class AugmentationConfig(PointErrorsConfig):
    """Random changes of a training scene in every epoch; test scenes are not changed."""

    yaw: bool = setting(True, "Turn the scene about the vertical by a random angle.")
    shift: float = setting(
        0.02,
        "Move the scene along x and y by a random distance up to this.",
        unit="m",
        least=0,
        greatest=0.5,
    )
    noise: float = setting(0.001, NOISE, unit="m", least=0, greatest=0.1)
    dropped: float = setting(0.05, DROPPED, least=0, greatest=0.99)
    camera_shift: float = setting(0.0, CAMERA_SHIFT, unit="m", least=0, greatest=0.1)
    camera_turn: float = setting(0.0, CAMERA_TURN, unit="rad", least=0, greatest=1)

    @property
    def nothing(self) -> bool:
        """Whether all of it is off: then clouds and seeds are the same in every epoch."""
        return not (self.yaw or self.shift or self.in_points)


@dataclass(frozen=True)
class ScenesConfig:
    train: SceneSetConfig = setting(SceneSetConfig, "Training scenes.")
    test: SceneSetConfig = setting(SceneSetConfig(count=100, seed=1), "Test scenes.")
    cameras: CameraConfig = setting(CameraConfig, "The four depth cameras, one per side.")
    points: int = setting(2048, "Points of the fused cloud.", least=128, greatest=1_000_000)
    table_size: float = setting(
        0.8,
        "Side of the square table top. Its surface is z = 0.",
        unit="m",
        least=0.05,
        greatest=10,
    )
    spawn_radius: float = setting(
        0.15,
        "Object centres are placed within this distance of the table's centre, if there is room.",
        unit="m",
        least=0,
        greatest=5,
    )
    place_attempts: int = setting(
        200,
        "Places tried for an object before a scene is given up.",
        least=1,
        greatest=100_000,
    )
    max_grasps: int = setting(
        256,
        "Most ground-truth grasps per object of a scene, the most robust first.",
        least=1,
        greatest=100_000,
    )
    shard_size: int = setting(
        25, "Scenes per shard. A shard is one stage.", least=1, greatest=100_000
    )
    approach_tolerance: float = setting(
        0.0,
        "Penetration of the open or closed hand into table or neighbours that labels may have.",
        unit="m",
        least=-0.1,
        greatest=0.1,
        formerly="clearance",
    )
    augmentation: AugmentationConfig = setting(
        AugmentationConfig, "Augmentation of training scenes."
    )
