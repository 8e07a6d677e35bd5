"""The verbs on one model: train and evaluate."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from dmfc.cli_common import (
    PRESET,
    STORE,
    AsJson,
    Overrides,
    Preset,
    Session,
    Store,
    answer,
    require,
    show_rows,
)
from dmfc.errors import unknown_name

Model = Annotated[
    str, typer.Option("--model", help="pretrained, finetuned, planner (ceiling) or random (floor).")
]


def train(
    stage: Annotated[
        str, typer.Option("--stage", help="pretrain, or finetune (pretrains first if need be).")
    ] = "finetune",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Train a model, with all that it needs, and print its last epoch."""
    if stage not in ("pretrain", "finetune"):
        raise unknown_name("stage", stage, ("pretrain", "finetune"))
    session = Session.open(preset, overrides, store)
    built = session.builder.cell(
        session.config, "pretrained" if stage == "pretrain" else "finetuned", "train"
    ).model
    assert built is not None
    require(session.make([built]), [built])
    folder = session.ledger.folder(built.address)
    lines = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    if as_json:
        answer({"stage": built.address, "folder": str(folder), "metrics": lines})
        return
    last = {line["split"]: line for line in lines}
    rows = [{"metric": name, "value": v} for line in last.values() for name, v in line.items()]
    show_rows(f"{stage}: last epoch", rows, as_json=False)
    typer.echo(f"weights and metrics: {folder}")


def evaluate(
    model: Model = "finetuned",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
    only: Annotated[
        str, typer.Option("--only", help="scene:trial, one trial once more, with a picture.")
    ] = "",
    picture: Annotated[Path, typer.Option(help="Where --only writes its strip of frames.")] = Path(
        "trial.png"
    ),
) -> None:
    """Execute a model's grasps on the test scenes in MuJoCo, and print its rates."""
    from dmfc.report.formats import rate_text, to_json
    from dmfc.report.rates import concatenate
    from dmfc.report.table import NAMES, CellRows, make_table
    from dmfc.sweep.sweep_file import MODELS

    if model not in MODELS:
        raise unknown_name("model", model, MODELS)
    session = Session.open(preset, overrides, store)
    config = session.config
    stages = session.builder.cell(config, model, model).evaluations
    require(session.make(stages), stages)
    if only:
        from dmfc.sweep.replay import replay

        outcome = replay(session.ledger, stages, only, picture)
        answer({**asdict(outcome), "picture": str(picture)})
        return
    import pandas as pd

    paths = [session.ledger.folder(stage.address) / "trials.parquet" for stage in stages]
    rows = concatenate([pd.read_parquet(path) for path in paths])
    trials = config.execution.grasps_per_scene * config.scenes.test.count
    cell = CellRows(model, model, config.execution.seed, trials, rows)
    table = make_table([cell], id="evaluate", name=model, title=model, preset=preset)
    if as_json:
        answer({**to_json(table)["cells"][model], "files": [str(path) for path in paths]})
        return
    row = table.rows[0]
    shown = [
        {"rate": name, "of": row.rate(name).trials, "value": rate_text(row.rate(name))}
        for name in NAMES
    ]
    show_rows(f"{model} ({preset}), {trials} trials", shown, as_json=False)
    why = [{"reason": reason, "trials": count} for reason, count in row.reasons.items()]
    show_rows("why grasps did not hold", why, as_json=False)
