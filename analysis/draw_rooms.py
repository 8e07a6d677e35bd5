"""Draws the rooms of the package and which imports which: docs/figures/rooms.png.

python -m analysis.draw_rooms
"""

from __future__ import annotations

import ast
from pathlib import Path

import networkx as nx
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "dmfc"


def rooms() -> dict[str, set[str]]:
    """Each room, and the rooms whose modules it imports anywhere."""
    found: dict[str, set[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE).parts
        if len(parts) < 2:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            module = node.module if isinstance(node, ast.ImportFrom) else None
            names = (module or "").split(".")
            if names[0] == "dmfc" and len(names) > 2 and names[1] != parts[0]:
                found.setdefault(parts[0], set()).add(names[1])
        found.setdefault(parts[0], set())
    return found


def draw(path: Path) -> None:
    """Write the picture: an arrow to each room that a room uses and reaches by no other way."""
    graph = nx.DiGraph([(room, other) for room, used in rooms().items() for other in used])
    floors = [sorted(floor) for floor in nx.topological_generations(graph)]
    at = {
        room: ((i + 0.5 + 0.2 * (level % 2)) / max(len(floor), 2), -level)
        for level, floor in enumerate(floors)
        for i, room in enumerate(floor)
    }
    figure = Figure(figsize=(8, 9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.set_axis_off()
    for room, other in nx.transitive_reduction(graph).edges:
        style = {"arrowstyle": "-|>", "color": "#8794a8", "lw": 1, "shrinkA": 13, "shrinkB": 13}
        axes.annotate("", at[other], at[room], arrowprops=style)
    for room, (x, y) in at.items():
        box = {"boxstyle": "round,pad=0.4", "fc": "#eef3fb", "ec": "#41679f"}
        axes.text(x, y, room, ha="center", va="center", fontsize=11, bbox=box, zorder=3)
    axes.set_xlim(0, 1.1)
    axes.set_ylim(0.5 - len(floors), 0.5)
    figure.savefig(path, dpi=90)


if __name__ == "__main__":
    draw(ROOT / "docs" / "figures" / "rooms.png")
