"""Entries of the leaderboard: a source executed on a frozen test set, or rows measured before."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dmfc.errors import DmfcError
from dmfc.experiment.benchmark import score_files
from dmfc.experiment.evaluation import evaluated, read_evaluation, read_trials
from dmfc.experiment.scene_sets import made_by
from dmfc.files.below import files_below

if TYPE_CHECKING:
    from dmfc.experiment.session import Session
    from dmfc.methods.named import Benchmark
    from dmfc.report.leaderboard import Entry
    from dmfc.report.rates import Rates
    from dmfc.report.table import MethodCost


def record(source: str, test_set: str, own: Sequence[str], store: Path, name: str) -> Entry:
    """The entry of a model, row, method or folder of answers on a frozen test set.

    `own`: settings of the entry, key=value. Raises DmfcError where scenes or protocol are others
    than those of the benchmark's version.
    """
    from dmfc.methods.named import load_benchmark

    benchmark = load_benchmark()
    overrides = benchmark.overrides(test_set, own)
    path = Path(source)
    if path.is_dir() and files_below(path, [".npz"]):
        session, stages = score_files([path], benchmark.preset, overrides, store, name)
    else:
        session, stages = evaluated(source, benchmark.preset, overrides, store)
    _require(benchmark, test_set, session)
    found = read_evaluation(session, stages, name, benchmark.preset)
    row, by = found.row, made_by()
    return _entry(
        benchmark,
        test_set,
        name,
        row.rates,
        f"{by['command']} ({by['commit'][:7]})",
        row.method,
    )


def taken(trials: str, test_set: str, name: str, origin: str) -> Entry:
    """The entry of trial rows that were measured before: 'FILE' or 'FILE:CELL'.

    Raises DmfcError where their number is not that of the set's trials.
    """
    from dmfc.config.load import load_config
    from dmfc.methods.named import load_benchmark
    from dmfc.report.rates import rates
    from dmfc.report.table import method_cost

    benchmark = load_benchmark()
    config = load_config(benchmark.preset, benchmark.overrides(test_set, ()))
    wanted = config.execution.grasps_per_scene * config.scenes.test.count
    rows = read_trials(trials)
    rows = rows[rows["scene"] < config.scenes.test.count]
    if len(rows) != wanted:
        raise DmfcError(f"{trials} has {len(rows)} trials of these scenes, the set has {wanted}")
    return _entry(benchmark, test_set, name, rates(rows, wanted), origin, method_cost(rows))


def _entry(
    benchmark: Benchmark,
    test_set: str,
    name: str,
    rates: Rates,
    origin: str,
    cost: MethodCost | None,
) -> Entry:
    from dmfc.report.leaderboard import Entry

    return Entry.measured(
        rates,
        benchmark=benchmark.name,
        version=benchmark.version,
        set=test_set,
        scenes=benchmark.sets[test_set].scenes,
        name=name,
        seconds=cost.seconds if cost else None,
        failed_scenes=cost.failed_scenes if cost else 0,
        used=cost.used if cost else "",
        origin=origin,
    )


def _require(benchmark: Benchmark, test_set: str, session: Session) -> None:
    """Raise DmfcError where the session's test scenes are not the frozen ones."""
    from dmfc.experiment.benchmark import test_scenes

    benchmark.require(test_set, session.config, test_scenes(session))
