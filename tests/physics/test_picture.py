"""Strips of frames; the frames themselves need GL and are looked at by people."""

from __future__ import annotations

import numpy as np
import pytest

from dmfc.visualization.simulation import strip


def test_a_strip_lays_frames_side_by_side() -> None:
    frames = [np.full((40, 60, 3), value, dtype=np.uint8) for value in (10, 120, 240)]
    picture = strip(frames, ["", "", ""])
    assert picture.size == (180, 40)
    assert np.array_equal(np.asarray(picture), np.concatenate(frames, axis=1))
    labelled = np.asarray(strip(frames, ["a", "b", "c"]))
    changed = (labelled != np.asarray(picture)).any(axis=(0, 2))
    assert changed[:60].any()
    assert changed[60:120].any()
    assert changed[120:].any()


def test_every_frame_needs_its_label() -> None:
    frame = np.zeros((8, 8, 3), dtype=np.uint8)
    with pytest.raises(ValueError, match="zip"):
        strip([frame, frame], ["one"])
