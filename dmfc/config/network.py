"""Settings of the network."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import setting


@dataclass(frozen=True)
class NetworkConfig:
    levels: list[int] = setting(
        [512, 128, 32], "points after each set abstraction (a global one follows); the first: seeds"
    )
    radii: list[float] = setting([0.02, 0.04, 0.08], "ball radius of each set abstraction, metres")
    neighbours: list[int] = setting([32, 64, 64], "points per ball")
    abstraction: list[list[int]] = setting(
        [[64, 64, 128], [128, 128, 256], [256, 256, 512]], "layer widths of each set abstraction"
    )
    global_widths: list[int] = setting([256, 512, 1024], "layer widths of the global abstraction")
    propagation: list[list[int]] = setting(
        [[256, 256], [256, 128], [128, 128]],
        "layer widths of each feature propagation, coarsest first; a layer of `features` ends it",
    )
    features: int = setting(128, "features per seed point")
    width: int = setting(128, "hidden width of the heads")
    height_feature: bool = setting(
        False, "give each point its height above the table as input (the paper: positions only)"
    )

    offset_to: Literal["origin", "grasp"] = setting(
        "origin",
        "point of the hand that offsets lead to: the palm's origin, at the wrist, or `offset_ahead`"
        " of the palm, where the object is: then an error in rotation moves the fingers less",
    )
    offset_ahead: float = setting(
        0.04, "metres along the palm normal, from the palm's inner surface, of that point"
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
