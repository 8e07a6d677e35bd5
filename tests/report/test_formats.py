"""The table in each format, read back."""

import csv
import io
import json

import pandas as pd
import pytest
from rich.console import Console

from dmfc.report.formats import to_csv, to_json, to_latex, to_markdown, to_rich
from dmfc.report.table import CellRows, make_table


def trials(planned, held, n, objects=("ycb/mug", "ycb/banana")):
    return pd.DataFrame(
        [
            {
                "scene": i // 4,
                "trial": i % 4,
                "object": objects[i % len(objects)],
                "planned": i < planned,
                "held": i < held,
                "reason": "" if i < held else "slipped",
            }
            for i in range(n)
        ]
    )


@pytest.fixture
def table():
    paper = {"valid": (0.82, 0.02), "success": (0.68, 0.02), "overall": (0.56, 0.02)}
    cells = [
        CellRows("all", "fine-tuned, all & more", 0, 40, trials(30, 15, 40), paper),
        CellRows("all", "fine-tuned, all & more", 1, 40, trials(30, 15, 40), paper),
        CellRows(
            "random", "random (floor)", 0, 40, trials(0, 0, 0), {}, "1 of 2 shards missing: x"
        ),
        CellRows("random", "random (floor)", 1, 40, trials(4, 0, 40), {}),
    ]
    return make_table(cells, id="t-1", name="t", title="Table I", preset="quick")


def test_seeds_are_pooled(table):
    row = table.rows[0]
    assert (row.seeds, row.trials) == (2, 80)
    assert row.rates.valid.value == 0.75
    assert table.rows[1].rates.valid.trials == 80
    assert table.rows[1].failure == "1 of 2 shards missing: x"


def test_markdown(table):
    text = to_markdown(table)
    line = next(line for line in text.splitlines() if line.startswith("| fine-tuned"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[1] == "80"
    assert cells[2] == "0.75 ± 0.05 [0.65, 0.83]"
    assert cells[3] == "0.82 ± 0.02"
    assert "incomplete" in text
    assert "| ycb/mug |" in text
    widths = {
        line.count("|") for line in text.splitlines() if line.startswith("| ") and "ycb" not in line
    }
    assert widths == {9, 4}


def test_csv(table):
    lines = list(csv.DictReader(io.StringIO(to_csv(table))))
    assert [line["cell"] for line in lines] == ["all", "random"]
    assert float(lines[0]["valid"]) == 0.75
    assert float(lines[0]["valid_low"]) == pytest.approx(0.6451, abs=1e-4)
    assert lines[0]["paper_overall"] == "0.56"
    assert lines[1]["paper_overall"] == ""
    assert float(lines[1]["success"]) == 0.0
    assert lines[1]["success_n"] == "4"


def test_latex(table):
    text = to_latex(table)
    assert r"fine-tuned, all \& more & 80 & $0.75 \pm 0.05$ [0.65, 0.83] (0.82)" in text
    assert text.count(r"\\") == 3
    assert text.count("{") == text.count("}")


def test_json_is_json(table):
    read = json.loads(json.dumps(to_json(table)))
    assert read["cells"]["all"]["rates"]["valid"] == {
        "value": 0.75,
        "n": 80,
        "standard_error": pytest.approx(0.0484, abs=1e-4),
        "interval": pytest.approx([0.6451, 0.8320], abs=1e-4),
    }
    assert read["cells"]["random"]["failure"]


def test_terminal(table):
    console = Console(width=160, record=True, file=io.StringIO())
    console.print(to_rich(table))
    text = console.export_text()
    assert "[0.65, 0.83]" in text
    assert "random (floor)" in text


def test_a_picture_is_drawn(table, tmp_path):
    from PIL import Image

    from dmfc.report.figure import draw_rates

    draw_rates(table, tmp_path / "table.png")
    with Image.open(tmp_path / "table.png") as picture:
        assert picture.size[0] > 900
        assert len(picture.convert("RGB").getcolors(1 << 20) or []) > 10
