"""Settings, a store, and running stages for a person who watches."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dmfc.errors import DmfcError, MachineError, masked
from dmfc.experiment.console import stderr
from dmfc.experiment.signals import interrupted_status

if TYPE_CHECKING:
    from dmfc.config.presets import Presets
    from dmfc.config.schema import Config
    from dmfc.engine.engine import Outcomes, Watcher
    from dmfc.engine.ledger import Ledger
    from dmfc.engine.stage import Stage
    from dmfc.pipeline.graph import GraphBuilder


@dataclass(frozen=True)
class Session:
    """The settings and the store that one call works with."""

    config: Config
    ledger: Ledger
    builder: GraphBuilder

    @classmethod
    def open(
        cls,
        preset: Presets,
        overrides: Sequence[str] | None,
        store: Path,
        grasp_files: Mapping[str, Path] | None = None,
    ) -> Session:
        """`grasp_files`: see `GraphBuilder`."""
        from dmfc.config.load import load_config
        from dmfc.engine.ledger import Ledger
        from dmfc.pipeline.graph import GraphBuilder
        from dmfc.pipeline.selection import list_refs

        config = load_config(preset, overrides or [])
        ledger = Ledger(store)
        ledger.check_version()
        return cls(config, ledger, GraphBuilder(list_refs, grasp_files=grasp_files))

    def make(self, targets: Sequence[Stage]) -> Outcomes:
        """Run what is missing, shown on standard error; ends the program on Ctrl-C."""
        from dmfc.engine.watch import Progress
        from dmfc.pipeline.kinds import KINDS

        watcher = Progress(self.ledger, stderr(), KINDS)
        return run_shown(targets, self.ledger, self.config, watcher)


def run_shown(
    targets: Sequence[Stage], ledger: Ledger, config: Config, watcher: Watcher
) -> Outcomes:
    """Run stages, watched. Ctrl-C prints the line that resumes, and ends the program."""
    from dmfc.engine.engine import run_stages, unfinished
    from dmfc.pipeline.kinds import KINDS

    needed = unfinished(targets, ledger)
    if needed and config.run.ray_address:
        _share_packs(needed.values(), ledger)
    alone = len(needed) == 1
    # Ray prints the deaths of its processes on standard output, which belongs to the answer.
    with contextlib.redirect_stdout(sys.stderr), resumable():
        outcomes = run_stages(targets, ledger, config, KINDS, watcher=watcher, local=alone)
        if any(outcome.status == "interrupted" for outcome in outcomes.values()):
            raise KeyboardInterrupt
    return outcomes


def _share_packs(stages: Iterable[Stage], ledger: Ledger) -> None:
    """Put asset packs where the nodes of a cluster find them; each may have a cache that does."""
    from dmfc.pipeline.here import share_packs

    try:
        ledger.prepare()
        share_packs(stages, ledger.store)
    except MachineError as error:
        stderr().print(
            f"{error}; nodes need packs in caches of their own", markup=False, soft_wrap=True
        )


@contextlib.contextmanager
def resumable() -> Iterator[None]:
    """On Ctrl-C, SIGTERM, or where Ray's head is lost: print the line that resumes, and end."""
    from dmfc.engine.ray_cluster import HeadLostError

    try:
        yield
    except KeyboardInterrupt:
        _tell_how_to_go_on("stopped")
        raise typer.Exit(interrupted_status()) from None
    except HeadLostError as lost:
        _tell_how_to_go_on(str(lost))
        raise typer.Exit(1) from lost


def _tell_how_to_go_on(why: str) -> None:
    line = masked(shlex.join(["dmfc", *sys.argv[1:]]))
    stderr().print(
        f"{why}; finished stages are kept. Go on with:\n  {line}", soft_wrap=True, markup=False
    )


def require(outcomes: Mapping[str, Any], stages: Sequence[Stage]) -> None:
    """Raise DmfcError with the first reason if one of the stages is not there."""
    for stage in stages:
        outcome = outcomes[stage.address]
        if not outcome.ok:
            raise DmfcError(f"{stage.kind} {stage.name}: {outcome.reason}")


def failures(outcomes: Outcomes, stages: Sequence[Stage]) -> dict[str, str]:
    """Why those of the stages that are not there failed, by their names."""
    found = {stage.name: outcomes[stage.address] for stage in stages}
    return {name: outcome.reason for name, outcome in found.items() if not outcome.ok}
