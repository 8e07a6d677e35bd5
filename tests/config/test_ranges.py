"""Every setting has its range, and no value outside of it passes."""

from __future__ import annotations

import math
import typing
from collections.abc import Iterator
from typing import Any

import pytest

from dmfc.config.load import all_keys, checked, load_config, value_of
from dmfc.config.ranges import all_fields, all_types
from dmfc.config.schema import Config
from dmfc.errors import DmfcError

KEYS = [key for key, group in all_keys().items() if group is None]


def is_number(key: str) -> bool:
    kind = all_types()[key]
    named = any(name in str(kind) for name in ("int", "float"))
    return named and typing.get_origin(kind) is not typing.Literal


NUMBERS = [key for key in KEYS if is_number(key)]
VALUES = [
    "nan", "inf", "-inf", "-1", "0", "1", "0.5", "1.0e21", "-1.0e21", "1" + "0" * 400,
    "text", "null", "true", "[]", "[[1]]", "{a: 1}",
]  # fmt: skip
MAY_BE_NEGATIVE = {
    "grasps.palm_shift",
    "grasps.palm_gap",
    "grasps.seat_gap",
    "grasps.clearance",
    "scenes.cameras.target_height",
    "scenes.approach_tolerance",
    "network.offset_ahead",
    "losses.custom",
}


def outcome(key: str, text: str) -> Any:
    """The value that a setting takes, or the error."""
    try:
        return value_of(load_config(None, [f"{key}={text}"]), key)
    except DmfcError as error:
        return error


def numbers_in(value: Any) -> Iterator[float]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from numbers_in(item)
    elif isinstance(value, int | float):
        yield value


def negative_allowed(key: str) -> bool:
    return (
        key in MAY_BE_NEGATIVE
        or key.endswith(".sensor.mask")
        or (key.endswith(".retries") and key != "run.retries")
    )


def test_every_number_has_a_finite_range_and_its_default_lies_in_it() -> None:
    assert len(NUMBERS) > 200
    for key in NUMBERS:
        least, greatest = (all_fields()[key].metadata[end] for end in ("least", "greatest"))
        assert least is not None, key
        assert greatest is not None, key
        assert -math.inf < least < greatest < math.inf, key
        assert (least < 0) == negative_allowed(key), key
        for number in numbers_in(value_of(Config(), key)):
            assert least <= number <= greatest, key


@pytest.mark.parametrize("text", VALUES)
def test_no_value_outside_its_range_passes_and_each_is_named(text: str) -> None:
    for key in KEYS:
        got = outcome(key, text)
        if isinstance(got, DmfcError):
            told = str(got).replace(f"--set {key}={text}", "")
            assert key in told, (key, text, told)
            assert "\n" not in told
            continue
        fits = typing.get_type_hints(_owner(key))[key.rpartition(".")[2]]
        assert isinstance(got, typing.get_origin(fits) or fits) or got in typing.get_args(fits)
        for number in numbers_in(got):
            assert math.isfinite(number), (key, text)
            assert abs(number) < 1e10, (key, text)
            assert number >= 0 or negative_allowed(key), (key, text)


def _owner(key: str) -> type:
    owner = all_keys()[key.rpartition(".")[0]] if "." in key else Config
    assert owner is not None
    return owner


@pytest.mark.parametrize(
    ("setting", "wanted"),
    [
        ("training.batch_size=0", "training.batch_size must be from 1 to 4096, not 0"),
        ("physics.timestep=0", "physics.timestep must be from 1e-05 to 0.02 s, not 0"),
        ("physics.timestep=nan", "physics.timestep must be a finite number, not nan"),
        ("execution.hold_time=-1", "execution.hold_time must be from 0 to 600 s, not -1"),
        ("execution.waypoints=0", "execution.waypoints must be from 2 to 1000, not 0"),
        ("execution.min_confidence=1.5", "execution.min_confidence must be from 0 to 1, not 1.5"),
        ("execution.grasps_per_scene=1e21", "execution.grasps_per_scene"),
        ("physics.hand_friction=-1", "physics.hand_friction must be from 0 to 10, not -1"),
        ("physics.hand_weight=7", "physics.hand_weight must be true or false, not 7"),
        ("network.radii=[0.02, inf, 0.08]", "network.radii must be a finite number, not inf"),
        ("grasps.palm_gap=[0.01]", "grasps.palm_gap must have 2 entries, not 1"),
        ("grasps.palm_gap=[0.03, 0.0]", "grasps.palm_gap must be [least, greatest]"),
        ("losses.custom={a.py:b: nan}", "losses.custom must be a finite number"),
        ("scenes.train.max_objects=2", "scenes.train.min_objects (3) must not be above"),
        ("scenes.points=256", "network.levels begins with 512 seed points"),
    ],
)
def test_what_a_user_reads(setting: str, wanted: str) -> None:
    with pytest.raises(DmfcError) as caught:
        load_config("quick", [setting])
    assert wanted in str(caught.value)


def test_the_overlay_that_is_wrong_is_named() -> None:
    with pytest.raises(DmfcError, match=r"^there: training.batch_size must be"):
        checked({"training": {"seed": 1, "batch_size": 0}}, "there")
