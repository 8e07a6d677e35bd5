"""The kinds of stage: where each one's function is, its version, and what it may use."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dmfc.config.schema import Config
from dmfc.config.sweep import StageLimits
from dmfc.errors import unknown_name


def _one_cpu(config: Config) -> int:
    return 1


def _no_gpu(config: Config) -> float:
    return 0.0


@dataclass(frozen=True)
class Effort:
    """How much work a stage is."""

    units: float = 1.0
    """Each takes about the same time."""
    like: str = ""
    """Stages of a kind that say the same here have units of the same time."""
    guess: float = 1.0
    """Seconds of a unit where none was measured."""


Measure = Callable[[Mapping[str, Any], Sequence[Mapping[str, Any]]], Effort]
"""Effort of a stage from its settings, and from those of the input that its work follows from."""


def _one_unit(config: Mapping[str, Any], sizes: Sequence[Mapping[str, Any]]) -> Effort:
    return Effort()


@dataclass(frozen=True)
class StageKind:
    """How one kind of stage is run.

    `entry` is 'package.module:function', imported in the worker alone. Raise `version` when a
    change of the code changes what the stage writes: what the old code made is then made again.
    A kind that `may_fail` is finished by a failure too: those that use it must look.
    """

    name: str
    entry: str
    version: int
    cpus: Callable[[Config], int] = _one_cpu
    gpus: Callable[[Config], float] = _no_gpu
    may_fail: bool = False
    identity: tuple[str, ...] = ()
    """Settings that make two stages of this kind two things, not one thing at two settings."""
    effort: Measure = _one_unit
    sized_by: str = ""
    """The input that the work of a stage follows from; empty: from its own settings alone."""

    def limits(self, config: Config) -> StageLimits:
        """The settings `run.<kind>`, with what the kind itself wants where they say nothing."""
        given: StageLimits = getattr(config.run, self.name, StageLimits())
        return dataclasses.replace(
            given,
            cpus=given.cpus or self.cpus(config),
            gpus=given.gpus or self.gpus(config),
            retries=config.run.retries if given.retries < 0 else given.retries,
        )


Registry = Mapping[str, StageKind]


def registry(*kinds: StageKind) -> dict[str, StageKind]:
    """The kinds by name."""
    return {kind.name: kind for kind in kinds}


def kind_of(name: str, kinds: Registry) -> StageKind:
    """The kind called `name`. Raises DmfcError naming the nearest one."""
    if name not in kinds:
        raise unknown_name("kind of stage", name, kinds)
    return kinds[name]
