"""Experiments from Python: the commands `train`, `evaluate`, `sweep` and `tables` as methods."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.errors import DmfcError
from dmfc.experiment.evaluation import Evaluation, evaluated, read_evaluation, scene_settings
from dmfc.experiment.session import Session
from dmfc.experiment.training import TrainedModel, train_model

if TYPE_CHECKING:
    import pandas as pd

    from dmfc.config.presets import Presets
    from dmfc.config.schema import Config
    from dmfc.methods.observation import Observation
    from dmfc.report.paired import Comparison
    from dmfc.report.table import SweepTable


RATES = ("valid", "success", "overall")


@dataclass(frozen=True)
class SweepResult:
    """A sweep that was run: its table, its trials, and where both lie."""

    table: SweepTable
    """A row per cell, with rates and their 95 % intervals."""
    folder: Path
    """Table files, trials, figures and the page of the sweep."""
    complete: bool
    """Whether every cell has all its trials."""

    @property
    def trials(self) -> pd.DataFrame:
        """A row per executed grasp of every cell; the columns `cell` and `seed` say whose."""
        from dmfc.pipeline.artifacts import load_trials

        return load_trials(self.folder)

    @property
    def rates(self) -> pd.DataFrame:
        """A row per cell: valid, success and overall, each with `_low` and `_high` (95 %)."""
        import pandas as pd

        rows = {}
        for row in self.table.rows:
            rows[row.name] = values = {"label": row.label, "trials": row.trials}
            for name in RATES:
                low, high = row.rate(name).interval or (None, None)
                values |= {name: row.rate(name).value, f"{name}_low": low, f"{name}_high": high}
        return pd.DataFrame.from_dict(rows, orient="index")


class Experiment:
    """A store of finished stages, and the settings of what is made in it.

    Every method runs what the store lacks, on Ray where several stages are missing, with progress
    on standard error. What is finished is never run twice: an interrupted call goes on where it
    was. Errors are `dmfc.errors.DmfcError`, with one line that says what is wrong.

    >>> import dmfc
    >>> lab = dmfc.Experiment("smoke", store="lab")
    >>> model = lab.train("pretrain")
    >>> planner = lab.evaluate("planner", scenes="single:2")
    >>> 0 <= planner.overall <= 1
    True
    """

    def __init__(
        self,
        preset: Presets = "quick",
        settings: Mapping[str, Any] | None = None,
        store: str | Path = "store",
    ) -> None:
        """`preset`: a shipped one's name or a YAML file, or several, of which the last one wins;
        `settings`: dotted keys over it.

        Raises DmfcError that names the nearest key where a key does not exist.
        """
        self.preset, self.store = preset, Path(store)
        self._overrides = [f"{key}={_text(value)}" for key, value in (settings or {}).items()]
        self._session = Session.open(preset, self._overrides, self.store)

    @property
    def config(self) -> Config:
        """All settings, resolved."""
        return self._session.config

    def train(self, phase: str = "finetune") -> TrainedModel:
        """The model of a phase: pretrain, or finetune, which pre-trains first."""
        with _interruptible():
            return train_model(self._session, phase)

    def evaluate(
        self,
        source: str | Path | TrainedModel | Callable[[Observation], Any] = "finetuned",
        scenes: str = "",
        protocol: str = "",
    ) -> Evaluation:
        """Execute grasps of a source on test scenes in MuJoCo.

        `source`: pretrained, finetuned, planner (ceiling), random (floor), a trained model or its
        folder, grasp sets, 'file.py:function', or a method: a function of an Observation, called
        in this process, that gives grasps (`dmfc.methods.answer.checked`). `scenes`: such as
        'multi:100'; empty: those of the settings.
        """
        settings = [*self._overrides, *scene_settings(scenes, protocol)]
        if callable(source):
            return self._method(source, settings)
        name = str(source.folder if isinstance(source, TrainedModel) else source)
        with _interruptible():
            session, stages = evaluated(name, self.preset, settings, self.store)
        return read_evaluation(session, stages, name, self.preset)

    def _method(self, predict: Callable[[Observation], Any], settings: list[str]) -> Evaluation:
        from dmfc.experiment.benchmark import score_function

        name = getattr(predict, "__name__", type(predict).__name__)
        with _interruptible():
            session, stages = score_function(predict, self.preset, settings, self.store, name)
        return read_evaluation(session, stages, name, self.preset)

    def sweep(self, file: str | Path) -> SweepResult:
        """Run every cell of a sweep file, or of a shipped sweep such as 'table1'."""
        from dmfc.experiment.drive import drive, explained_disk_errors
        from dmfc.sweep.planner import plan_sweep
        from dmfc.sweep.sweep_file import load_sweep

        ledger, builder = self._session.ledger, self._session.builder
        plan = plan_sweep(load_sweep(str(file)), builder, self.preset, self._overrides, ledger)
        with _interruptible(), explained_disk_errors(ledger):
            driven = drive([plan], ledger, as_json=True)
        name = Path(driven.results[0]["folder"]).name
        return self.tables([name])[0]

    def tables(self, names: Sequence[str] | None = None) -> list[SweepResult]:
        """Tables of sweeps in the store, made from their trials without running anything.

        `names`: ids of sweeps, or their names, which mean the latest of each; None: all names.
        """
        from dmfc.engine.state import read_state
        from dmfc.experiment.drive import write_tables
        from dmfc.report.collect import read_sweep, resolve_sweeps

        ledger, results = self._session.ledger, []
        for name in resolve_sweeps(ledger, names):
            folder = ledger.store / "sweeps" / name
            failures = read_state(folder).failures
            table = write_tables(ledger, read_sweep(ledger, name), failures, as_json=True)
            results.append(SweepResult(table, folder, not any(row.failure for row in table.rows)))
        return results

    @staticmethod
    def compare(first: Evaluation, second: Evaluation) -> Comparison:
        """The difference of two evaluations of the same scenes, in pairs."""
        from dmfc.report.paired import compare

        return compare(first.trials, second.trials)


@contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C in a notebook or a script is KeyboardInterrupt, not the end of the program."""
    import typer

    try:
        yield
    except typer.Exit as ended:
        if isinstance(ended.__cause__, DmfcError):  # the head of the cluster is lost
            raise ended.__cause__ from None
        raise KeyboardInterrupt from ended


def _text(value: Any) -> str:
    """A value as `--set` takes it."""
    import json

    return value if isinstance(value, str) else json.dumps(value)
