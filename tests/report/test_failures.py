"""The bars of failure reasons, read back from the picture's pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from dmfc.execution.outcome import REASONS
from dmfc.report.failures import COLOURS, HELD, draw_failures
from dmfc.report.table import CellRows, make_table


def test_bars_have_the_lengths_of_the_shares(tmp_path: Path) -> None:
    reasons = ["", "", "", "no lift", "no lift", "diverged"]
    rows = pd.DataFrame(
        {
            "scene": range(6),
            "trial": 0,
            "object": "a",
            "planned": True,
            "held": [not reason for reason in reasons],
            "reason": reasons,
        }
    )
    cell = CellRows("m", "m", 0, 8, rows)  # two rows are missing
    table = make_table([cell], id="i", name="n", title="t", preset="p")
    draw_failures(table, tmp_path / "failures.png")
    pixels = np.asarray(Image.open(tmp_path / "failures.png").convert("RGB")).astype(int)
    colours = dict(zip(REASONS, COLOURS, strict=True))
    width = {name: _widest(pixels, colour) for name, colour in [("held", HELD), *colours.items()]}
    assert width["no lift"] / width["held"] == pytest.approx(2 / 3, abs=0.02)
    assert width["diverged"] / width["held"] == pytest.approx(1 / 3, abs=0.02)
    assert width["dropped in hold"] < 5  # nothing, not even in the legend


def _widest(pixels: np.ndarray, colour: str) -> int:
    """Most pixels of a colour in one line."""
    wanted = np.round(255 * np.array(to_rgb(colour))).astype(int)
    return int((np.abs(pixels - wanted).max(axis=2) <= 2).sum(axis=1).max())
