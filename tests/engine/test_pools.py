"""Ray that does not start: tried again, then said on one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dmfc.config.sweep import RunConfig
from dmfc.engine.ray_cluster import KEEP_MEMORY, LOOPBACK, START_TRIES, start_ray
from dmfc.errors import DmfcError

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def starts(monkeypatch):
    """Ray that fails to start so many times; counts the attempts."""
    import ray

    for name in ("RAY_AUTH_TOKEN", "RAY_AUTH_MODE", *LOOPBACK, *KEEP_MEMORY):
        monkeypatch.setenv(name, os.environ.get(name, "1"))  # set back at the end
    attempts: list[dict] = []

    def fail(times: int) -> list[dict]:
        def init(**options):
            attempts.append(options)
            if len(attempts) <= times:
                raise Exception("The current node timed out during startup.\nMore of it.")

        monkeypatch.setattr(ray, "init", init)
        monkeypatch.setattr(ray, "shutdown", lambda: None)  # other tests have a Ray here
        return attempts

    return fail


@pytest.mark.parametrize("failures", [1, START_TRIES - 1])
def test_another_attempt_is_made(starts, failures):
    attempts = starts(failures)
    start_ray(RunConfig(cpus=1))
    assert [options["num_cpus"] for options in attempts] == [1] * (failures + 1)


@pytest.mark.parametrize(
    ("address", "part"),
    [("", "Ray did not start on this machine"), ("10.0.0.1:6379", "no Ray cluster answers")],
)
def test_no_ray_is_one_line_that_names_the_setting(starts, address, part):
    attempts = starts(START_TRIES)
    with pytest.raises(DmfcError, match=r"run\.ray_address") as caught:
        start_ray(RunConfig(ray_address=address))
    assert len(attempts) == START_TRIES
    assert part in str(caught.value)
    assert "timed out during startup" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_long_tmpdir_is_named(tmp_path):
    """The message is Ray's own, of a real start."""
    folder = tmp_path / ("long" * 25)
    folder.mkdir()
    code = """
from dmfc.config.sweep import RunConfig
from dmfc.engine import ray_cluster
from dmfc.errors import DmfcError
try:
    ray_cluster.start_ray(RunConfig(cpus=1))
except DmfcError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "TMPDIR": str(folder), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    (line,) = done.stdout.splitlines()
    assert "set TMPDIR" in line
    assert "shorter" in line
    assert "memory" not in line
