"""The fixture `compare`; what was found besides times, at the end of the report."""

from __future__ import annotations

from typing import Any

import pytest

from tests.benchmarks.compare import RATIOS, Compare


@pytest.fixture
def compare(benchmark: Any) -> Compare:
    return Compare(benchmark)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    if RATIOS:
        terminalreporter.section("found (ratios are of medians)")
        for line in RATIOS:
            terminalreporter.line(line)
