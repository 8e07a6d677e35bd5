"""Settings of the hand."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class HandConfig:
    name: str = setting(
        "shadow", "hand description: a name in dmfc/hand/data or the path of a YAML file"
    )
    collision_points: int = setting(
        2000, "points sampled on the hand's surface for the collision loss"
    )
    link_sdf_spacing: float = setting(
        0.002, "voxel size of the links' signed-distance grids, metres"
    )
    link_sdf_margin: float = setting(0.01, "how far those grids reach beyond their link, metres")
    seed: int = setting(0, "seed of the collision points")
