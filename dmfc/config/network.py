"""Settings of the network."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class NetworkConfig:
    levels: list[int] = setting([512, 128, 32], "points after each set abstraction; a global one follows")
    radii: list[float] = setting([0.02, 0.04, 0.08], "ball radius of each set abstraction, metres")
    neighbours: list[int] = setting([32, 64, 64], "points per ball")
    features: int = setting(128, "features per seed point")
    width: int = setting(128, "hidden width of the heads")
