"""Executing grasps on test scenes: what `dmfc evaluate` and `dmfc compare` do."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.config.protocol import executed
from dmfc.errors import DmfcError, unknown_name
from dmfc.experiment.console import warn
from dmfc.experiment.session import Session, require
from dmfc.files.below import files_below
from dmfc.files.foreign import reading

if TYPE_CHECKING:
    import pandas as pd

    from dmfc.config.presets import Presets
    from dmfc.config.schema import Config
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
        from dmfc.files.atomic import write_json, written_whole
        from dmfc.pipeline.artifacts import DIVERSITY, SUMMARY, TRIALS
        from dmfc.report.failures import draw_failures
        from dmfc.report.outputs import note_outputs

        folder.mkdir(parents=True, exist_ok=True)
        for name, rows in ((TRIALS, self.trials), (DIVERSITY, self.diversity)):
            with written_whole(folder / name) as temporary:
                rows.to_parquet(temporary, index=False)
        write_json(folder / SUMMARY, self.summary)
        note_outputs(folder, [TRIALS, DIVERSITY, SUMMARY])
        draw_failures(self.table, folder / "failures.png")


def evaluated(
    source: str,
    preset: Presets,
    overrides: Sequence[str],
    store: Path,
    wanted: tuple[int, int] | None = None,
) -> tuple[Session, tuple[Stage, ...]]:
    """The finished evaluations of a model, row or grasp sets, made where they are missing.

    Raises DmfcError before anything is made where the scene and the trial in it that are `wanted`
    are not among them.
    """
    found = _source(source)
    tested = f"objects.test={json.dumps(found.objects, ensure_ascii=False)}"
    settings = [*overrides, tested] if found.files else overrides
    session = Session.open(preset, settings, store, grasp_files=found.files)
    if wanted is not None:
        _require_trial(session.config, *wanted)
    model = "planner" if found.files else source
    cell = session.builder.cell(
        session.config, model, source, found.checkpoint, found.method or None
    )
    stages = cell.evaluations
    require(session.make(stages), stages)
    warn(_implausible(session))
    return session, stages


def _implausible(session: Session) -> list[str]:
    """Warnings of masses that the user's test objects cannot have."""
    from dmfc.objects.mass import implausible_mass
    from dmfc.pipeline.artifacts import load_object

    objects = session.builder.objects(session.config, "test")
    users = [stage for stage in objects if stage.name.startswith(("folder/", "own/"))]
    ledger = session.ledger
    made = [
        s.address for s in users if ledger.finished(s.address) and not ledger.failure(s.address)
    ]
    return [implausible_mass(load_object(ledger.verified(address))) for address in made]


def _require_trial(config: Config, scene: int, trial: int) -> None:
    scenes, trials = config.scenes.test.count, executed(config).execution.grasps_per_scene
    if not 0 <= scene < scenes:
        raise DmfcError(
            f"there is no scene {scene}: the {scenes} test scenes are 0 to {scenes - 1} "
            "(setting scenes.test.count, option --scenes)"
        )
    if not 0 <= trial < trials:
        raise DmfcError(
            f"scene {scene} has no trial {trial}: its {trials} trials are 0 to {trials - 1} "
            "(setting execution.grasps_per_scene)"
        )


def read_evaluation(
    session: Session, stages: Sequence[Stage], source: str, preset: Presets
) -> Evaluation:
    """The rows of finished evaluation stages, and their rates."""
    import pandas as pd

    from dmfc.config.presets import preset_title
    from dmfc.pipeline.artifacts import TRIALS, load_diversity, load_trials
    from dmfc.report.rates import concatenate
    from dmfc.report.table import CellRows, make_table

    folders = [session.ledger.verified(stage.address) for stage in stages]
    files = tuple(folder / TRIALS for folder in folders)
    trials = concatenate([load_trials(folder) for folder in folders])
    diversity = pd.concat([load_diversity(folder) for folder in folders])
    config = session.config
    wanted = config.execution.grasps_per_scene * config.scenes.test.count
    cell = CellRows(source, source, config.execution.seed, wanted, trials)
    title = preset_title(preset)
    table = make_table([cell], id="evaluate", name=source, title=source, preset=title)
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

    from dmfc.engine.record import verified
    from dmfc.pipeline.artifacts import TRIALS
    from dmfc.report.outputs import whole_output

    name, _, cell = text.partition(":")
    path = Path(name) / TRIALS if Path(name).is_dir() else Path(name)
    if path.is_file():
        verified(path.parent)
        whole_output(path, "`dmfc tables` or `dmfc evaluate` writes it again")
    with reading(path, "trial rows (parquet)"):
        rows = pd.read_parquet(path)
    if not cell:
        return rows
    cells = list(rows["cell"].unique()) if "cell" in rows else []
    if cell not in cells:
        raise unknown_name(f"cell of {path}", cell, cells)
    return rows[rows["cell"] == cell]


def cells_of(rows: pd.DataFrame, base: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The rows of each cell but the base; all rows where they name no cell."""
    if "cell" not in rows:
        return {"": rows}
    parts = {str(name): part for name, part in rows.groupby("cell", sort=False)}
    others = {name: part for name, part in parts.items() if not part.equals(base)}
    return others if len(parts) > 1 else parts


@dataclass(frozen=True)
class _Source:
    """Where the grasps of an evaluation come from; all empty for a known name."""

    checkpoint: Path | None = None
    """A trained model's folder."""
    files: dict[str, Path] = field(default_factory=dict)
    """Grasp sets by the id of their object."""
    objects: list[str] = field(default_factory=list)
    """Selectors of these objects."""
    method: str = ""
    """'file.py:function'."""


def _source(source: str) -> _Source:
    from dmfc.config.custom_function import custom_function
    from dmfc.pipeline.artifacts import WEIGHTS
    from dmfc.prediction.models import shipped_folder, shipped_models
    from dmfc.sweep.models import MODELS, method_text, shipped_methods

    path, method = shipped_folder(source) or Path(source), method_text(source)
    if source in MODELS:
        return _Source()
    if method:
        custom_function(method, "evaluate")
        return _Source(method=method)
    if (path / WEIGHTS).is_file():
        from dmfc.network.checkpoint import load_alone

        load_alone(path)  # before stages are made that it is to be evaluated with
        return _Source(path.absolute())
    sets = files_below(path, [".parquet"]) if path.is_dir() else [path]
    if not sets or not all(file.is_file() and file.suffix == ".parquet" for file in sets):
        known = [*MODELS, *shipped_models(), *shipped_methods()]
        raise DmfcError(
            f"{unknown_name('model', source, known)}; nor is it a folder "
            f"with {WEIGHTS}, grasp sets (.parquet), or file.py:function"
        )
    return _grasp_sets(sets)


def _grasp_sets(sets: Sequence[Path]) -> _Source:
    """Grasp sets and their objects. Raises DmfcError where two are of one object."""
    from dmfc.grasps.grasp_set import GraspSet

    files: dict[str, Path] = {}
    selectors = []
    for file in sets:
        found = GraspSet.load(file)
        if found.object_id in files:
            raise DmfcError(
                f"two grasp sets of '{found.object_id}': {files[found.object_id]} and {file}"
            )
        files[found.object_id] = file.absolute()
        selectors.append(found.notes.get("object_selector", found.object_id))
    return _Source(files=files, objects=selectors)


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
