"""Why a stage is not in the ledger: what differs from the finished stage that is most like it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from dmfc.engine.kinds import Registry, kind_of
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage, differences, plain

SHOWN = 3
"""Differences named; of the rest the number alone."""


def reasons(stages: Iterable[Stage], ledger: Ledger, kinds: Registry) -> dict[str, str]:
    """Why each stage that is not finished must run, by address; inputs come before their users.

    A stage's own settings come first ('losses.weights.collision 1.0 -> 2.0'); without a difference
    there, the inputs that are made again, or that it has never been made.
    """
    explained: dict[str, str] = {}
    records: dict[str, list[dict[str, Any]]] = {}
    for stage in stages:
        if ledger.finished(stage.address):
            continue
        if stage.kind not in records:
            records[stage.kind] = list(ledger.records(stage.kind))
        identity = kind_of(stage.kind, kinds).identity
        explained[stage.address] = _reason(stage, identity, records[stage.kind], explained)
    return explained


def _reason(
    stage: Stage,
    identity: Sequence[str],
    known: Sequence[dict[str, Any]],
    explained: Mapping[str, str],
) -> str:
    settings = plain(stage.config)
    candidates = [
        record
        for record in known
        if all(record["config"].get(name) == settings.get(name) for name in identity)
    ]
    if not candidates:
        return "never made"
    found = [_changes(stage, settings, record) for record in candidates]
    likest = min(
        range(len(found)), key=lambda i: (candidates[i]["name"] != stage.name, len(found[i]), -i)
    )
    if found[likest]:
        shown = found[likest][:SHOWN]
        more = len(found[likest]) - len(shown)
        return "; ".join(shown) + (f"; and {more} more" if more else "")
    rerun = [parent for parent in stage.parents if parent.address in explained]
    if rerun:
        names = ", ".join(f"{parent.kind} {parent.name}" for parent in rerun[:SHOWN])
        others = f" and {len(rerun) - SHOWN} more" if len(rerun) > SHOWN else ""
        return f"its inputs are made again: {names}{others}"
    return "its inputs are others"


def _changes(stage: Stage, settings: Any, record: Mapping[str, Any]) -> list[str]:
    version = record.get("stage_version")
    head = [] if version == stage.version else [f"code version {version} -> {stage.version}"]
    return head + list(differences(record["config"], settings))
