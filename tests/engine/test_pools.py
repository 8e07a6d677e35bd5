"""Ray that does not start: tried again, then said on one line."""

import pytest

from dmfc.config.sweep import RunConfig
from dmfc.engine.ray_cluster import START_TRIES, start_ray
from dmfc.errors import DmfcError


@pytest.fixture
def starts(monkeypatch):
    """Ray that fails to start so many times; counts the attempts."""
    import ray

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
