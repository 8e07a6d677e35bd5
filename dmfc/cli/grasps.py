"""Verbs on grasps: planning; statistics and exchange have files of their own."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import PRESET, STORE, AsJson, Overrides, Preset, Store, end_if_failed
from dmfc.cli.outputs import folder_to_write
from dmfc.experiment.console import show_rows, stderr
from dmfc.experiment.session import Session, failures
from dmfc.grasps.library import file_name

if TYPE_CHECKING:
    from dmfc.engine.stage import Stage
    from dmfc.grasps.grasp_set import GraspSet

from dmfc.cli.objects import Selectors, object_stages

grasps = typer.Typer(no_args_is_help=True, help="Ground-truth grasps, planned per object.")


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


def grasp_stages(session: Session, selectors: list[str] | None) -> list[Stage]:
    return [
        session.builder.grasps_of(session.config, obj) for obj in object_stages(session, selectors)
    ]
