"""A search: Optuna suggests settings; validation says how good they are.

    kind: search
    search:
      trials: 20
      parallel: 2                          # suggested at once; the next ones know their results
      objective: {coverage: 1, penetration_mm: -0.01}   # sum of validation measures, maximised
      space:
        losses.weights.collision: {low: 0.01, high: 10, log: true}
        losses.weights.confidence: [0.5, 1, 2]

What is suggested next is a function of this and of the results so far alone. So a search needs no
state but its trials' settings: it goes on after any death, on any machine that sees the store.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dmfc.config.load import checked
from dmfc.config.ranges import all_types
from dmfc.config.setting import GREATEST_SEED
from dmfc.config.validation import MEASURES
from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError, unknown_name
from dmfc.pipeline.artifacts import load_metrics
from dmfc.sweep.yaml_checks import mapping, only_keys, shortened

DIGITS = 4
"""Significant digits of a suggested number: what a person can read, and copy into a sweep file."""
Settings = Mapping[str, Any]
COUNTS = {"trials": (1, 100_000), "parallel": (1, 1000), "seed": (0, GREATEST_SEED)}
"""Least and greatest of each number of a search."""


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`; with `log`, equally likely in each decade."""

    low: float
    high: float
    log: bool = False


@dataclass(frozen=True)
class Search:
    """What is searched, and for what."""

    trials: int
    space: Mapping[str, Range | tuple[Any, ...]]
    """Setting -> its range, or its choices."""
    objective: Mapping[str, float]
    """Validation measure -> its weight in the sum that is maximised."""
    parallel: int = 1
    seed: int = 0


def parse_search(given: Any, where: str) -> Search:
    """The `search` of a sweep file. Raises DmfcError on anything odd in it."""
    values = mapping(given, where)
    only_keys(values, ("trials", "parallel", "seed", "objective", "space"), where)
    for name, (least, greatest) in COUNTS.items():
        number = values.get(name, least)
        if type(number) is not int or not least <= number <= greatest:
            raise DmfcError(
                f"{where}: {name} wants a whole number from {least} to {greatest}, not "
                f"{shortened(number)}"
            )
    if "trials" not in values:
        raise DmfcError(f"{where}: wants 'trials', how many to make")
    objective = mapping(values.get("objective") or {}, f"{where}: objective")
    space = mapping(values.get("space") or {}, f"{where}: space")
    if not objective or not space:
        raise DmfcError(f"{where}: wants 'objective' and 'space', each with at least one entry")
    for name, weight in objective.items():
        if name not in MEASURES:
            raise DmfcError(f"{where}: {unknown_name('validation measure', str(name), MEASURES)}")
        if type(weight) not in (int, float) or not math.isfinite(weight):
            raise DmfcError(f"{where}: objective: {name} wants a number, not {shortened(weight)}")
    return Search(
        trials=values["trials"],
        space={str(name): _domain(str(name), item, where) for name, item in space.items()},
        objective={str(name): float(weight) for name, weight in objective.items()},
        parallel=values.get("parallel", 1),
        seed=values.get("seed", 0),
    )


def suggest(
    search: Search, results: Sequence[tuple[Settings, float | None]], count: int
) -> list[dict[str, Any]]:
    """Settings of the next `count` trials, given those so far and their values (None: failed)."""
    import numpy as np
    import optuna
    from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
    from optuna.trial import TrialState, create_trial

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    space: dict[str, BaseDistribution] = {
        name: FloatDistribution(domain.low, domain.high, log=domain.log)
        if isinstance(domain, Range)
        else CategoricalDistribution(domain)
        for name, domain in search.space.items()
    }
    # Each round draws other numbers, and the same ones whenever it is drawn again.
    drawn = np.random.SeedSequence([search.seed, len(results)]).generate_state(1)
    sampler = optuna.samplers.TPESampler(seed=int(drawn[0]), constant_liar=True)
    study = optuna.create_study(direction="maximize", sampler=sampler)
    for settings, value in results:
        # As pruned: Optuna forgets what failed, and would suggest the same again.
        state = TrialState.PRUNED if value is None else TrialState.COMPLETE
        study.add_trial(
            create_trial(state=state, value=value, params=dict(settings), distributions=space)
        )
    suggested = [study.ask(fixed_distributions=space).params for _ in range(count)]
    return [
        {name: _rounded(settings[name], domain) for name, domain in search.space.items()}
        for settings in suggested
    ]


def measures_of(ledger: Ledger, model: str) -> dict[str, float]:
    """What the last validation of a finished model measured, by name."""
    lines = load_metrics(ledger.verified(model))
    last = [line for line in lines if line["split"] == "val"][-1:]
    return {name: float(line[name]) for line in last for name in MEASURES if name in line}


def objective_of(ledger: Ledger, model: str, objective: Mapping[str, float]) -> float | None:
    """The value of a finished model; None where a measure is missing or not finite."""
    found = measures_of(ledger, model)
    value = sum(weight * found.get(name, math.nan) for name, weight in objective.items())
    return value if math.isfinite(value) else None


def _domain(name: str, given: Any, where: str) -> Range | tuple[Any, ...]:
    """The values of a setting that a search may suggest; both ends, or each, must be valid."""
    if isinstance(given, list) and given:
        for value in given:
            checked({name: value}, f"{where}: space")
        return tuple(given)
    where = f"{where}: {name}"
    values = mapping(given, where)
    only_keys(values, ("low", "high", "log"), where)
    low: Any = values.get("low")
    high: Any = values.get("high")
    log = values.get("log", False)
    if type(low) not in (int, float) or type(high) not in (int, float) or type(log) is not bool:
        raise DmfcError(f"{where}: wants {{low, high, log}} or a list, not {shortened(given)}")
    for value in (low, high):
        checked({name: value}, where)
    if all_types()[name] is not float:
        raise DmfcError(f"{where}: wants a list of values, since it is not a fraction")
    if not low < high or (log and low <= 0):
        raise DmfcError(f"{where}: low must be under high, and with log above 0, not {given}")
    return Range(float(low), float(high), log)


def _rounded(value: Any, domain: Range | tuple[Any, ...]) -> Any:
    if not isinstance(domain, Range):
        return value
    return min(max(float(f"{value:.{DIGITS}g}"), domain.low), domain.high)
