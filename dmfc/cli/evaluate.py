"""The verbs that judge grasps: evaluate, and compare two evaluations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dmfc.cli import complete
from dmfc.cli.common import PRESET, STORE, AsJson, OverOption, Overrides, Preset, Store
from dmfc.cli.outputs import file_to_write, folder_to_write
from dmfc.errors import DmfcError
from dmfc.experiment.console import answer, show_rows
from dmfc.experiment.evaluation import (
    Evaluation,
    cells_of,
    evaluated,
    read_evaluation,
    read_trials,
    scene_settings,
)

MATRIX = ("cell", "overall_a", "overall_b", "difference", "low", "high", "p", "p_holm")
"""Of each comparison, where there are several."""


def evaluate(
    source: Annotated[
        str,
        typer.Argument(
            help="pretrained, finetuned, planner (ceiling), random (floor); the folder of a "
            "trained model; grasp sets: a .parquet file, or a folder of them; a method of yours: "
            "file.py:function."
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
        str,
        typer.Option(
            help="default, dexgraspbench, six_directions, or a YAML file; default: the preset's.",
            autocompletion=complete.protocols,
        ),
    ] = "",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder for the rows, the summary and the figure.",
            callback=folder_to_write(),
        ),
    ] = None,
    only: Annotated[
        str, typer.Option("--only", help="scene:trial: run one trial again, with a picture.")
    ] = "",
    dense: Annotated[
        int | None,
        typer.Option(help="A scene: a picture of all its grasps, coloured by confidence."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            help="PNG that --only (trial.png) or --dense (dense.png) writes.",
            callback=file_to_write(".png"),
        ),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            help="GIF of the whole trial that --only writes.", callback=file_to_write(".gif")
        ),
    ] = None,
    detailed: Annotated[
        bool, typer.Option("--detailed", help="More steps in the picture of --only.")
    ] = False,
) -> None:
    """Execute grasps on the test scenes in MuJoCo, and print how many were held."""
    if only and dense is not None:
        raise DmfcError("--only pictures one trial, --dense a whole scene: give one of them")
    if not only and (video or detailed or (picture and dense is None)):
        raise DmfcError("--video, --detailed and --picture are of one trial: name it by --only")
    from dmfc.pipeline.replay import parse_trial

    if out is not None and (only or dense is not None):
        raise DmfcError("--out is for the rows of all trials: leave --only and --dense out")
    settings = [*(overrides or []), *scene_settings(scenes, protocol)]
    scene = None if dense is None else (dense, 0)
    wanted = parse_trial(only) if only else scene
    session, stages = evaluated(source, preset, settings, store, wanted)
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
        report(read_evaluation(session, stages, source, preset), out, as_json)


def compare(
    first: Annotated[
        str,
        typer.Argument(
            help="Trial rows: a .parquet file or its folder, with :CELL for one cell; else each "
            "cell is compared, and p corrected for their number."
        ),
    ],
    second: Annotated[
        str, typer.Argument(help="What it is compared with: the same, but of one cell.")
    ],
    as_json: AsJson = False,
    over: OverOption = "scenes",
) -> None:
    """Compare evaluations of the same scenes in pairs."""
    from dmfc.report.paired import compare as compare_rows
    from dmfc.report.paired import together

    base = read_trials(second)
    cells = cells_of(read_trials(first), base)
    found = together([compare_rows(rows, base, over) for rows in cells.values()])
    if as_json:
        answer(
            found[0].row()
            if len(found) == 1
            else dict(zip(cells, (x.row() for x in found), strict=True))
        )
        return
    if len(found) == 1:
        rows = [{"quantity": name, "value": value} for name, value in found[0].row().items()]
        show_rows(f"a: {first}, b: {second}", rows, as_json=False)
        return
    rows = [{"cell": name, **one.row()} for name, one in zip(cells, found, strict=True)]
    shown = [{key: row[key] for key in MATRIX} for row in rows]
    show_rows(f"a: each cell of {first}, b: {second}", shown, as_json=False)


def report(found: Evaluation, out: Path | None, as_json: bool) -> None:
    """Write an evaluation where it is wanted, and print it."""
    if out is not None:
        found.write(out)
    if as_json:
        answer(found.summary)
    else:
        _show(found)


def _show(found: Evaluation) -> None:
    from dmfc.report.formats import rate_text
    from dmfc.report.table import NAMES

    row, table, summary = found.row, found.table, found.summary
    shown = [
        {"rate": name, "of": row.rate(name).trials, "value": rate_text(row.rate(name))}
        for name in NAMES
    ]
    show_rows(f"{table.title} ({table.preset}), {row.trials} trials", shown, as_json=False)
    objects = [
        {"object": name, **{rate: rate_text(getattr(rates, rate)) for rate in NAMES}}
        for name, rates in row.objects.items()
    ]
    show_rows("by object", objects, as_json=False)
    why = [{"reason": reason, "trials": count} for reason, count in row.reasons.items()]
    show_rows("why grasps did not hold", why, as_json=False)
    spread = [{"diversity": name, "mean": value} for name, value in summary["diversity"].items()]
    if "method" in summary:
        show_rows("the method, per scene", [summary["method"]], as_json=False)
    show_rows("how different the grasps of a scene are", spread, as_json=False)
    checks = [{"check": name, **values} for name, values in summary["checks"].items()]
    show_rows("physics of the planned trials (metres, N)", checks, as_json=False)
