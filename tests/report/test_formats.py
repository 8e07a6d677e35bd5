"""The table in each format, read back."""

import csv
import io
import json
from types import SimpleNamespace

import pandas as pd
import pytest
from markdown_it import MarkdownIt
from rich.console import Console

from dmfc.report.curves import draw_curves
from dmfc.report.failures import draw_failures
from dmfc.report.figure import draw_rates
from dmfc.report.formats import to_csv, to_json, to_latex, to_rich
from dmfc.report.markdown import to_markdown
from dmfc.report.table import CellRows, make_table
from dmfc.sweep.record import CellRecord


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
    assert {seed: rates.valid.trials for seed, rates in row.by_seed.items()} == {0: 40, 1: 40}
    assert row.seed_spread("valid") == 0
    assert table.rows[1].seed_spread("valid") == pytest.approx(0.1 / 2**0.5)  # 0 and 4 of 40
    assert table.rows[1].failure == "1 of 2 shards missing: x"


def test_markdown(table):
    text = to_markdown(table)
    line = next(line for line in text.splitlines() if line.startswith("| fine-tuned"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[1] == "80"
    low, high = table.rows[0].rates.valid.interval
    assert cells[2] == f"0.75 ± 0.13 [{low:.2f}, {high:.2f}]"  # 0.75 of the scenes, not trials
    assert table.claim() in text.replace("\\", "")
    assert cells[3] == "0.82 ± 0.02"
    assert "incomplete" in text
    assert "| ycb/mug |" in text
    widths = {
        line.count("|") for line in text.splitlines() if line.startswith("| ") and "ycb" not in line
    }
    assert widths == {9, 5, 4}
    assert "seed 1" in text


def test_csv(table):
    lines = list(csv.DictReader(io.StringIO(to_csv(table))))
    assert [line["cell"] for line in lines] == ["all", "random"]
    assert float(lines[0]["valid"]) == 0.75
    low, _ = table.rows[0].rates.valid.interval
    assert float(lines[0]["valid_low"]) == pytest.approx(low, abs=1e-6)
    assert float(lines[0]["valid_seed_sd"]) == 0
    assert "a new training (2 seeds)" in lines[0]["claim"]
    assert lines[0]["paper_overall"] == "0.56"
    assert lines[1]["paper_overall"] == ""
    assert float(lines[1]["success"]) == 0.0
    assert lines[1]["success_n"] == "4"


def test_latex(table):
    text = to_latex(table)
    low, high = table.rows[0].rates.valid.interval
    line = rf"fine-tuned, all \& more & 80 & $0.75 \pm 0.13$ [{low:.2f}, {high:.2f}] (0.82)"
    assert line in text
    assert f"% {table.claim()}" in text
    assert text.count(r"\\") == 3
    assert text.count("{") == text.count("}")


def test_json_is_json(table):
    read = json.loads(json.dumps(to_json(table)))
    assert read["cells"]["all"]["rates"]["valid"] == {
        "value": 0.75,
        "n": 80,
        "effective_n": table.rows[0].rates.valid.worth,
        "standard_error": table.rows[0].rates.valid.standard_error,
        "interval": list(table.rows[0].rates.valid.interval),
    }
    assert read["cells"]["random"]["failure"]


def test_terminal(table):
    console = Console(width=160, record=True, file=io.StringIO())
    console.print(to_rich(table))
    text = console.export_text()
    low, high = table.rows[0].rates.valid.interval
    assert f"[{low:.2f}, {high:.2f}]" in text
    assert table.claim() in text
    assert "random (floor)" in text


def test_a_picture_is_drawn(table, tmp_path):
    from PIL import Image

    from dmfc.report.figure import draw_rates

    draw_rates(table, tmp_path / "table.png")
    with Image.open(tmp_path / "table.png") as picture:
        assert picture.size[0] > 900
        assert len(picture.convert("RGB").getcolors(1 << 20) or []) > 10


HARD = [
    r"cost $5 & $6 #1 50% \alpha {x}_{y} ^2 ~a",
    "_a_ *b* `c` [d](e) <f> a|b",
    "back\\slash at the end \\",
    "# one",
    "- two",
    "$\\frac{1}$",
    "[red]x[/red]",
]


@pytest.fixture(params=HARD)
def hard(request):
    """A table of one row with a label and an object whose names have signs of every format."""
    label = request.param
    cells = [CellRows("all", label, 0, 8, trials(8, 4, 8, (label,)), {}, f"it failed: {label}")]
    return label, make_table(cells, id="t-1", name="t", title=label, preset="quick")


def test_markdown_shows_every_sign(hard):
    """As a reader of Markdown that is not ours has it."""
    label, table = hard
    tokens = MarkdownIt("commonmark").enable("table").parse(to_markdown(table))
    texts = [
        "".join(part.content for part in token.children)
        for token in tokens
        if token.type == "inline"
    ]
    assert {part.type for token in tokens for part in token.children or ()} <= {
        "text", "text_special", "strong_open", "strong_close", "code_inline", "softbreak",
    }  # fmt: skip
    assert texts[0] == label  # the title
    assert texts.count(label) == 5  # and its rows, its object, the head of the objects
    assert f"{label}: slipped 4" in texts
    assert f"{label}: incomplete. it failed: {label}" in texts


def test_csv_and_terminal_keep_every_sign(hard):
    label, table = hard
    (line,) = csv.DictReader(io.StringIO(to_csv(table)))
    assert (line["label"], line["failure"]) == (label, f"it failed: {label}")
    out = io.StringIO()
    Console(file=out, width=300).print(to_rich(table))
    assert out.getvalue().startswith(f"{label} (quick)")
    assert f"│ {label} " in out.getvalue()


def test_latex_sets_every_sign():
    label = r"a\b {c} $d$ #1 e&f 5% g_h ^i ~j <k> |l|"
    cells = [CellRows("all", label, 0, 8, trials(8, 4, 8), {})]
    text = to_latex(make_table(cells, id="t", name="t", title="a\nb", preset="p"))
    assert text.startswith("% a b;")
    row = text.split("\\midrule\n")[1]
    assert row.split(" & 8 & ")[0] == (
        r"a\textbackslash{}b \{c\} \$d\$ \#1 e\&f 5\% g\_h \textasciicircum{}i "
        r"\textasciitilde{}j \textless{}k\textgreater{} \textbar{}l\textbar{}"
    )


def test_figures_show_a_dollar_as_it_is(hard, tmp_path, monkeypatch):
    label, table = hard
    drawn = []

    def remember(renderer, gc, x, y, s, prop, angle, ismath=False, mtext=None):
        drawn.append((s, ismath))

    monkeypatch.setattr("matplotlib.backends.backend_agg.RendererAgg.draw_text", remember)
    draw_rates(table, tmp_path / "rates.png")
    draw_failures(table, tmp_path / "failures.png")
    assert [ismath for text, ismath in drawn if text == label] == [False, False]
    assert (f"{label} (quick)", False) in drawn


def test_curves_name_a_cell_that_begins_with_an_underscore(ledger, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        "matplotlib.backends.backend_agg.RendererAgg.draw_text",
        lambda renderer, gc, x, y, s, prop, angle, ismath=False, mtext=None: drawn.append(s),
    )
    folder = ledger.folder("finetune/x")
    folder.mkdir(parents=True)
    (folder / "stage.json").write_text("{}")
    (folder / "metrics.jsonl").write_text('{"epoch": 0, "loss": 1.0, "split": "train"}\n')
    cell = CellRecord("a", "_a$b$", "finetuned", 0, 8, "finetune/x", None, (), {})
    assert draw_curves(ledger, SimpleNamespace(cells=[cell]), tmp_path / "curves.png")
    assert "_a$b$, seed 0" in drawn
