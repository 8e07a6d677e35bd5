"""The verbs of outcome predictors: train one, and export the trials that it learned from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import PRESET, STORE, AsJson, Overrides, Preset, Store
from dmfc.experiment.console import answer, show_rows
from dmfc.experiment.session import Session, require

if TYPE_CHECKING:
    from dmfc.engine.stage import Stage

Model = Annotated[
    str,
    typer.Argument(help="Model whose predictions are executed: a shipped one's name or a folder."),
]
outcome_app = typer.Typer(
    help="Predictors of the outcome of a grasp, trained on executed predictions.",
    no_args_is_help=True,
)


@outcome_app.command("train")
def outcome_train(
    model: Model,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Execute a model's predictions in scenes of outcome.objects, and learn from them."""
    session, stage = _opened(model, preset, overrides, store)
    require(session.make([stage]), [stage])
    folder = session.ledger.folder(stage.address)
    about = json.loads((folder / "outcome.json").read_text())["unseen_objects"]
    if as_json:
        answer({"stage": stage.address, "folder": str(folder), "unseen_objects": about})
        return
    rows = [{"quantity": name, "value": v} for name, v in about.items() if name != "reliability"]
    show_rows("on objects that it did not learn from", rows, as_json=False)
    typer.echo(f"predictor: {folder}")


@outcome_app.command("test")
def outcome_test(
    model: Model,
    predictor: Annotated[
        Path | None,
        typer.Option(
            "--predictor",
            help="Folder of the predictor that is asked.",
            show_default="the one of the model",
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", help="Write the reliability diagram as a PNG.")
    ] = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Execute a model's predictions in scenes of outcome.objects, and ask a predictor about them.

    The objects are to be others than those that the predictor learned from.
    """
    from dmfc.experiment.outcome import judged_on
    from dmfc.prediction.models import model_folder

    session, stage = _opened(model, preset, overrides, store)
    rows = judged_on(session, stage, predictor or model_folder(model))
    if picture is not None:
        from dmfc.visualization.reliability import draw_reliability

        draw_reliability(rows, picture)
    if not as_json:
        rows = [{name: v for name, v in row.items() if name != "reliability"} for row in rows]
    show_rows("what the predictor said, and what became of it", rows, as_json=as_json)


@outcome_app.command("export")
def outcome_export(
    model: Model,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to make.")],
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
) -> None:
    """Write the executed predictions as a data set: rows, scenes and a card."""
    from dmfc.execution.rollouts import ROLLOUTS
    from dmfc.outcome.dataset import export_trials
    from dmfc.pipeline.stages import SCENES, present

    session, stage = _opened(model, preset, overrides, store)
    trials = stage.inputs["rollouts"]
    assert isinstance(trials, tuple)
    session.make(trials)
    folders = present([session.ledger.folder(item.address) for item in trials])
    files = [(folder / ROLLOUTS, folder / SCENES) for folder in folders]
    presets = ", ".join(f"`{name}`" for name in preset)
    about = f"Predictions of the model `{Path(model).name}`, executed under the preset {presets}."
    count = export_trials(files, out, about)
    typer.echo(f"written: {out} ({count} trials)")


def _opened(
    model: str, preset: list[str], overrides: list[str] | None, store: Path
) -> tuple[Session, Stage]:
    """The session, and the predictor's stage."""
    from dmfc.pipeline.graph_outcome import outcome
    from dmfc.prediction.models import model_folder

    session = Session.open(preset, overrides, store)
    return session, outcome(session.builder, session.config, model_folder(model))
