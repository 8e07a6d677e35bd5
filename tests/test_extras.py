"""The core of the package does without the packages of the extras."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement

from dmfc.errors import EXTRAS
from tests.support import clouds

ROOT = Path(__file__).resolve().parents[1]
MODULES = {
    "python-fcl": "fcl",
    "libigl": "igl",
    "pytorch-kinematics": "pytorch_kinematics",
    "fast-simplification": "fast_simplification",
}
"""Packages whose module has another name."""
WITHOUT = """
import sys
sys.modules.update(dict.fromkeys({modules}))
sys.argv = ["dmfc", *{arguments}]
from dmfc.cli.main import main
main()
"""


def without(modules: set[str], *arguments: object) -> subprocess.CompletedProcess[str]:
    """`dmfc ARGUMENTS` where none of the modules can be imported."""
    code = WITHOUT.format(modules=sorted(modules), arguments=[str(a) for a in arguments])
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)


def test_the_table_of_extras_is_that_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for extra, modules in EXTRAS.items():
        listed = [Requirement(line).name for line in project["optional-dependencies"][extra]]
        assert {MODULES.get(name, name) for name in listed if name != "dmfc"} == modules


def test_a_prediction_needs_the_core_alone(tmp_path):
    np.save(tmp_path / "cloud.npy", clouds.cloud(clouds.box()))
    picture = tmp_path / "grasps.png"
    everything = set().union(*EXTRAS.values())
    done = without(everything, "predict", tmp_path / "cloud.npy", "--json", "--picture", picture)
    assert done.returncode == 0, done.stderr
    assert picture.is_file()


@pytest.mark.parametrize(
    ("extra", "arguments"),
    [
        ("sim", ("predict", "{cloud}", "--check")),
        ("sim", ("objects", "list", "procedural:2", "--preset", "smoke")),
        ("sweep", ("sweep", "table1", "--preset", "smoke")),
    ],
)
def test_a_missing_extra_is_one_line_that_says_how_to_get_it(tmp_path, extra, arguments):
    np.save(tmp_path / "cloud.npy", clouds.cloud(clouds.box()))
    filled = [text.format(cloud=tmp_path / "cloud.npy") for text in arguments]
    if arguments[0] != "predict":
        filled += ["--store", str(tmp_path / "store")]
    done = without(EXTRAS[extra], *filled)
    assert done.returncode == 1
    (line,) = [text for text in done.stderr.splitlines() if text]
    assert f"pip install 'dmfc[{extra}]'" in line
