"""Verbs on objects."""

from __future__ import annotations

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
from dmfc.experiment.console import show_rows, warn
from dmfc.experiment.session import Session, failures

if TYPE_CHECKING:
    from dmfc.engine.stage import Stage

objects = typer.Typer(no_args_is_help=True, help="Objects and their preparation.")

Selectors = Annotated[
    list[str] | None,
    typer.Argument(
        help="Such as ycb:test, procedural:24, ycb/mug or folder:/path?unit=mm; "
        "default: the preset's training and test objects."
    ),
]


@objects.command("list")
def objects_list(
    selectors: Selectors = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """List the objects that selectors name, with licence, mass, and whether they are prepared."""
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
    from dmfc.objects.mass import implausible_mass
    from dmfc.pipeline.artifacts import load_object

    session = Session.open(preset, overrides, store)
    stages = object_stages(session, selectors)
    failed = failures(session.make(stages), stages)
    rows, warnings = {}, []
    for stage in stages:
        if stage.name in failed:
            continue
        model = load_object(session.ledger.verified(stage.address))
        rows[stage.name] = {
            "object": model.id,
            "faces": len(model.faces),
            "watertight": bool(model.watertight),
            "mass_kg": float(model.mass),
            "convex_parts": len(model.convex_parts),
            "stable_poses": len(model.stable_rotations),
            "notes": "; ".join(model.notes),
        }
        warnings.append(implausible_mass(model))
    names = [stage.name for stage in stages]
    show_rows("prepared objects", with_failures(names, rows, failed), as_json)
    warn(warnings)
    end_if_failed(failed, len(stages))


def object_stages(session: Session, selectors: list[str] | None) -> list[Stage]:
    if selectors:
        return list(session.builder.selected_objects(session.config, selectors))
    config = session.config
    return [s for split in ("train", "test") for s in session.builder.objects(config, split)]
