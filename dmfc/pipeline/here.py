"""Inputs outside the store, on this machine: asset packs, and files of the user.

The process that planned a stage has read them. If they are missing or differ, it is an error of
the machine.
"""

from __future__ import annotations

import functools
import platform
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.engine.context import StageContext
from dmfc.engine.stage import Stage
from dmfc.errors import DmfcError, MachineError

if TYPE_CHECKING:
    from dmfc.objects.sources import ObjectSource


def with_packs(stage: Callable[[StageContext], None]) -> Callable[[StageContext], None]:
    """The stage, which takes asset packs from the store where this machine has none."""

    @functools.wraps(stage)
    def run(ctx: StageContext) -> None:
        from dmfc.assets import also_in

        with also_in(ctx.store):
            stage(ctx)

    return run


def share_packs(stages: Iterable[Stage], store: Path) -> None:
    """Put the asset packs that the stages use into the store, for the nodes of a cluster.

    Raises MachineError where a pack cannot be had or written.
    """
    from dmfc.assets import list_packs, share
    from dmfc.hand.description import load_description

    wanted = set()
    for stage in stages:
        wanted.add(stage.name.partition("/")[0] if stage.kind == "object" else "")
        if "hand" in stage.config:
            wanted.add(load_description(stage.config["hand"].name).pack)
    for pack in list_packs():
        if pack.name in wanted:
            share(pack.name, store)


def require_same(what: str, found: str, planned: str) -> None:
    """Raise MachineError where the digest of `what` here is not the one of the plan."""
    if found != planned:
        raise MachineError(
            f"{what} is not the same on {platform.node()} as where the stage was planned (has it "
            "changed since? run the same line again)"
        )


def check_custom_losses(digests: Mapping[str, str]) -> None:
    """Raises MachineError where the file of a user's loss is not that of the stage's key."""
    from dmfc.config.custom_function import custom_function

    for text, digest in digests.items():
        found = custom_function(text, "losses.custom").digest
        require_same(f"losses.custom: the file of '{text}'", found, digest)


def check_custom_backbone(digests: Mapping[str, str]) -> None:
    """Raises MachineError where the file of a user's backbone is not that of the stage's key."""
    from dmfc.config.custom_function import custom_class

    for text, digest in digests.items():
        found = custom_class(text, "network.backbone").digest
        require_same(f"network.backbone: the file of '{text}'", found, digest)


def check_custom_test(config: Mapping[str, Any]) -> None:
    """Raises MachineError where the file of a user's test is not that of the stage's key."""
    from dmfc.config.custom_function import custom_class

    if "custom_test" in config:
        text = config["execution"].test
        found = custom_class(text, "execution.test").digest
        require_same(f"execution.test: the file of '{text}'", found, config["custom_test"])


def source_here(ctx: StageContext) -> ObjectSource:
    """The source of the stage's object on this machine. Raises MachineError if it is not there."""
    from dmfc.objects.sources import find_object

    try:
        source = find_object(ctx.hints["selector"])
    except MachineError:
        raise
    except DmfcError as error:
        raise MachineError(f"{error} (on {platform.node()})") from error
    require_same(f"object '{source.id}'", source.digest, ctx.config["digest"])
    return source
