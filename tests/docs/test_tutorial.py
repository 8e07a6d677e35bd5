"""docs/tutorial.md does what it says, in an empty folder."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PIL import Image

from dmfc.grasps.grasp_set import GraspSet
from tests.support.pages import commands, run, write_files

PAGE = "tutorial.md"


def test_every_step_is_there():
    """In the order that a reader goes: what is printed is what `test_the_commands_...` runs."""
    steps = [line.split("dmfc ")[1] for line in commands(PAGE).splitlines() if "dmfc " in line]
    verbs = [" ".join(word for word in step.split()[:2] if word.isalpha()) for step in steps]
    assert list(dict.fromkeys(verbs)) == [
        "objects prepare",
        "grasps plan",
        "scenes make",
        "scenes show",
        "train",
        "models export",
        "evaluate finetuned",
        "evaluate planner",
        "predict",
        "view",
    ]


@pytest.mark.full
def test_the_commands_run_as_printed(tmp_path):
    write_files(PAGE, tmp_path)
    told = run(PAGE, tmp_path)
    for name in ("folder/box", "folder/can", "folder/pill"):
        assert name in told
    extents = trimesh.load_mesh(tmp_path / "meshes/train/box.stl").extents
    np.testing.assert_allclose(extents, [60, 45, 110])

    for name in ("scene.png", "trial.png", "grasps.png"):
        assert np.asarray(Image.open(tmp_path / name).convert("L")).std() > 5, f"{name} is blank"
    grasps = GraspSet.load(tmp_path / "grasps.parquet")
    assert len(grasps) == 512
    assert np.isfinite(grasps.position).all()
    assert "Apache-2.0" in (tmp_path / "my-model" / "README.md").read_text()
    page = (tmp_path / "page.html").read_text()
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert "my-model" in page
