"""Entries of the leaderboard, its pages, and the frozen scenes and protocol behind them."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pandas as pd
import pytest

from dmfc.config.load import load_config
from dmfc.errors import DmfcError
from dmfc.methods.named import load_benchmark, protocol_digest, scenes_digest
from dmfc.report.formats import rate_text
from dmfc.report.leaderboard import Entry, read_entries, to_html, to_markdown
from dmfc.report.rates import Rate, Rates, rates

ROOT = Path(__file__).resolve().parents[2]
BENCHMARK = load_benchmark()
SINGLE = BENCHMARK.sets["single"]


def entry(**more) -> Entry:
    values = {"set": "single", "scenes": SINGLE.scenes, "name": "mine", **more}
    held, named = values.pop("held", 200), {"benchmark": BENCHMARK.name}
    rates = Rates(Rate(300, 400), Rate(held, 300), Rate(held, 400, 250.0, 2.0))
    made = Entry.measured(rates, **named, version=BENCHMARK.version, **values)
    return dataclasses.replace(made, rates={}) if made.reported else made


def test_the_sets_are_the_frozen_ones_and_the_protocol_has_not_changed():
    frozen = json.loads((ROOT / "results" / "test_sets.json").read_text())["sets"]
    names = {"single": "single", "standard": "single_standard", "clutter": "multi"}
    for name, kind in names.items():
        assert BENCHMARK.sets[name].scenes == scenes_digest(frozen[kind])
        config = load_config(BENCHMARK.preset, BENCHMARK.overrides(name, ()))
        assert config.scenes.test.kind == kind
        assert config.scenes.test.count == len(frozen[kind]["clouds"].split()) == 100
        assert protocol_digest(config) == BENCHMARK.protocol
    for kind, count, name in (("single", 16, "single-16"), ("multi", 50, "clutter-50")):
        first = {part: " ".join(words.split()[:count]) for part, words in frozen[kind].items()}
        assert BENCHMARK.sets[name].scenes == scenes_digest(first)


def test_an_entry_may_choose_among_its_grasps_and_nothing_else():
    own = BENCHMARK.overrides("single", ["execution.cloud_check=true", "outcome.judge=x"])
    config = load_config(BENCHMARK.preset, own[:-1])
    assert config.execution.cloud_check
    assert protocol_digest(config) == BENCHMARK.protocol
    for text in ("physics.hand_friction=2", "execution.hold_time=0", "scenes.test.seed=3"):
        with pytest.raises(DmfcError, match="the benchmark fixes it"):
            BENCHMARK.overrides("single", [text])
    softer = load_config(BENCHMARK.preset, ["execution.changes={physics.hand_friction: 2.0}"])
    assert protocol_digest(softer) != BENCHMARK.protocol
    with pytest.raises(DmfcError, match="unknown test set"):
        BENCHMARK.overrides("singel", [])


def test_pages_show_the_best_first_with_their_intervals(tmp_path):
    reported = entry(name="paper", reported={"overall": [0.56, 0.02]})
    best = entry(name="better <b>", held=300, seconds=0.25, failed_scenes=2, used="normals")
    for number, one in enumerate((entry(), reported, best)):
        one.save(tmp_path / f"{number}.json")
    entries = read_entries(tmp_path, BENCHMARK)
    text = to_markdown(entries, BENCHMARK)
    rows = [line for line in text.splitlines() if line.startswith("| ")][2:]
    assert [row.split(" | ")[0] for row in rows] == ["| better \\<b\\>", "| paper", "| mine"]
    low, high = Rate(300, 400, 250.0, 2.0).interval
    assert f"0.75 ± 0.03 \\[{low:.2f}, {high:.2f}\\]" in rows[0]
    assert "| reported | 0.56 ± 0.02 | – | – |" in rows[1]
    page = to_html(entries, BENCHMARK)
    assert "better &lt;b&gt;" in page
    assert page.count("<tr>") == 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scenes": "0" * 16}, "its scenes are 0000"),
        ({"version": 0}, "version 0, not of dmfc-table version 1"),
        ({"set": "sngle"}, "has no test set 'sngle'"),
        ({"rates": entry(held=301).rates}, "contradict each other"),
        ({"rates": {}}, "cannot be read as an entry"),
        ({"colour": "red"}, "cannot be read as an entry"),
    ],
)
def test_what_is_no_entry_is_one_line(tmp_path, change, message):
    values = dataclasses.asdict(entry()) | change
    (tmp_path / "x.json").write_text(json.dumps(values))
    with pytest.raises(DmfcError, match=message):
        read_entries(tmp_path, BENCHMARK)


def test_the_committed_pages_are_those_of_the_committed_entries():
    folder = ROOT / "results" / "leaderboard"
    entries = read_entries(folder, BENCHMARK)
    assert (folder / "README.md").read_text() == to_markdown(entries, BENCHMARK)
    assert (folder / "index.html").read_text() == to_html(entries, BENCHMARK)
    ours = next(e for e in entries if e.origin.startswith("results/table1.trials.parquet:all,"))
    measured = pd.read_parquet(ROOT / "results" / "table1.trials.parquet")
    found = rates(measured[measured["cell"] == "all"], 400)
    assert ours.text("overall") == rate_text(found.overall)
    assert ours.rate("overall").interval == pytest.approx(found.overall.interval)
