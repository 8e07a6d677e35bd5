"""The page of a sweep: what it says is what the table says, and it needs nothing else."""

import json
import re
from html.parser import HTMLParser

import pandas as pd
import pytest

from dmfc.report.page import draw_figures, write_page
from dmfc.report.paired import compare


@pytest.fixture
def page(finished):
    figures = draw_figures(finished.ledger, finished.description, finished.table)
    path = write_page(finished.ledger, finished.description, finished.table, figures)
    return path.read_text()


class Cells(HTMLParser):
    """The text of each cell of a table, row by row."""

    def __init__(self, text):
        super().__init__()
        self.rows: list[list[str]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_data(self, data):
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] = f"{self.rows[-1][-1]} {data.strip()}".strip()


def table(page, name):
    """One of its tables, as a person reads it."""
    text = re.search(rf'<table id="{name}">.*?</table>', page, re.DOTALL)[0]
    head, *rows = Cells(text).rows
    return pd.DataFrame(rows, columns=head)


def test_it_is_one_file(page):
    assert not re.findall(r'(?:src|href)="(?!data:|http://127|#)[^"]*"', page)
    anchors = re.findall(r'href="#(\w+)"', page)
    assert len(anchors) == 5
    assert all(page.count(f'id="{name}"') == 1 for name in anchors)
    assert "<script" not in page
    assert page.count("data:image/png;base64,") == 3


def test_rates_and_pairs_are_those_of_the_rows(page, finished):
    rates = table(page, "rates").set_index("model")
    row = {row.label: row for row in finished.table.rows}["all"]
    assert rates.loc["all", "overall ± s.e."].startswith(f"{row.rates.overall.value:.2f} ± ")
    cells = {cell.name: cell.rows.assign(seed=0) for cell in finished.cells}
    found = compare(cells["random"], cells["pretrained"])
    assert rates.loc["pretrained", "overall − base same scenes"] == "base"
    told = rates.loc["random (floor)", "overall − base same scenes"]
    assert told == f"{found.difference:+.2f} [{found.low:+.2f}, {found.high:+.2f}]"
    p, _, holm = rates.loc["random (floor)", "p"].split()
    assert float(p) == pytest.approx(found.p, rel=0.1)
    assert float(holm) == pytest.approx(min(1, 3 * found.p), rel=0.1)  # the smallest of three
    assert finished.table.claim() in page


def test_links_lead_to_the_server_that_has_the_runs(finished):
    given = (finished.ledger, finished.description, finished.table, [])
    runs = {cell.run: "abc" for cell in finished.description.cells}
    told = {"experiment_id": "1", "runs": runs}
    for uri, address, hint in [
        ("sqlite:///x.db", "http://127.0.0.1:5000", True),
        ("https://mlflow.lab/", "https://mlflow.lab", False),
    ]:
        (finished.folder / "tracked.json").write_text(json.dumps({**told, "uri": uri}))
        text = write_page(*given).read_text()
        assert text.count(f'href="{address}/#/experiments/1/runs/abc"') == len(runs)
        assert ("dmfc ui" in text) == hint


def test_failures_reasons_objects_and_origin_are_told(page, finished):
    assert "broken</b>" in page
    assert "the loss is not finite" in page
    reasons = table(page, "reasons").set_index("reason")
    row = {row.label: row for row in finished.table.rows}["all"]
    assert reasons.loc["slipped", "all"] == str(row.reasons["slipped"])
    objects = table(page, "objects").set_index("object")
    assert set(objects.index) == set(row.objects)
    assert "losses.weights.guidance 1.0 -&gt; 2.0" in page
    assert len(table(page, "provenance")) == 1
    assert "No runs in MLflow yet" in page
