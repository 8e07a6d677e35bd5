"""Fixtures that several parts use."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from dmfc.hand.description import HandDescription
    from dmfc.hand.model import HandModel

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session", autouse=True)
def ctrl_c_is_heard():
    """A shell that starts the tests in the background has them and their children ignore SIGINT."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def dmfc(capsys, monkeypatch):
    """Runs `dmfc ...` in this process; gives (status, standard output, standard error)."""

    from dmfc.cli import main as cli

    def call(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["dmfc", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        status = ended.value.code
        return (status if isinstance(status, int) else 0), out, err

    return call


@pytest.fixture(scope="session")
def shadow_hand_dir() -> Path:
    """Folder of the Shadow Hand's MJCF: the pinned pack, downloaded once into the cache."""
    from dmfc.assets import pull

    return pull("shadow_hand")


@pytest.fixture(scope="session")
def hand(shadow_hand_dir: Path) -> HandModel:
    """The Shadow Hand with the default settings, built once."""
    from tests.support.grasp_shapes import shadow

    return shadow()[0]


@pytest.fixture(scope="session")
def description(shadow_hand_dir: Path) -> HandDescription:
    """The description of the Shadow Hand."""
    from dmfc.hand.description import load_description

    return load_description("shadow")


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory):
    """MLflow's tables without a run: making them takes seconds, copying them does not."""
    from mlflow.tracking import MlflowClient

    path = tmp_path_factory.mktemp("mlflow") / "mlflow.db"
    MlflowClient(f"sqlite:///{path}").search_experiments()
    return path


@pytest.fixture(scope="session")
def ray_cluster():
    """One Ray for the whole session."""
    import ray

    from tests.chaos.two_nodes import patiently

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
    from dmfc.engine.ledger import Ledger

    return Ledger(tmp_path / "store")
