"""The whole chain with its science, as a user runs it: hand, objects, grasps, scenes, two stages of
training, execution, tables, tracking. Minutes, so marked `full`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from dmfc.sweep.sweep_file import load_sweep

ROOT = Path(__file__).resolve().parents[2]


def dmfc(*arguments: object) -> dict:
    """Run the command in a process of its own and read its JSON."""
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "from dmfc.cli.main import main; main()",
            *map(str, arguments),
            "--json",
        ],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return json.loads(done.stdout)


@pytest.mark.full
def test_both_tables_in_their_smallest_form(tmp_path, shadow_hand_dir):
    call = ("sweep", "sweeps/table1.yaml", "table2", "--preset", "smoke", "--store", tmp_path)
    answer = dmfc(*call)
    first, second = answer["sweeps"]
    for sweep, name in ((first, "table1"), (second, "table2")):
        assert list(sweep["cells"]) == [cell.name for cell in load_sweep(name).cells]
        rows = pd.read_parquet(Path(sweep["folder"]) / "trials.parquet")
        for name, cell in sweep["cells"].items():
            assert cell["failure"] is None
            assert cell["rates"]["valid"]["n"] == cell["rates"]["overall"]["n"] == cell["trials"]
            assert (rows["cell"] == name).sum() == cell["trials"]
        planner, floor = (
            sweep["cells"][name]["rates"]["overall"] for name in ("planner", "random")
        )
        assert planner["value"] >= floor["value"]

    stages = tmp_path / "stages"
    made = {folder.name: len(list(folder.iterdir())) for folder in stages.iterdir()}
    assert made["hand"] == 1
    assert made["object"] == made["grasps"] == 4
    assert made["pretrain"] == 2
    assert made["finetune"] == 5
    assert answer["stages_run"] == sum(made.values())

    again = dmfc(*call)
    assert again["stages_run"] == 0
    assert [sweep["cells"] for sweep in again["sweeps"]] == [first["cells"], second["cells"]]
