"""Settings of the network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import KEYS_VERSION, setting

WIDEST = 16_384
"""Most features of a layer."""


@dataclass(frozen=True)
class NetworkConfig:
    backbone: str = setting(
        "pointnet2",
        "What makes features of seed points from the cloud: pointnet2, dgcnn, pointnet, or "
        "file.py:Class (docs/extend.md). levels[0] is the number of seed points of each; dgcnn "
        "uses neighbours[0] and the widths of abstraction; pointnet those of abstraction[0] and "
        "global_widths.",
        later=KEYS_VERSION,
    )
    levels: list[int] = setting(
        [512, 128, 32],
        "Points left by each set abstraction; a global abstraction follows. The first number is "
        "the number of seed points, each with one predicted grasp.",
        least=1,
        greatest=16_384,
    )
    radii: list[float] = setting(
        [0.02, 0.04, 0.08],
        "Ball radius of each set abstraction.",
        unit="m",
        least=1e-4,
        greatest=10,
    )
    neighbours: list[int] = setting(
        [16, 32, 32], "Points per ball of each set abstraction.", least=1, greatest=1024
    )
    abstraction: list[list[int]] = setting(
        [[64, 64, 128], [128, 128, 256], [256, 256, 512]],
        "Layer widths of each set abstraction.",
        least=1,
        greatest=WIDEST,
    )
    global_widths: list[int] = setting(
        [256, 512, 1024], "Layer widths of the global abstraction.", least=1, greatest=WIDEST
    )
    propagation: list[list[int]] = setting(
        [[256, 256], [256, 128], [128, 128]],
        "Layer widths of each feature propagation, the coarsest first. A layer of `features` "
        "follows the last one.",
        least=1,
        greatest=WIDEST,
    )
    features: int = setting(128, "Features per seed point.", least=1, greatest=WIDEST)
    width: int = setting(128, "Hidden width of the heads.", least=1, greatest=WIDEST)
    height_feature: bool = setting(
        False,
        "Give each point its height above the table as an input. The paper uses positions alone.",
    )

    offset_to: Literal["origin", "grasp"] = setting(
        "grasp",
        "Point of the hand to which the predicted offset leads. 'origin': the palm's origin, at "
        "the wrist; 'grasp': the grasp centre, `offset_ahead` of the palm. An error in rotation "
        "displaces the fingers less with 'grasp'.",
    )
    offset_ahead: float = setting(
        0.04,
        "Distance of the grasp centre from the palm's inner surface, along the palm normal.",
        unit="m",
        least=-0.2,
        greatest=0.2,
    )

    def __post_init__(self) -> None:
        """Raises ValueError where the levels do not fit each other."""
        depth = len(self.levels)
        for name in ("radii", "neighbours", "abstraction", "propagation"):
            if len(getattr(self, name)) != depth:
                raise ValueError(
                    f"network.{name} must have {depth} entries, one per network.levels"
                )
        if (
            depth < 1
            or self.levels[-1] < 3
            or sorted(set(self.levels), reverse=True) != self.levels
        ):
            raise ValueError(
                f"network.levels must decrease and end with at least 3 points, not {self.levels}"
            )
        if not all([*self.abstraction, self.global_widths]):
            raise ValueError("network.abstraction and network.global_widths need a layer each")
