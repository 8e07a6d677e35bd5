"""The verbs that judge grasps: evaluate, and compare two evaluations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dmfc.cli.common import PRESET, STORE, AsJson, Overrides, Preset, Store
from dmfc.errors import DmfcError, unknown_name
from dmfc.experiment.console import answer, show_rows
from dmfc.experiment.session import Session, require

if TYPE_CHECKING:
    import pandas as pd

    from dmfc.engine.stage import Stage
    from dmfc.report.table import SweepTable

WEIGHTS = "weights.safetensors"
CHECKS = ("contact_penetration", "contact_force", "hand_penetration", "self_penetration")
"""Physical checks of which the summary tells median and largest, over planned trials."""


def evaluate(
    source: Annotated[
        str,
        typer.Argument(
            help="pretrained, finetuned, planner (ceiling), random (floor); the folder of a "
            "trained model; or grasp sets: a .parquet file, or a folder of them."
        ),
    ] = "finetuned",
    scenes: Annotated[
        str,
        typer.Option(
            help="Test scenes: single, single_standard or multi, and how many, such as multi:100; "
            "default: the preset's."
        ),
    ] = "",
    protocol: Annotated[
        str, typer.Option(help="paper, dexgraspbench, or a YAML file; default: the preset's.")
    ] = "",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the rows, the summary and the figure."),
    ] = None,
    only: Annotated[
        str, typer.Option("--only", help="scene:trial, one trial once more, with a picture.")
    ] = "",
    dense: Annotated[
        int | None,
        typer.Option(help="A scene: a picture of all its grasps, coloured by confidence."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="PNG that --only (trial.png) or --dense (dense.png) writes."),
    ] = None,
    video: Annotated[Path | None, typer.Option(help="GIF that --only writes: all of it.")] = None,
    detailed: Annotated[
        bool, typer.Option("--detailed", help="More steps in the picture of --only.")
    ] = False,
) -> None:
    """Execute grasps on the test scenes in MuJoCo, and print how many were held."""
    if only and dense is not None:
        raise DmfcError("--only pictures one trial, --dense a whole scene: give one of them")
    if not only and (video or detailed or (picture and dense is None)):
        raise DmfcError("--video, --detailed and --picture are of one trial: name it by --only")
    settings = _scene_settings(scenes) + ([f"execution.protocol={protocol}"] if protocol else [])
    session, stages = evaluated(source, preset, [*(overrides or []), *settings], store)
    if only:
        from dmfc.pipeline.replay import Pictures, replay

        path = picture or Path("trial.png")
        row = replay(session.ledger, stages, only, Pictures(path, video, detailed))
        answer({**row, "picture": str(path), **({"video": str(video)} if video else {})})
    elif dense is not None:
        from dmfc.pipeline.replay import picture_dense

        path = picture or Path("dense.png")
        answer({**picture_dense(session.ledger, stages, dense, path), "picture": str(path)})
    else:
        _report(session, stages, source, preset, out, as_json)


def evaluated(
    source: str, preset: str, overrides: list[str], store: Path
) -> tuple[Session, tuple[Stage, ...]]:
    """The finished evaluations of a model, row or grasp sets, made where they are missing."""
    checkpoint, files = _source(source)
    settings = [f"objects.test=[{', '.join(files)}]"] if files else []
    session = Session.open(preset, [*overrides, *settings], store, grasp_files=files)
    model = "planner" if files else source
    stages = session.builder.cell(session.config, model, source, checkpoint).evaluations
    require(session.make(stages), stages)
    return session, stages


def compare(
    first: Annotated[
        str, typer.Argument(help="Trial rows: a .parquet file or its folder, with :CELL if needed.")
    ],
    second: Annotated[str, typer.Argument(help="The same for what it is compared with.")],
    as_json: AsJson = False,
) -> None:
    """Compare two evaluations of the same scenes in pairs."""
    from dmfc.report.paired import compare as compare_rows

    found = compare_rows(_trial_rows(first), _trial_rows(second)).row()
    if as_json:
        answer(found)
        return
    rows = [{"quantity": name, "value": value} for name, value in found.items()]
    show_rows(f"a: {first}, b: {second}", rows, as_json=False)


def _source(source: str) -> tuple[Path | None, dict[str, Path]]:
    """A trained model's folder, or the files of grasp sets by object; neither for a known name."""
    from dmfc.grasps.grasp_set import GraspSet
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


def _scene_settings(scenes: str) -> list[str]:
    """'multi:100' as settings."""
    kind, _, count = scenes.partition(":")
    if count and not count.isdigit():
        raise DmfcError(f"--scenes wants a kind and perhaps a number such as multi:100: '{scenes}'")
    given = [f"scenes.test.kind={kind}"] if kind else []
    return given + ([f"scenes.test.count={count}"] if count else [])


def _report(
    session: Session,
    stages: tuple[Stage, ...],
    source: str,
    preset: str,
    out: Path | None,
    as_json: bool,
) -> None:
    import pandas as pd

    from dmfc.execution.evaluate import DIVERSITY, TRIALS
    from dmfc.report.formats import to_json
    from dmfc.report.rates import concatenate
    from dmfc.report.table import CellRows, make_table

    folders = [session.ledger.verified(stage.address) for stage in stages]
    rows = concatenate([pd.read_parquet(folder / TRIALS) for folder in folders])
    spread = pd.concat([pd.read_parquet(folder / DIVERSITY) for folder in folders])
    config = session.config
    trials = config.execution.grasps_per_scene * config.scenes.test.count
    cell = CellRows(source, source, config.execution.seed, trials, rows)
    table = make_table([cell], id="evaluate", name=source, title=source, preset=preset)
    summary = {
        **to_json(table)["cells"][source],
        "diversity": _means(spread),
        "checks": _checks(rows),
        "files": [str(folder / TRIALS) for folder in folders],
    }
    if out is not None:
        from dmfc.files.atomic import write_json, written_whole
        from dmfc.report.failures import draw_failures
        from dmfc.report.outputs import note_outputs

        out.mkdir(parents=True, exist_ok=True)
        for name, table_of_rows in ((TRIALS, rows), (DIVERSITY, spread)):
            with written_whole(out / name) as temporary:
                table_of_rows.to_parquet(temporary, index=False)
        write_json(out / "summary.json", summary)
        note_outputs(out, [TRIALS, DIVERSITY, "summary.json"])
        draw_failures(table, out / "failures.png")
    if as_json:
        answer(summary)
    else:
        _show(table, summary)


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


def _show(table: SweepTable, summary: Mapping[str, Any]) -> None:
    from dmfc.report.formats import rate_text
    from dmfc.report.table import NAMES

    row = table.rows[0]
    shown = [
        {"rate": name, "of": row.rate(name).trials, "value": rate_text(row.rate(name))}
        for name in NAMES
    ]
    show_rows(f"{table.title} ({table.preset}), {row.trials} trials", shown, as_json=False)
    objects = [
        {"object": name, **{rate: rate_text(getattr(found, rate)) for rate in NAMES}}
        for name, found in row.objects.items()
    ]
    show_rows("by object", objects, as_json=False)
    why = [{"reason": reason, "trials": count} for reason, count in row.reasons.items()]
    show_rows("why grasps did not hold", why, as_json=False)
    spread = [{"diversity": name, "mean": value} for name, value in summary["diversity"].items()]
    show_rows("how different the grasps of a scene are", spread, as_json=False)
    checks = [{"check": name, **found} for name, found in summary["checks"].items()]
    show_rows("physics of the planned trials (metres, N)", checks, as_json=False)


def _trial_rows(text: str) -> pd.DataFrame:
    """Rows of 'FILE' or 'FILE:CELL'."""
    import pandas as pd

    from dmfc.engine.record import verified
    from dmfc.report.outputs import whole_output

    name, _, cell = text.partition(":")
    path = Path(name) / "trials.parquet" if Path(name).is_dir() else Path(name)
    if not path.is_file():
        raise DmfcError(f"there are no trial rows at '{path}'")
    verified(path.parent)
    whole_output(path, "`dmfc tables` or `dmfc evaluate` writes it again")
    try:
        rows = pd.read_parquet(path)
    except (OSError, ValueError) as error:
        raise DmfcError(f"trial rows '{path}' cannot be read: {error}") from error
    if not cell:
        return rows
    cells = list(rows["cell"].unique()) if "cell" in rows else []
    if cell not in cells:
        raise unknown_name(f"cell of {path}", cell, cells)
    return rows[rows["cell"] == cell]
