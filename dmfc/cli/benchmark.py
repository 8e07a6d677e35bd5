"""The verbs of the benchmark: test scenes as files, and grasps in files counted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dmfc.cli.common import PRESET, STORE, AsJson, Overrides, Preset, Store
from dmfc.cli.evaluate import report
from dmfc.cli.outputs import folder_to_write
from dmfc.experiment.benchmark import export_scenes, score_files
from dmfc.experiment.console import answer, show_rows
from dmfc.experiment.evaluation import read_evaluation, scene_settings
from dmfc.experiment.session import Session

benchmark = typer.Typer(
    no_args_is_help=True, help="Your own method on the same scenes, in any language."
)
Scenes = Annotated[
    str,
    typer.Option(
        help="Test scenes: single, single_standard or multi, and how many, such as multi:100; "
        "default: the preset's."
    ),
]


@benchmark.command("export")
def benchmark_export(
    out: Annotated[
        Path,
        typer.Argument(help="Folder for scenes, hand and README.", callback=folder_to_write()),
    ],
    scenes: Scenes = "",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Write the test scenes as .npz files, with the hand and a README that says what to answer."""
    session = Session.open(preset, [*(overrides or []), *scene_settings(scenes, "")], store)
    options = [f"--preset={name}" for name in preset]
    options += [f"--set={text}" for text in overrides or []]
    options += [f"--scenes={scenes}"] if scenes else []
    written = export_scenes(session, out, options)
    if as_json:
        answer({"folder": str(out), "scenes": [path.name for path in written]})
    else:
        show_rows("written", [{"folder": str(out), "scenes": len(written)}], as_json=False)


@benchmark.command("score")
def benchmark_score(
    files: Annotated[
        list[Path],
        typer.Argument(help="Grasps: .npz or .parquet files, one per scene, or folders of them."),
    ],
    name: Annotated[str, typer.Option(help="What the row is called.")] = "",
    scenes: Scenes = "",
    protocol: Annotated[
        str, typer.Option(help="default, dexgraspbench, or a YAML file; default: the preset's.")
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
) -> None:
    """Execute grasps that lie in files, and print how many were held."""
    settings = [*(overrides or []), *scene_settings(scenes, protocol)]
    name = name or files[0].stem
    session, stages = score_files(files, preset, settings, store, name)
    report(read_evaluation(session, stages, name, preset), out, as_json)
