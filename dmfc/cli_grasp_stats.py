"""`dmfc grasps stats`: what grasp sets hold, and what they are worth as labels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    stderr,
)
from dmfc.cli_data import Selectors, grasp_stages, object_stages
from dmfc.errors import DmfcError

if TYPE_CHECKING:
    from dmfc.grasps.grasp_set import GraspSet
    from dmfc.hand.model import HandModel
    from dmfc.objects.model import ObjectModel
    from dmfc.sweep.stage import Stage


def grasps_stats(
    selectors: Selectors = None,
    scenes: Annotated[
        int, typer.Option(help="Scenes made per object to match its labels in; 0: none.")
    ] = 4,
    sheet: Annotated[
        Path | None, typer.Option(help="Write a contact sheet of grasps here (.png; needs GL).")
    ] = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """What is in the grasp sets that are there already, per object and over all."""
    session = Session.open(preset, overrides, store)
    pairs = list(
        zip(object_stages(session, selectors), grasp_stages(session, selectors), strict=True)
    )
    there = [(obj, found) for obj, found in pairs if session.ledger.finished(found.address)]
    if not there:
        raise DmfcError(
            f"none of the {len(pairs)} grasp sets is planned yet: run `dmfc grasps plan`"
        )
    sets = load_sets(session, [found for _, found in there])
    rows = set_rows(session, sets)
    matching: list[dict[str, Any]] = []
    if scenes > 0 or sheet is not None:
        hand, objects = _prepared(session, [obj for obj, _ in there])
        if scenes > 0:
            matching = _match(session, sets, objects, hand, scenes, rows)
        if sheet is not None:
            _write_sheet(session, sets, objects, sheet)
    if as_json:
        answer({"objects": rows[:-1], "all": rows[-1], "matching": matching})
        return
    show_rows("grasps", rows, as_json=False)
    if matching:
        show_rows("matched in scenes of one object", matching, as_json=False)


def load_sets(session: Session, stages: Sequence[Stage]) -> list[GraspSet]:
    """The grasp sets that finished stages hold."""
    from dmfc.grasps.grasp_set import GraspSet

    return [GraspSet.load(session.ledger.folder(s.address) / "grasps.parquet") for s in stages]


def set_rows(session: Session, sets: Sequence[GraspSet]) -> list[dict[str, Any]]:
    """A row per object, and the last one over all."""
    import numpy as np

    from dmfc.grasps.stats import overall_row, set_row
    from dmfc.hand.description import load_description

    normal = np.array(load_description(session.config.hand.name).palm_normal)
    normal /= np.linalg.norm(normal)
    return [set_row(found, normal) for found in sets] + [overall_row(sets, normal)]


def _prepared(
    session: Session, stages: Sequence[Stage]
) -> tuple[HandModel, dict[str, ObjectModel]]:
    from dmfc.hand.model import HandModel
    from dmfc.objects.model import ObjectModel

    hand = session.builder.hand(session.config)
    require(session.make([hand, *stages]), [hand, *stages])
    folders = [session.ledger.folder(stage.address) for stage in (hand, *stages)]
    models = [ObjectModel.load(folder / "object.npz") for folder in folders[1:]]
    return HandModel.load(folders[0] / "hand.npz"), {model.id: model for model in models}


def _match(
    session: Session,
    sets: Sequence[GraspSet],
    objects: dict[str, ObjectModel],
    hand: HandModel,
    scenes: int,
    rows: list[dict[str, Any]],
) -> list[dict[str, Any]]:
    """Adds each row's shares under the mode of the settings; returns a row per mode, over all."""
    from dmfc.scenes.label_stats import label_row, single_scenes
    from dmfc.scenes.stats import MODES

    config = session.config
    grasps = {found.object_id: found for found in sets}
    with stderr().status("scenes") as status:
        made = single_scenes(config.scenes, objects, grasps, hand, scenes, status.update)
    matching, seeds = config.matching, config.network.levels[0]
    everything = [scene for own in made.values() for scene in own]
    parts = [*(made[found.object_id] for found in sets), everything]
    for row, part in zip(rows, parts, strict=True):
        found = label_row(part, grasps, hand, matching, seeds)
        row["labels_per_scene"] = found["labels_per_scene"]
        row["positive_seeds"] = found[f"{matching.mode}_positive"]
        row["unmatched_labels"] = found[f"{matching.mode}_unmatched"]
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
    from dmfc.grasps.picture import contact_sheet
    from dmfc.hand.description import load_description

    description = load_description(session.config.hand.name)
    pairs = [(objects[found.object_id], found) for found in sets]
    path.parent.mkdir(parents=True, exist_ok=True)
    contact_sheet(pairs, description, session.config.physics).save(path)
