"""Grasps of other projects as grasp sets: what `dmfc grasps import` does."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dmfc.errors import DmfcError
from dmfc.experiment.session import Session, failures, require

if TYPE_CHECKING:
    from dmfc.engine.stage import Stage
    from dmfc.grasps.exchange.foreign import ForeignGrasps
    from dmfc.grasps.exchange.hand_map import HandMap
    from dmfc.grasps.grasp_set import GraspSet

_MESH = re.compile(r"(^|-)(decomposed|simplified)$")
"""Names of the meshes of whole objects in the folders of DexGraspNet and DexGraspBench."""


@dataclass(frozen=True)
class ImportRequest:
    """What is imported."""

    format: str
    paths: Sequence[Path]
    """Files, or folders of them."""
    objects: str
    """Selector of the object, or of the objects by whose names files or folders go."""
    hand_map: str = ""
    """A YAML file; empty: the format's."""
    scale: float | None = None
    """Size of the object, where a file has several, metres."""
    tolerance: float = 0.01
    """rad beyond a joint's limits that is clipped; a grasp with more is skipped."""
    verify: bool = False
    """Keep only what holds in simulation."""


@dataclass(frozen=True)
class Imported:
    """What became of it, by the objects' ids."""

    sets: Mapping[str, GraspSet]
    failed: Mapping[str, str]
    """Why an object has no set."""
    strangers: Sequence[Path]
    """Files that go by the name of no object."""


def import_grasps(session: Session, request: ImportRequest) -> Imported:
    """Read grasps, and prepare the objects that they are for.

    Of several objects each takes the files by its name, and one that fails leaves the others be; of
    a single one the reason is raised as a DmfcError.
    """
    from dmfc.grasps.exchange.hand_map import load_hand_map
    from dmfc.grasps.exchange.read import files_of

    files = files_of(request.format, request.paths)
    objects = session.builder.selected_objects(session.config, [request.objects])
    if len(objects) > 1 and request.format != "graspit":
        objects = tuple(stage for stage in objects if _MESH.search(stage.name)) or objects
    alone = len(objects) == 1
    files_by_object = {objects[0]: files} if alone else _by_name(objects, files, request.paths)
    hand_map = load_hand_map(request.hand_map or request.format)
    read: dict[Stage, ForeignGrasps] = {}
    failed: dict[str, str] = {}
    for stage, of_object in files_by_object.items():
        try:
            foreign = _read(request, of_object, hand_map)
            read[_of_size(session, stage, foreign)] = foreign
        except DmfcError as error:
            if alone:
                raise
            failed[stage.name] = str(error)
    hand = session.builder.hand(session.config)
    outcomes = session.make([hand, *read])
    require(outcomes, [hand, *read] if alone else [hand])
    failed |= failures(outcomes, list(read))
    sets = {}
    for stage, foreign in read.items():
        try:
            if stage.name not in failed:
                sets[stage.name] = _converted(session, request, hand_map, hand, stage, foreign)
        except DmfcError as error:
            if alone:
                raise
            failed[stage.name] = str(error)
    known = {file for of_object in files_by_object.values() for file in of_object}
    return Imported(sets, failed, [file for file in files if file not in known])


def _read(request: ImportRequest, files: Sequence[Path], hand_map: HandMap) -> ForeignGrasps:
    from dmfc.grasps.exchange.read import read_foreign

    foreign = read_foreign(request.format, files, hand_map)
    return foreign.of_size(request.scale, files[0])


def _of_size(session: Session, stage: Stage, foreign: ForeignGrasps) -> Stage:
    """The object; a mesh of the user's own without a unit is a normalised one, times the scale."""
    from dmfc.objects.folder import scaled

    if not foreign.has_scales:
        return stage
    selector = scaled(stage.hints["selector"], float(foreign.scales[0]))
    if selector is None:
        return stage
    return session.builder.selected_objects(session.config, [selector])[0]


def _converted(
    session: Session,
    request: ImportRequest,
    hand_map: HandMap,
    hand_stage: Stage,
    stage: Stage,
    foreign: ForeignGrasps,
) -> GraspSet:
    from dmfc.grasps.exchange.convert import to_grasp_set, verified
    from dmfc.grasps.exchange.read import in_frame
    from dmfc.hand.description import load_description
    from dmfc.pipeline.artifacts import load_hand, load_object

    config = session.config
    hand = load_hand(session.ledger.verified(hand_stage.address), session.config.closing)
    model = load_object(session.ledger.verified(stage.address))
    description = load_description(config.hand.name)
    placed = in_frame(request.format, foreign, model)
    grasps = to_grasp_set(
        placed, hand_map, hand, description, model, config.grasps, request.tolerance
    )
    if request.verify:
        grasps = verified(grasps, hand, description, model, config.grasps, config.physics)
    grasps.notes.update(format=request.format, object_digest=stage.config["digest"])
    if stage.name.startswith("folder/"):
        grasps.notes["object_selector"] = stage.hints["selector"]
    return grasps


def _by_name(
    objects: Sequence[Stage], files: Sequence[Path], roots: Sequence[Path]
) -> dict[Stage, list[Path]]:
    """The files of each object: those that it, or a folder they are in, is named after.

    Raises DmfcError where no file goes by the name of an object.
    """
    found: dict[Stage, list[Path]] = {}
    for file in files:
        inside = [root for root in roots if root in file.parents]
        names = [*file.relative_to(inside[0]).parts[:-1], file.stem] if inside else [file.stem]
        if inside:
            names = [inside[0].resolve().name, *names]
        for name in sorted(names, key=len, reverse=True):
            named = [stage for stage in objects if _goes_by(stage, name)]
            if len(named) > 1:
                listed = ", ".join(stage.name for stage in named[:3])
                raise DmfcError(f"{file}: '{name}' names several objects ({listed})")
            if named:
                found.setdefault(named[0], []).append(file)
                break
    if not found:
        listed = ", ".join(stage.name for stage in objects[:3])
        raise DmfcError(
            f"no file or folder of {', '.join(map(str, roots))} is named after one of the "
            f"{len(objects)} objects ({listed}, ...; option --object)"
        )
    return found


def _goes_by(stage: Stage, name: str) -> bool:
    """Whether a name is that of an object, or of a folder with its mesh."""
    own = stage.name.split("/", 1)[1]
    return name in (own, stage.name.replace("/", "__")) or own.startswith(f"{name}-")
