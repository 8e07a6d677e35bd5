"""Settings as they are by default."""

import pytest

from dmfc.config.schema import Config


@pytest.fixture
def config():
    return Config()
