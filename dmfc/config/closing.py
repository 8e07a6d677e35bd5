"""Settings of how the fingers close; the planner, labels and execution share them."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class ClosingConfig:
    opening: float = setting(
        0.5,
        "How far the fingers are open before they close on an object.",
        unit="rad",
        least=0,
        greatest=3,
    )
    squeeze: float = setting(
        0.3,
        "How far beyond contact the fingers are commanded; this sets the grasp force.",
        unit="rad",
        least=0,
        greatest=3,
    )
