"""Training objects that a sweep goes on without, and why: a table must say what it is of."""

from __future__ import annotations

from collections.abc import Mapping

from dmfc.engine.ledger import Ledger

SHOWN = 3
"""Objects named in a terminal; files have all."""


def left_out(ledger: Ledger, stages: Mapping[str, str]) -> dict[str, str]:
    """Reason by object, of those that `stages` (name by address) prepared or planned in vain."""
    reasons: dict[str, str] = {}
    for kind in ("object", "grasps"):  # without an object there are no grasps: one reason is enough
        for address, name in stages.items():
            if address.startswith(f"{kind}/") and name not in reasons:
                reason = ledger.failure(address)
                if reason is not None:
                    reasons[name] = reason
    return dict(sorted(reasons.items()))


def left_out_line(reasons: Mapping[str, str] | None, most: int | None = None) -> str:
    """'Training objects left out: none.', or each with its reason, `most` of them at most."""
    if reasons is None:  # a table of before they were kept
        return "Training objects left out: not recorded."
    told = [f"{name} ({reason})" for name, reason in reasons.items()]
    hidden = len(told[most:]) if most else 0
    more = f", and {hidden} more" if hidden else ""
    count = f"{len(told)}: " if told else ""
    return f"Training objects left out: {count}{', '.join(told[:most]) or 'none'}{more}."
