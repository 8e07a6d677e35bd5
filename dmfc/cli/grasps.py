"""The commands that plan grasps and print their statistics; `exchange.py` has the others."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
from dmfc.cli.objects import Selectors, object_stages
from dmfc.cli.outputs import file_to_write, folder_to_write
from dmfc.errors import DmfcError
from dmfc.experiment.console import answer, show_rows, stderr
from dmfc.experiment.session import Session, failures, require
from dmfc.grasps.library import file_name
from dmfc.pipeline.artifacts import GRASPS, Objects, load_grasps, load_hand

if TYPE_CHECKING:
    from dmfc.engine.stage import Stage
    from dmfc.grasps.grasp_set import GraspSet
    from dmfc.hand.model import HandModel
    from dmfc.objects.model import ObjectModel

grasps = typer.Typer(no_args_is_help=True, help="Ground-truth grasps, planned per object.")

ALL = ""
"""In place of an object: all of them."""


@grasps.command("plan")
def grasps_plan(
    selectors: Selectors = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Also copy sets that have grasps into this library folder.",
            callback=folder_to_write(),
        ),
    ] = None,
) -> None:
    """Plan grasps for objects and check each in simulation.

    An object that cannot be prepared or planned is a row with its reason; the others are planned,
    printed and copied all the same. Ends with status 1 if any failed, or if none has a grasp.
    """
    session = Session.open(preset, overrides, store)
    stages = grasp_stages(session, selectors)
    failed = failures(session.make(stages), stages)
    planned = [stage for stage in stages if stage.name not in failed]
    sets = load_sets(session, planned)
    if out is not None:
        _copy_to_library(session, planned, sets, out)
    names = [stage.name for stage in stages]
    show_rows("grasps", set_rows(session, names, sets, failed), as_json)
    end_if_failed(failed, len(stages))
    if not any(len(found) for found in sets):
        stderr().print("no object has a grasp (settings grasps.max_checks, grasps.max_batches)")
        raise typer.Exit(1)


def _copy_to_library(
    session: Session, stages: Sequence[Stage], sets: Sequence[GraspSet], folder: Path
) -> None:
    """A set without a grasp is not copied: the library lacks that object."""
    for stage, found in zip(stages, sets, strict=True):
        if not len(found):
            continue
        path = folder / file_name(session.config.hand.name, stage.name)
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(session.ledger.verified(stage.address) / GRASPS, path)


def grasp_stages(session: Session, selectors: list[str] | None) -> list[Stage]:
    return [
        session.builder.grasps_of(session.config, obj) for obj in object_stages(session, selectors)
    ]


@grasps.command("stats")
def grasps_stats(
    selectors: Selectors = None,
    scenes: Annotated[
        int, typer.Option(help="Scenes made per object to match its labels in; 0: none.", min=0)
    ] = 4,
    sheet: Annotated[
        Path | None,
        typer.Option(
            help="Write a contact sheet of grasps here (.png; needs GL).",
            callback=file_to_write(".png"),
        ),
    ] = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Statistics of existing grasp sets, per object and over all.

    Objects without a planned set are counted on standard error. An object that failed is a row
    with its reason. Ends with status 1 if no object has a set.
    """
    session = Session.open(preset, overrides, store)
    pairs = list(
        zip(object_stages(session, selectors), grasp_stages(session, selectors), strict=True)
    )
    there = [(obj, found) for obj, found in pairs if session.ledger.finished(found.address)]
    if not there:
        raise DmfcError(
            f"none of the {len(pairs)} grasp sets is planned yet: run `dmfc grasps plan`"
        )
    if len(there) < len(pairs):
        stderr().print(f"{len(pairs) - len(there)} of {len(pairs)} grasp sets are not planned yet")
    names = [obj.name for obj, _ in there]
    failed = _kept_failures(session, [found for _, found in there])
    hand, objects = _prepared(session, [obj for obj, _ in there if obj.name not in failed], failed)
    sets = load_sets(session, [found for obj, found in there if obj.name not in failed])
    more, matching = _measure(session, sets, objects, hand, scenes)
    rows = set_rows(session, names, sets, failed, more)
    if sheet is not None and sets:
        _write_sheet(session, sets, objects, sheet)
    if as_json:
        overall = rows.pop() if sets else None
        answer({"objects": rows, "all": overall, "matching": matching})
    else:
        show_rows("grasps", rows, as_json=False)
        if matching:
            show_rows("matched in scenes of one object", matching, as_json=False)
    if not sets:
        end_if_failed(failed, len(there))


def _kept_failures(session: Session, stages: Sequence[Stage]) -> dict[str, str]:
    """Why those of finished stages failed that did, by their names."""
    failures_by_name = {stage.name: session.ledger.failure(stage.address) for stage in stages}
    return {name: reason for name, reason in failures_by_name.items() if reason is not None}


def load_sets(session: Session, stages: Sequence[Stage]) -> list[GraspSet]:
    """The grasp sets that finished stages hold."""
    return [load_grasps(session.ledger.verified(stage.address)) for stage in stages]


def set_rows(
    session: Session,
    names: Sequence[str],
    sets: Sequence[GraspSet],
    failed: Mapping[str, str],
    more: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[dict[str, Any]]:
    """A row per object of `names`, which has a set or failed, and the last one over all sets.

    `more`: further columns by object, those over all under ALL. Without a set the last one is not
    there.
    """
    import numpy as np

    from dmfc.grasps.stats import overall_row, set_row
    from dmfc.hand.description import load_description

    normal = np.array(load_description(session.config.hand.name).palm_normal)
    normal /= np.linalg.norm(normal)
    more = more or {}
    rows = {
        found.object_id: set_row(found, normal) | dict(more.get(found.object_id, {}))
        for found in sets
    }
    listed = list(names)
    if sets:
        last = overall_row(sets, normal) | dict(more.get(ALL, {}))
        rows[last["object"]] = last
        listed.append(last["object"])
    return with_failures(listed, rows, failed, ("object", "grasps"))


def _prepared(
    session: Session, stages: Sequence[Stage], failed: dict[str, str]
) -> tuple[HandModel, dict[str, ObjectModel]]:
    """The hand and the objects by id; those that cannot be prepared are added to `failed`."""
    hand = session.builder.hand(session.config)
    outcomes = session.make([hand, *stages])
    require(outcomes, [hand])
    failed |= failures(outcomes, stages)
    folders = [session.ledger.verified(s.address) for s in stages if s.name not in failed]
    hand_folder = session.ledger.verified(hand.address)
    return load_hand(hand_folder, session.config.closing), dict(Objects(folders))


def _measure(
    session: Session,
    sets: Sequence[GraspSet],
    objects: dict[str, ObjectModel],
    hand: HandModel,
    scenes: int,
) -> tuple[dict[str, dict[str, Any]], list[dict[str, Any]]]:
    """Columns that need hand and object, by object and ALL, and the rows of the matching modes."""
    import numpy as np

    from dmfc.grasps.grip import grip_row, grips

    classes = {found.object_id: grips(found, hand, objects[found.object_id]) for found in sets}
    more = {name: grip_row(rows) for name, rows in classes.items()}
    more[ALL] = grip_row(np.concatenate([*classes.values(), np.zeros(0)]))
    matching = _match(session, sets, objects, hand, scenes, more) if scenes > 0 and sets else []
    return more, matching


def _match(
    session: Session,
    sets: Sequence[GraspSet],
    objects: dict[str, ObjectModel],
    hand: HandModel,
    scenes: int,
    columns: dict[str, dict[str, Any]],
) -> list[dict[str, Any]]:
    """Adds each object's shares under the mode of the settings; a row per mode, over all."""
    from dmfc.scenes.publish.label_stats import label_row, single_scenes
    from dmfc.scenes.publish.stats import MODES

    config = session.config
    grasps = {found.object_id: found for found in sets}
    with stderr().status("scenes") as status:
        made = single_scenes(config.scenes, objects, grasps, hand, scenes, status.update)
    matching, seeds = config.matching, config.network.levels[0]
    everything = [scene for scenes in made.values() for scene in scenes]
    for name, part in (*made.items(), (ALL, everything)):
        found = label_row(part, grasps, hand, matching, seeds)
        columns[name]["labels_per_scene"] = found["labels_per_scene"]
        columns[name]["positive_seeds"] = found[f"{matching.mode}_positive"]
        columns[name]["unmatched_labels"] = found[f"{matching.mode}_unmatched"]
    return [
        {
            "mode": mode + (" (set)" if mode == matching.mode else ""),
            "scenes": len(everything),
            "positive_seeds": found[f"{mode}_positive"],
            "unmatched_labels": found[f"{mode}_unmatched"],
        }
        for mode in MODES
    ]


def _write_sheet(
    session: Session, sets: Sequence[GraspSet], objects: dict[str, ObjectModel], path: Path
) -> None:
    from dmfc.hand.description import load_description
    from dmfc.visualization.grasp_sheet import contact_sheet

    description = load_description(session.config.hand.name)
    pairs = [(objects[found.object_id], found) for found in sets]
    path.parent.mkdir(parents=True, exist_ok=True)
    contact_sheet(pairs, description, session.config.physics).save(path)
