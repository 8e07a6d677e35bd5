"""The verbs that carry grasps from and to other projects: `dmfc grasps import` and `export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import (
    PRESET,
    STORE,
    AsJson,
    Overrides,
    Preset,
    Store,
    end_if_failed,
    number,
    with_failures,
)
from dmfc.cli.outputs import folder_to_write, made
from dmfc.errors import unknown_name
from dmfc.experiment.console import show_rows, warn
from dmfc.experiment.session import Session, failures, require

if TYPE_CHECKING:
    from dmfc.engine.stage import Stage

Format = Annotated[
    str, typer.Argument(metavar="FORMAT", help="graspit, dexgraspnet or dexgraspbench.")
]
HandMapOption = Annotated[
    str,
    typer.Option(
        "--hand-map", help="YAML file that maps another robot file's hand; default: the format's."
    ),
]


def grasps_import(
    format_name: Format,
    paths: Annotated[list[Path], typer.Argument(help="Files, or folders of them.")],
    object_name: Annotated[
        str,
        typer.Option(
            "--object",
            help="The object that they grasp, such as ycb/mug or folder:mug.obj; or several, by "
            "whose names the files or their folders go, such as folder:meshes.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Grasp set to write (.parquet); of several, a folder."),
    ],
    hand_map: HandMapOption = "",
    scale: Annotated[
        float | None,
        typer.Option(
            help="Size of the object, where a file has several.", callback=number(above=0)
        ),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            help="rad beyond a joint's limits that are clipped; beyond that the grasp is skipped.",
            callback=number(least=0),
        ),
    ] = 0.01,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify", help="Keep only grasps that hold in simulation, and measure them."
        ),
    ] = False,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Read grasps of another project into grasp sets.

    Of several objects, one that fails is a row with its reason, and the others are written.
    """
    from dmfc.experiment.grasp_import import ImportRequest, import_grasps
    from dmfc.grasps.exchange.read import FORMATS

    if format_name not in FORMATS:
        raise unknown_name("format", format_name, FORMATS)
    request = ImportRequest(
        format_name, paths, object_name, hand_map, scale, tolerance=tolerance, verify=verify
    )
    found = import_grasps(Session.open(preset, overrides, store), request)
    several = len(found.sets) + len(found.failed) > 1
    rows = {}
    for name, grasps in found.sets.items():
        file = out / f"{name.replace('/', '__')}.parquet" if several else out
        grasps.save(made(file))
        rows[name] = {"object": name, "grasps": len(grasps), **grasps.notes, "file": str(file)}
    names, failed = [*found.sets, *found.failed], dict(found.failed)
    shown = with_failures(names, rows, failed) if failed else list(rows.values())
    show_rows("imported", shown, as_json)
    if found.strangers:
        count, first = len(found.strangers), found.strangers[0]
        warn([f"{count} files are of no object of --object {object_name}, such as {first}"])
    end_if_failed(failed, len(names))


def grasps_export(
    selectors: Annotated[
        list[str], typer.Argument(help="Objects whose grasps are exported, such as ycb:test.")
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="Folder for objects/ and grasps/.", callback=folder_to_write()
        ),
    ],
    hand_map: HandMapOption = "",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Write grasps and objects as DexGraspBench reads them; its evaluator can score them.

    An object that fails is a row with its reason, and the others are written.
    """
    from dmfc.grasps.exchange import dexgraspbench
    from dmfc.grasps.exchange.hand_map import load_hand_map
    from dmfc.hand.description import load_description
    from dmfc.pipeline.artifacts import load_grasps, load_hand, load_object

    mapped = load_hand_map(hand_map or "dexgraspbench")
    session = Session.open(preset, overrides, store)
    config, builder = session.config, session.builder
    objects = builder.selected_objects(config, selectors)
    sets = [builder.grasps_of(config, obj) for obj in objects]
    hand_stage = builder.hand(config)
    outcomes = session.make([hand_stage, *objects, *sets])
    require(outcomes, [hand_stage])
    failed = failures(outcomes, sets)

    def folder(stage: Stage) -> Path:
        return session.ledger.verified(stage.address)

    hand = load_hand(folder(hand_stage), config.closing)
    description = load_description(config.hand.name)
    rows = {}
    for obj, planned in zip(objects, sets, strict=True):
        if planned.name in failed:
            continue
        model = load_object(folder(obj))
        grasps = load_grasps(folder(planned))
        count = dexgraspbench.write(grasps, mapped, hand, description, model, out)
        rows[planned.name] = {"object": model.id, "grasps": count}
    names = [stage.name for stage in sets]
    show_rows(f"exported to {out}", with_failures(names, rows, failed), as_json)
    end_if_failed(failed, len(sets))
