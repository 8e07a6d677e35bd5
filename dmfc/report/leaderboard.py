"""A leaderboard from files: one per entry, and the page that is made of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from dmfc.errors import DmfcError
from dmfc.files.atomic import write_json, write_text
from dmfc.files.foreign import reading
from dmfc.methods.named import Benchmark
from dmfc.report.formats import markdown_row, markdown_text, rate_text
from dmfc.report.rates import Rate

PAGES = ("README.md", "index.html")
HEAD = (
    "method",
    "trials",
    *("overall", "valid", "success"),
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
    trials: int = 0
    """K x scenes; 0 where rates are only reported."""
    planned: int = 0
    held: int = 0
    seconds: float | None = None
    """Median per scene."""
    failed_scenes: int = 0
    used: str = ""
    """What was asked for besides the cloud."""
    origin: str = ""
    """The command and commit, or the publication."""
    reported: dict[str, list[float]] = field(default_factory=dict)
    """Rates of a publication on scenes and in a simulator of its own: [value, standard error]."""

    @property
    def valid(self) -> Rate:
        return Rate(self.planned, self.trials)

    @property
    def success(self) -> Rate:
        return Rate(self.held, self.planned)

    @property
    def overall(self) -> Rate:
        return Rate(self.held, self.trials)

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        write_json(path, asdict(self))

    def text(self, rate: str) -> str:
        """'0.70 ± 0.02 [0.65, 0.74]', or the reported figure."""
        if self.reported:
            pair = self.reported.get(rate)
            return f"{pair[0]:g} ± {pair[1]:g}" if pair else "–"
        return rate_text(getattr(self, rate))

    @property
    def rank(self) -> float:
        """The overall rate, for the order of a table."""
        reported = self.reported.get("overall", [0.0])[0]
        return reported if self.reported else self.overall.value or 0.0


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
    wanted = {item.name: item.type for item in fields(Entry)}
    if not set(values) <= set(wanted) or not 0 <= entry.held <= entry.planned <= entry.trials:
        raise DmfcError(f"{path}: held, planned and trials must be counts, each at most the next")
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
        str(entry.trials) if own else "reported",
        *(entry.text(rate) for rate in ("overall", "valid", "success")),
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
    "(Wilson). A scene without an answer counts as failed. Rows called 'reported' are figures of a "
    "publication, on scenes and in a simulator of its own. Made by `dmfc benchmark leaderboard` "
    "from the files beside this page; how to add one: docs/leaderboard.md."
)
