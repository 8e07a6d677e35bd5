"""A leaderboard from files: one per entry, and the page that is made of them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from dmfc.errors import DmfcError
from dmfc.files.atomic import write_json, write_text
from dmfc.files.foreign import reading
from dmfc.methods.named import Benchmark
from dmfc.report.formats import rate_text
from dmfc.report.markdown import markdown_row, markdown_text
from dmfc.report.rates import NORMAL, Rate, Rates

PAGES = ("README.md", "index.html")
RATES = ("overall", "valid", "success")
HEAD = (
    "method",
    "trials",
    *RATES,
    "s per scene",
    "failed",
    "used",
    "from",
)


@dataclass(frozen=True)
class Entry:
    """A method on one test set of the benchmark."""

    benchmark: str
    version: int
    set: str
    scenes: str
    """Digest of the scenes that were executed."""
    name: str
    rates: dict[str, dict[str, float | None]] = field(default_factory=dict)
    """'overall', 'valid' and 'success' -> the fields of `Rate`; empty where it is reported."""
    seconds: float | None = None
    """Median per scene."""
    failed_scenes: int = 0
    used: str = ""
    """What was asked for besides the cloud."""
    origin: str = ""
    """The command and commit, or the publication."""
    reported: dict[str, list[float]] = field(default_factory=dict)
    """Rates of a publication on scenes and in a simulator of its own: [value, standard error]."""

    def rate(self, name: str) -> Rate:
        """'overall', 'valid' or 'success'."""
        found = self.rates[name]
        effective = found["effective"]
        return Rate(
            int(found["successes"] or 0),
            int(found["trials"] or 0),
            math.nan if effective is None else effective,
            found["quantile"] or NORMAL,
        )

    @classmethod
    def measured(cls, rates: Rates, **more: Any) -> Entry:
        """The entry of these rates."""
        found = {name: asdict(getattr(rates, name)) for name in RATES}
        for rate in found.values():
            if math.isnan(rate["effective"]):
                rate["effective"] = None
        return cls(**more, rates=found)

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        write_json(path, asdict(self))

    def text(self, rate: str) -> str:
        """'0.70 ± 0.02 [0.65, 0.74]', or the reported figure."""
        if self.reported:
            pair = self.reported.get(rate)
            return f"{pair[0]:g} ± {pair[1]:g}" if pair else "–"
        return rate_text(self.rate(rate))

    @property
    def rank(self) -> float:
        """The overall rate, for the order of a table."""
        reported = self.reported.get("overall", [0.0])[0]
        return reported if self.reported else self.rate("overall").value or 0.0


def read_entries(folder: Path, benchmark: Benchmark) -> list[Entry]:
    """All entries (*.json) of a folder. Raises DmfcError on one that is no entry of this version,
    or of other scenes."""
    found = [_entry(path, benchmark) for path in sorted(folder.glob("*.json"))]
    if not found:
        raise DmfcError(f"{folder} holds no entry (*.json)")
    return found


def write_pages(folder: Path, benchmark: Benchmark) -> list[Path]:
    """Write README.md and index.html of the entries in a folder."""
    entries = read_entries(folder, benchmark)
    texts = to_markdown(entries, benchmark), to_html(entries, benchmark)
    paths = [folder / name for name in PAGES]
    for path, text in zip(paths, texts, strict=True):
        write_text(path, text)
    return paths


def to_markdown(entries: Sequence[Entry], benchmark: Benchmark) -> str:
    """A table per test set, the best first."""
    lines = [f"# {_title(benchmark)}", "", _INTRODUCTION, ""]
    for name, rows in _by_set(entries, benchmark).items():
        chosen = benchmark.sets[name]
        lines += [f"## {name}: {chosen.title}", "", f"Scenes `{chosen.scenes}`.", ""]
        lines += [markdown_row(list(HEAD)), markdown_row(["---"] * len(HEAD))]
        lines += [markdown_row([markdown_text(cell) for cell in _cells(row)]) for row in rows]
        lines.append("")
    return "\n".join(lines)


def to_html(entries: Sequence[Entry], benchmark: Benchmark) -> str:
    """The same as one page that needs nothing else."""
    from jinja2 import Environment, StrictUndefined

    source = Path(__file__).with_name("leaderboard.html").read_text(encoding="utf-8")
    sets = [
        {"name": name, "set": benchmark.sets[name], "rows": [_cells(row) for row in rows]}
        for name, rows in _by_set(entries, benchmark).items()
    ]
    template = Environment(autoescape=True, undefined=StrictUndefined).from_string(source)
    return template.render(
        title=_title(benchmark), introduction=_INTRODUCTION.replace("`", ""), head=HEAD, sets=sets
    )


def _by_set(entries: Sequence[Entry], benchmark: Benchmark) -> dict[str, list[Entry]]:
    """Entries by test set, the best first; sets without one are left out."""
    found = {name: [one for one in entries if one.set == name] for name in benchmark.sets}
    return {
        name: sorted(rows, key=lambda one: (-one.rank, one.name))
        for name, rows in found.items()
        if rows
    }


def _entry(path: Path, benchmark: Benchmark) -> Entry:
    with reading(path, "an entry of the leaderboard (JSON)"):
        values: dict[str, Any] = json.loads(path.read_text())
        entry = Entry(**values)
        counts = [] if entry.reported else [entry.rate(name) for name in RATES]
    if counts and not (
        0 <= counts[0].successes == counts[2].successes <= counts[2].trials
        and counts[2].trials == counts[1].successes <= counts[1].trials == counts[0].trials
    ):
        raise DmfcError(f"{path}: the counts of overall, valid and success contradict each other")
    if (entry.benchmark, entry.version) != (benchmark.name, benchmark.version):
        raise DmfcError(
            f"{path} is an entry of {entry.benchmark} version {entry.version}, not of "
            f"{benchmark.name} version {benchmark.version}"
        )
    if entry.set not in benchmark.sets:
        raise DmfcError(f"{path}: {benchmark.name} has no test set '{entry.set}'")
    if not entry.reported and entry.scenes != benchmark.sets[entry.set].scenes:
        raise DmfcError(
            f"{path}: its scenes are {entry.scenes}, those of the set '{entry.set}' are "
            f"{benchmark.sets[entry.set].scenes}"
        )
    return entry


def _cells(entry: Entry) -> list[str]:
    own = not entry.reported
    return [
        entry.name,
        str(entry.rate("overall").trials) if own else "reported",
        *(entry.text(rate) for rate in RATES),
        "" if entry.seconds is None else f"{entry.seconds:.2g}",
        str(entry.failed_scenes) if own else "",
        entry.used,
        entry.origin,
    ]


def _title(benchmark: Benchmark) -> str:
    return f"{benchmark.name}, version {benchmark.version}"


_INTRODUCTION = (
    "Grasps of a multi-fingered hand, executed in MuJoCo: K = 4 per scene. Overall: held of all "
    "trials; valid: planned of all; success: held of the planned. Brackets are 95 % intervals "
    "for new scenes of the same objects. A scene without an answer counts as failed. Rows called "
    "'reported' are figures of a publication, on scenes and in a simulator of its own. Made by "
    "`dmfc benchmark leaderboard` from the files beside this page; how to add one: "
    "docs/leaderboard.md."
)
