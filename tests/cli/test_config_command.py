"""`dmfc config`, and what the shell completes, as real processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

DMFC = Path(sys.executable).with_name("dmfc")


def dmfc(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(DMFC), *words],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def completions(*words: str) -> list[str]:
    """What bash is offered for the last of the words."""
    typed = "\n".join(["dmfc", *words])
    count = str(len(words))
    done = dmfc(_DMFC_COMPLETE="complete_bash", COMP_WORDS=typed, COMP_CWORD=count)
    return done.stdout.split()


def test_a_setting_with_where_it_came_from() -> None:
    done = dmfc("config", "scenes.train.count", "--preset", "quick", "--preset", "literal")
    assert done.returncode == 0
    first, meaning = done.stdout.splitlines()
    assert first == "scenes.train.count = 96  (preset quick, default 1000)"
    assert meaning == "    Number of scenes. From 1 to 1000000."


def test_as_json_with_the_bounds_as_numbers() -> None:
    done = dmfc("config", "execution.hold_time", "--set", "execution.hold_time=1", "--json")
    (row,) = json.loads(done.stdout)
    assert row == {
        "key": "execution.hold_time",
        "meaning": "Hold at the resting height.",
        "unit": "s",
        "range": "from 0 to 600 s",
        "default": 2.0,
        "value": 1.0,
        "source": "--set",
        "least": 0,
        "greatest": 600,
    }


def test_nothing_differs_without_a_preset() -> None:
    assert dmfc("config", "--diff").stdout == "no setting differs from its default\n"


def test_an_unknown_key_is_one_line() -> None:
    done = dmfc("config", "scenes.trian")
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "error: unknown setting or group 'scenes.trian'; did you mean 'scenes.train'?"
    ]


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (("sweep", "run", "table1", "--preset", "m"), ["medium"]),
        (("sweep", "run", "tab"), ["table1", "table2"]),
        (("predict", "cloud.ply", "--model", "table1-p"), ["table1-pretrained"]),
        (("evaluate", "planner", "--protocol", "de"), ["default", "dexgraspbench"]),
        (("train", "--set", "training.finetune.ep"), ["training.finetune.epochs="]),
        (("train", "--set", "network.offset_to=g"), ["network.offset_to=grasp"]),
        (("config", "scenes.sh"), ["scenes.shard_size"]),
    ],
)
def test_the_shell_completes(words: tuple[str, ...], offered: list[str]) -> None:
    got = completions(*words)
    assert set(offered) <= set(got)
    assert all(name.startswith(words[-1]) for name in got)
