"""Executing grasps on test scenes: what `dmfc evaluate` and `dmfc compare` do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.errors import DmfcError, unknown_name
from dmfc.experiment.session import Session, require

if TYPE_CHECKING:
    import pandas as pd

    from dmfc.engine.stage import Stage
    from dmfc.report.table import SweepTable, TableRow

CHECKS = ("contact_penetration", "contact_force", "hand_penetration", "self_penetration")
"""Physical checks; the summary has median and largest of each, over planned trials."""


@dataclass(frozen=True)
class Evaluation:
    """Executed grasps of one source on a set of test scenes."""

    source: str
    """A model, a row such as planner, or grasp sets."""
    trials: pd.DataFrame
    """A row per executed grasp; columns: docs/execution.md."""
    diversity: pd.DataFrame
    """A row per scene: how different its grasps are."""
    table: SweepTable
    """Its single row has rates with intervals, by object too."""
    files: tuple[Path, ...]
    """Where the store holds the trials."""

    @property
    def row(self) -> TableRow:
        """The row of the table."""
        return self.table.rows[0]

    @property
    def overall(self) -> float | None:
        """The share of all trials that held their object; None without a trial."""
        return self.row.rates.overall.value

    @property
    def summary(self) -> dict[str, Any]:
        """Rates, reasons, diversity and physical checks, for `json.dumps`."""
        from dmfc.report.formats import to_json

        return {
            **to_json(self.table)["cells"][self.source],
            "diversity": _means(self.diversity),
            "checks": _checks(self.trials),
            "files": [str(path) for path in self.files],
        }

    def write(self, folder: Path) -> None:
        """Write trials.parquet, diversity.parquet, summary.json and failures.png into `folder`."""
        from dmfc.files.atomic import write_json
        from dmfc.pipeline.artifacts import DIVERSITY, SUMMARY, TRIALS
        from dmfc.report.failures import draw_failures

        folder.mkdir(parents=True, exist_ok=True)
        self.trials.to_parquet(folder / TRIALS, index=False)
        self.diversity.to_parquet(folder / DIVERSITY, index=False)
        write_json(folder / SUMMARY, self.summary)
        draw_failures(self.table, folder / "failures.png")


def evaluated(
    source: str, preset: str, overrides: Sequence[str], store: Path
) -> tuple[Session, tuple[Stage, ...]]:
    """The finished evaluations of a model, row or grasp sets, made where they are missing."""
    checkpoint, files = _source(source)
    settings = [f"objects.test=[{', '.join(files)}]"] if files else []
    session = Session.open(preset, [*overrides, *settings], store, grasp_files=files)
    model = "planner" if files else source
    stages = session.builder.cell(session.config, model, source, checkpoint).evaluations
    require(session.make(stages), stages)
    return session, stages


def read_evaluation(
    session: Session, stages: Sequence[Stage], source: str, preset: str
) -> Evaluation:
    """The rows of finished evaluation stages, and their rates."""
    import pandas as pd

    from dmfc.pipeline.artifacts import TRIALS, load_diversity, load_trials
    from dmfc.report.rates import concatenate
    from dmfc.report.table import CellRows, make_table

    folders = [session.ledger.folder(stage.address) for stage in stages]
    files = tuple(folder / TRIALS for folder in folders)
    trials = concatenate([load_trials(folder) for folder in folders])
    diversity = pd.concat([load_diversity(folder) for folder in folders])
    config = session.config
    wanted = config.execution.grasps_per_scene * config.scenes.test.count
    cell = CellRows(source, source, config.execution.seed, wanted, trials)
    table = make_table([cell], id="evaluate", name=source, title=source, preset=preset)
    return Evaluation(source, trials, diversity, table, files)


def scene_settings(scenes: str, protocol: str) -> list[str]:
    """'multi:100' and the name of a protocol as settings; empty text changes nothing."""
    kind, _, count = scenes.partition(":")
    if count and not count.isdigit():
        raise DmfcError(f"--scenes wants a kind and perhaps a number such as multi:100: '{scenes}'")
    given = [f"scenes.test.kind={kind}"] if kind else []
    given += [f"scenes.test.count={count}"] if count else []
    return given + ([f"execution.protocol={protocol}"] if protocol else [])


def read_trials(text: str) -> pd.DataFrame:
    """Trial rows of 'FILE', 'FOLDER' or 'FILE:CELL'. Raises DmfcError where there are none."""
    import pandas as pd

    from dmfc.pipeline.artifacts import TRIALS

    name, _, cell = text.partition(":")
    path = Path(name) / TRIALS if Path(name).is_dir() else Path(name)
    if not path.is_file():
        raise DmfcError(f"there are no trial rows at '{path}'")
    rows = pd.read_parquet(path)
    if not cell:
        return rows
    cells = list(rows["cell"].unique()) if "cell" in rows else []
    if cell not in cells:
        raise unknown_name(f"cell of {path}", cell, cells)
    return rows[rows["cell"] == cell]


def _source(source: str) -> tuple[Path | None, dict[str, Path]]:
    """A trained model's folder, or the files of grasp sets by object; neither for a known name."""
    from dmfc.grasps.grasp_set import GraspSet
    from dmfc.pipeline.artifacts import WEIGHTS
    from dmfc.sweep.sweep_file import MODELS

    path = Path(source)
    if source in MODELS:
        return None, {}
    if (path / WEIGHTS).is_file():
        return path.absolute(), {}
    sets = sorted(path.rglob("*.parquet")) if path.is_dir() else [path]
    if not sets or not all(file.is_file() and file.suffix == ".parquet" for file in sets):
        raise DmfcError(
            f"{unknown_name('model', source, MODELS)}; nor is it a folder with {WEIGHTS} or "
            "grasp sets (.parquet)"
        )
    return None, {GraspSet.load(file).object_id: file.absolute() for file in sets}


def _means(spread: pd.DataFrame) -> dict[str, float | None]:
    """Means over the scenes that have two grasps or more; None where none has."""
    means = spread.drop(columns="scene").mean()
    return {str(name): None if value != value else float(value) for name, value in means.items()}


def _checks(rows: pd.DataFrame) -> dict[str, Any]:
    planned = rows[rows["planned"].astype(bool)]
    if not len(planned):
        return {}
    return {
        name: {"median": float(planned[name].median()), "largest": float(planned[name].max())}
        for name in CHECKS
    }
