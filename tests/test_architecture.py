"""Imports point one way, importing is light, and everything that is there is shipped."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import dmfc

PACKAGE = Path(dmfc.__file__).resolve().parent
ROOT = PACKAGE.parent

LAYERS = [
    {"errors"},
    {"files"},
    {"config"},
    {"engine"},
    {"assets"},
    {"geometry"},
    {"hand"},
    {"objects"},
    {"physics"},
    {"losses"},
    {"sensing"},
    {"grasps"},
    {"scenes"},
    {"network"},
    {"training"},
    {"outcome"},
    {"prediction"},
    {"execution"},
    {"visualization"},
    {"view"},
    {"pipeline"},
    {"sweep"},
    {"report"},
    {"tracking"},
    {"experiment"},
    {"cli"},
]
"""Lowest first; a part imports from its own layer and from lower ones."""

HEAVY = {
    "ray",
    "mlflow",
    "mujoco",
    "lightning",
    "torch",
    "coacd",
    "matplotlib",
    "trimesh",
    "pandas",
}
ABSENT = {"mujoco", "ray", "mlflow", "trimesh", "coacd"}


def modules() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py"))


def part(path: Path) -> str:
    """'grasps' for dmfc/grasps/x.py, 'errors' for dmfc/errors.py."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(path: Path) -> set[str]:
    """Dotted names that a file imports anywhere, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            found |= {f"{module}.{alias.name}" for alias in node.names}
    return found


def rank(name: str) -> int:
    return next(i for i, layer in enumerate(LAYERS) if name in layer)


def test_every_part_has_a_layer():
    parts = {part(path) for path in modules()} - {"__init__", "__main__"}
    assert parts <= set().union(*LAYERS)


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_down(path):
    own = part(path)
    if own in ("__init__", "__main__"):
        return
    for name in imports(path):
        names = name.split(".")
        if names[0] == "dmfc" and len(names) > 1:
            assert rank(names[1]) <= rank(own), f"{own} imports {name}"


def loaded_by(*names: str) -> set[str]:
    """Top-level packages in a fresh interpreter after importing modules of dmfc."""
    code = f"import {', '.join(names)}, sys; print(*{{n.split('.')[0] for n in sys.modules}})"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True
    )
    return set(done.stdout.split())


def test_the_command_line_is_light():
    loaded = loaded_by(
        "dmfc.cli.main", "dmfc.sweep.plan", "dmfc.engine.engine", "dmfc.engine.watch"
    )
    assert not loaded & HEAVY


def test_learning_needs_no_simulator_and_no_orchestration():
    """It runs where these are not installed, such as on a machine that only trains."""
    code = f"""
import sys
sys.modules.update(dict.fromkeys({sorted(ABSENT)}))
import dmfc.training.fit, dmfc.training.data, dmfc.objects.atlas
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_every_package_is_shipped():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    there = {
        ".".join(("dmfc", *path.parent.relative_to(PACKAGE).parts))
        for path in PACKAGE.rglob("*")
        if path.is_file() and path.parent.name != "__pycache__" and part(path) != "models"
    }
    assert "models/**/*" in settings["package-data"]["dmfc"]  # so a model is added without a line
    assert set(settings["packages"]) == there | {
        f"dmfc.{n}" for n in ("configs", "sweeps", "protocols")
    }
    for name, folder in settings["package-dir"].items():
        assert name in settings["packages"]
        assert list((ROOT / folder).glob("*.yaml"))
