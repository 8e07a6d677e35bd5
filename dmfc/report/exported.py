"""A table as files outside a store: `NAME.trials.parquet` and `NAME.json`, and all made from them.

The trial rows, and what the JSON says of the cells (labels, the paper's figures, how many trials
there should be), give the table again in every format, byte for byte.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pandas as pd

from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError
from dmfc.files.atomic import write_json, write_text
from dmfc.files.foreign import reading
from dmfc.pipeline.artifacts import TRIALS
from dmfc.report.figure import draw_rates
from dmfc.report.formats import to_json
from dmfc.report.markdown import texts
from dmfc.report.page import (
    CURVES_CAPTION,
    OVER_CAPTION,
    RATES_CAPTION,
    Origin,
    as_text,
    origin_of,
    page_text,
)
from dmfc.report.rates import COLUMNS
from dmfc.report.table import NAMES, CellRows, SweepTable, make_table
from dmfc.report.trials import SearchTrial
from dmfc.sweep.record import SweepRecord

KEPT = {"over.png": OVER_CAPTION, "curves.png": CURVES_CAPTION}
"""Pictures that do not follow from rows alone: they are copied. By name, with their captions."""
ROWS = f".{TRIALS}"
"""'.trials.parquet': the end of the name of exported trial rows."""


def export_table(ledger: Ledger, sweep: SweepRecord, table: SweepTable, folder: Path) -> list[Path]:
    """Write a table of a store, whose files are there, as `folder`/NAME.*: all its formats."""
    made = ledger.store / "sweeps" / table.id
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / f"{table.name}{ROWS}"
    shutil.copyfile(made / TRIALS, place)
    for name in KEPT:
        if (made / name).is_file():
            shutil.copyfile(made / name, _beside(place, name))
    write_json(
        _beside(place, "provenance.json"), asdict(replace(origin_of(ledger, sweep), tracked={}))
    )
    return [place, *write_formats(place, table)]


def read_table(place: Path) -> SweepTable:
    """The table of the trial rows at `place` ('NAME.trials.parquet') and of the JSON beside them.

    Raises DmfcError where either is missing or of another kind.
    """
    rows = read_rows(place)
    about = _beside(place, "json")
    with reading(about, "the JSON of a table"):
        told = json.loads(about.read_text())
        cells = _cells(told, rows)
        search = [SearchTrial(**trial) for trial in told.get("search", {}).values()]
        table = make_table(
            cells,
            id=told["id"],
            name=told["name"],
            title=told["title"],
            preset=told["preset"],
            show=told.get("show", NAMES),
            baseline=told.get("baseline", cells[0].name),
            trials=search,
        )
    return replace(table, left_out=told.get("left_out"))


def read_rows(place: Path) -> pd.DataFrame:
    """Exported trial rows. Raises DmfcError where there are none."""
    if not place.name.endswith(ROWS):
        raise DmfcError(f"'{place}': exported trial rows are a file NAME{ROWS}")
    with reading(place, "trial rows (parquet)"):
        rows = pd.read_parquet(place)
    missing = {"cell", "seed", *COLUMNS} - set(rows)
    if missing:
        raise DmfcError(f"'{place}' lacks the columns {', '.join(sorted(missing))}")
    return rows


def write_formats(place: Path, table: SweepTable) -> list[Path]:
    """Write the table beside the trial rows at `place`, in every format; the files."""
    paths = []
    for suffix, text in texts(table).items():
        paths.append(_beside(place, suffix))
        write_text(paths[-1], text)
    about, picture, page = (_beside(place, suffix) for suffix in ("json", "png", "html"))
    write_json(about, to_json(table))
    draw_rates(table, picture)
    drawn = [(RATES_CAPTION, picture)]
    kept = [(caption, _beside(place, name)) for name, caption in KEPT.items()]
    drawn += [(caption, path) for caption, path in kept if path.is_file()]
    write_text(page, page_text(table, as_text(table, drawn), _origin(place, table)))
    return [*paths, about, picture, page]


def _cells(told: Mapping[str, Any], rows: pd.DataFrame) -> list[CellRows]:
    named = told["cells"]
    # Older files have no order: that of the rows, then the cells that have none.
    order = told.get("order") or list(dict.fromkeys([*rows["cell"], *named]))
    return [
        _cell_rows(name, named[name], int(seed), wanted, rows)
        for name in order
        for seed, wanted in _seeds(named[name], rows[rows["cell"] == name])
    ]


def _seeds(cell: Mapping[str, Any], rows: pd.DataFrame) -> Sequence[tuple[int, int]]:
    """Seeds of a cell, each with the trials that it should have."""
    if "by_seed" in cell:
        return [(int(seed), found["overall"]["n"]) for seed, found in cell["by_seed"].items()]
    seeds = sorted(rows["seed"].unique()) or list(range(cell["seeds"]))
    return [(int(seed), cell["trials"] // cell["seeds"]) for seed in seeds]


def _cell_rows(
    name: str, cell: Mapping[str, Any], seed: int, trials: int, rows: pd.DataFrame
) -> CellRows:
    mine = rows[(rows["cell"] == name) & (rows["seed"] == seed)]
    return CellRows(
        name=name,
        label=cell["label"],
        seed=seed,
        trials=trials,
        rows=mine.drop(columns=["cell", "seed"]).reset_index(drop=True),
        paper={rate: (value, error) for rate, (value, error) in cell["paper"].items()},
        failure=cell["failure"] or "",
    )


def _origin(place: Path, table: SweepTable) -> Origin:
    """What made the table, from `NAME.provenance.json`; older files are the list of calls."""
    status = "INCOMPLETE" if any(row.failure for row in table.rows) else "FINISHED"
    path = _beside(place, "provenance.json")
    if not path.is_file():
        return Origin(status, [])
    with reading(path, "the provenance of a table"):
        told = json.loads(path.read_text())
        return Origin(status, told) if isinstance(told, list) else Origin(**told)


def _beside(place: Path, suffix: str) -> Path:
    return place.with_name(f"{place.name.removesuffix(ROWS)}.{suffix}")
