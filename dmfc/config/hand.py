"""Settings of the hand."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import GREATEST_SEED, setting


@dataclass(frozen=True)
class HandConfig:
    name: str = setting(
        "shadow", "Description of the hand: a name in dmfc/hand/data, or the path of a YAML file."
    )
    collision_points: int = setting(
        2000,
        "Points sampled on the hand's surface for the collision loss.",
        least=10,
        greatest=100_000,
    )
    link_sdf_spacing: float = setting(
        0.002,
        "Voxel size of the signed-distance grid of each link.",
        unit="m",
        least=2e-4,
        greatest=0.05,
    )
    link_sdf_margin: float = setting(
        0.01,
        "How far these grids reach beyond their link.",
        unit="m",
        least=0,
        greatest=0.2,
    )
    seed: int = setting(0, "Seed of the collision points.", least=0, greatest=GREATEST_SEED)
