"""The page on predictions does what it says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from dmfc.grasps.grasp_set import GraspSet
from tests.support import clouds

PAGE = Path(__file__).resolve().parents[2] / "docs" / "predict.md"


def test_the_python_of_the_page_runs(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    np.save(tmp_path / "cloud.npy", clouds.cloud(clouds.box()))
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    assert capsys.readouterr().out.startswith("512 ")
    assert len(GraspSet.load(tmp_path / "grasps.parquet")) == 10
