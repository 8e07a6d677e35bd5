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
    with_failures,
)
from dmfc.errors import DmfcError, unknown_name
from dmfc.experiment.console import show_rows
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
        str, typer.Option("--object", help="The object that they grasp, such as ycb/mug.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Grasp set to write (.parquet).")],
    hand_map: HandMapOption = "",
    scale: Annotated[
        float | None, typer.Option(help="Size of the object, where a file has several.")
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="rad beyond a joint's limits that is clipped, not refused.")
    ] = 0.01,
    verify: Annotated[
        bool, typer.Option("--verify", help="Keep only what holds in simulation, and measure it.")
    ] = False,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Read grasps of another project into a grasp set."""
    from dmfc.grasps.exchange.convert import to_grasp_set, verified
    from dmfc.grasps.exchange.hand_map import load_hand_map
    from dmfc.grasps.exchange.read import FORMATS, read_foreign
    from dmfc.hand.description import load_description
    from dmfc.pipeline.artifacts import load_hand, load_object

    if format_name not in FORMATS:
        raise unknown_name("format", format_name, FORMATS)
    session = Session.open(preset, overrides, store)
    config = session.config
    found = session.builder.selected_objects(config, [object_name])
    if len(found) != 1:
        raise DmfcError(f"--object {object_name} names {len(found)} objects, expected one")
    stages = [session.builder.hand(config), *found]
    require(session.make(stages), stages)
    hand_folder, object_folder = (session.ledger.folder(stage.address) for stage in stages)
    hand, model = load_hand(hand_folder), load_object(object_folder)
    description = load_description(config.hand.name)
    mapped = load_hand_map(hand_map or format_name)
    foreign = read_foreign(format_name, paths, mapped, model, scale)
    grasps = to_grasp_set(foreign, mapped, hand, description, model, config.grasps, tolerance)
    if verify:
        grasps = verified(grasps, hand, description, model, config.grasps, config.physics)
    grasps.notes.update(format=format_name, object_digest=found[0].config["digest"])
    out.parent.mkdir(parents=True, exist_ok=True)
    grasps.save(out)
    row = {"object": model.id, "grasps": len(grasps), **grasps.notes, "file": str(out)}
    show_rows("imported", [row], as_json)


def grasps_export(
    selectors: Annotated[
        list[str], typer.Argument(help="Objects whose grasps are exported, such as ycb:test.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for objects/ and grasps/.")],
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

    session = Session.open(preset, overrides, store)
    config, builder = session.config, session.builder
    objects = builder.selected_objects(config, selectors)
    sets = [builder.grasps_of(config, obj) for obj in objects]
    hand_stage = builder.hand(config)
    outcomes = session.make([hand_stage, *objects, *sets])
    require(outcomes, [hand_stage])
    failed = failures(outcomes, sets)

    def folder(stage: Stage) -> Path:
        return session.ledger.folder(stage.address)

    hand = load_hand(folder(hand_stage))
    description = load_description(config.hand.name)
    mapped = load_hand_map(hand_map or "dexgraspbench")
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
