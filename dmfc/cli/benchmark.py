"""The verbs of the benchmark: test scenes as files, and grasps in files counted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dmfc.cli.common import PRESET, STORE, AsJson, Overrides, Preset, Store
from dmfc.cli.evaluate import report
from dmfc.cli.outputs import file_to_write, folder_to_write, made
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
        str,
        typer.Option(
            help="default, dexgraspbench, six_directions, or a YAML file; default: the preset's."
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
) -> None:
    """Execute grasps that lie in files, and print how many were held."""
    settings = [*(overrides or []), *scene_settings(scenes, protocol)]
    name = name or files[0].stem
    session, stages = score_files(files, preset, settings, store, name)
    report(read_evaluation(session, stages, name, preset), out, as_json)


@benchmark.command("record")
def benchmark_record(
    source: Annotated[
        str,
        typer.Argument(
            help="What `dmfc evaluate` takes, or a folder of .npz files of grasps; with --rows, "
            "trial rows that were measured before: FILE or FILE:CELL."
        ),
    ],
    out: Annotated[Path, typer.Argument(help="The entry.", callback=file_to_write(".json"))],
    test_set: Annotated[
        str, typer.Option("--set-name", help="single, standard, clutter, clutter-50 or single-16.")
    ] = "single",
    name: Annotated[str, typer.Option(help="What the row is called.")] = "",
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="key=value: which of the proposed grasps are executed. Repeatable."
        ),
    ] = None,
    rows: Annotated[
        str, typer.Option("--rows", help="Count rows that were measured before, so: command.")
    ] = "",
    store: Store = STORE,
) -> None:
    """Execute a method on a frozen test set, and write its entry for the leaderboard."""
    from dmfc.experiment.leaderboard import record, taken

    name = name or Path(source).stem
    if rows:
        entry = taken(source, test_set, name, rows)
    else:
        entry = record(source, test_set, overrides or [], store, name)
    entry.save(made(out))
    shown = {rate: entry.text(rate) for rate in ("overall", "valid", "success")}
    show_rows("entry", [{"method": entry.name, "set": entry.set, **shown}], as_json=False)


@benchmark.command("leaderboard")
def benchmark_leaderboard(
    folder: Annotated[Path, typer.Argument(help="Folder of entries (*.json).")],
) -> None:
    """Make README.md and index.html of the entries in a folder."""
    from dmfc.methods.named import load_benchmark
    from dmfc.report.leaderboard import write_pages

    paths = write_pages(folder, load_benchmark())
    show_rows("written", [{"page": str(path)} for path in paths], as_json=False)
