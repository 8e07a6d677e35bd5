"""Imports point one way, importing is light, and everything that is there is shipped."""

from __future__ import annotations

import ast
import graphlib
import subprocess
import sys
import tomllib
from collections.abc import Iterable
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
    {"methods"},
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
    return imports_of(ast.walk(ast.parse(path.read_text())))


def imports_of(nodes: Iterable[ast.AST]) -> set[str]:
    """Dotted names that import statements among `nodes` import; there are no relative ones."""
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"a relative import of {node.module}"
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


def runtime_imports(path: Path) -> set[str]:
    """As `imports`, without those for type checks alone (`if TYPE_CHECKING:`)."""
    tree = ast.parse(path.read_text())
    typed = {
        child
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for statement in node.body
        for child in ast.walk(statement)
    }
    return imports_of(node for node in ast.walk(tree) if node not in typed)


def module_graph() -> dict[str, set[str]]:
    """Each module of the package and the modules that it imports, inside functions too."""
    names = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in modules()
    }

    def module_of(imported: str) -> str | None:
        while imported and imported not in names:
            imported = imported.rpartition(".")[0]
        return imported or None

    return {
        name: {module_of(imported) for imported in runtime_imports(path)} - {None, name}
        for name, path in names.items()
    }


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules that import one another in a circle; empty if there are none."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def test_a_circle_is_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": set()}) == []
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"b"}})) == {"b", "c"}


def test_no_files_import_one_another():
    graph = module_graph()
    assert "dmfc.sweep.search_plan" in graph["dmfc.sweep.planner"]
    assert "dmfc.prediction.planner" in graph["dmfc"]  # an import inside a function counts
    assert circle(graph) == []


def test_the_engine_knows_nothing_of_the_science():
    allowed = {"engine", "errors", "files", "config"}
    for path in (PACKAGE / "engine").glob("*.py"):
        used = {name.split(".")[1] for name in imports(path) if name.startswith("dmfc.")}
        assert used <= allowed, f"{path.name} imports {sorted(used - allowed)}"


def loaded_by(*names: str) -> set[str]:
    """Top-level packages in a fresh interpreter after importing modules of dmfc."""
    code = f"import {', '.join(names)}, sys; print(*{{n.split('.')[0] for n in sys.modules}})"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True
    )
    return set(done.stdout.split())


def test_the_command_line_is_light():
    loaded = loaded_by(
        "dmfc.cli.main", "dmfc.sweep.planner", "dmfc.engine.engine", "dmfc.engine.watch"
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
