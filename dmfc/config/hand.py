"""Settings of the hand."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class HandConfig:
    name: str = setting(
        "shadow", "hand description: a name in dmfc/hand/data or the path of a YAML file"
    )
    opening: float = setting(0.5, "rad that the fingers are open before they close on an object")
    squeeze: float = setting(0.3, "rad beyond contact to which they are commanded; sets the force")
    collision_points: int = setting(
        2000, "points sampled on the hand's surface for the collision loss"
    )
    link_sdf_spacing: float = setting(
        0.002, "voxel size of the links' signed-distance grids, metres"
    )
    link_sdf_margin: float = setting(0.01, "how far those grids reach beyond their link, metres")
    seed: int = setting(0, "seed of the collision points")
