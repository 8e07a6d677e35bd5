"""The fixtures `compare` and `tell`; their ratios and figures at the end of the report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tests.benchmarks.compare import RATIOS, Compare


@pytest.fixture
def compare(benchmark: Any) -> Compare:
    return Compare(benchmark)


FIGURES: list[str] = []


@pytest.fixture(scope="session")
def tell() -> Callable[[str], None]:
    """Adds a line to the figures at the end of the report, which pytest would else keep back."""
    return FIGURES.append


def pytest_terminal_summary(terminalreporter: Any) -> None:
    for title, lines in (("ratios of medians", RATIOS), ("figures", FIGURES)):
        if lines:
            terminalreporter.section(title)
        for line in lines:
            terminalreporter.line(line)
