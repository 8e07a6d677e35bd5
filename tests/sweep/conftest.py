"""One Ray for the whole session, and stages that need no science."""

from pathlib import Path

import pytest

from dmfc.config.schema import Config
from dmfc.engine.ledger import Ledger
from tests.chaos.two_nodes import patiently

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def ray_cluster():
    import ray

    with pytest.MonkeyPatch.context() as patch:
        # Ray's workers import the trivial stages as the tests do.
        patch.setenv("PYTHONPATH", str(ROOT))
        patiently(
            lambda: ray.init(
                address="local",
                num_cpus=2,
                include_dashboard=False,
                log_to_driver=False,
                logging_level="ERROR",
                object_store_memory=100 * 2**20,
            ),
            ray.shutdown,
        )
        yield
        ray.shutdown()


@pytest.fixture
def ledger(tmp_path):
    return Ledger(tmp_path / "store")


@pytest.fixture
def config():
    return Config()
