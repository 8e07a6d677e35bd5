"""A view as one HTML file: the template with the arrays in it. It loads nothing from anywhere."""

from __future__ import annotations

import base64
import html
import json
from pathlib import Path
from typing import Any

import numpy as np

from dmfc.view.data import Mesh, Motion, View

TEMPLATE = Path(__file__).with_name("page.html")
TITLE_MARK, DATA_MARK = "<!-- title -->", "<!-- data -->"


def make_page(view: View) -> str:
    """The whole HTML of a view."""
    before, _, rest = TEMPLATE.read_text().partition(TITLE_MARK)
    between, _, after = rest.partition(DATA_MARK)
    data = script_json(page_data(view))
    return before + html.escape(view.title) + between + data + after


def page_data(view: View) -> dict[str, Any]:
    """A view as JSON's types. A pose [4, 4] is its upper three rows, a mesh's frame its own."""
    return {
        "title": view.title,
        "subtitle": view.subtitle,
        "points": packed(view.points, "f4"),
        "point_object": None if view.point_object is None else packed(view.point_object, "u1"),
        "object_names": view.object_names,
        "objects": [_mesh(mesh) for mesh in view.objects],
        "T_world_object": packed(view.T_world_object[:, :3], "f4"),
        "R_view_world": packed(view.R_view_world, "f4"),
        "floor": view.floor,
        "glyphs": packed(view.grasps.glyphs, "f4"),
        "confidence": packed(view.grasps.confidence, "f4"),
        "T_world_link": packed(view.grasps.T_world_link[:, :, :3], "f4"),
        "hand": [_mesh(mesh) for mesh in view.hand],
        "selected": view.selected,
        "motion": None if view.motion is None else _motion(view.motion),
    }


def packed(array: np.ndarray, kind: str) -> dict[str, Any]:
    """An array as base64 of its little-endian numbers, row by row; `kind`: f4, u1 or u4."""
    content = np.ascontiguousarray(array, dtype=f"<{kind}").tobytes()
    return {
        "kind": kind,
        "shape": list(np.shape(array)),
        "base64": base64.b64encode(content).decode(),
    }


def script_json(value: Any) -> str:
    """JSON that may stand inside a script tag: no text in it can close the tag or open another."""
    text = json.dumps(value, allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _mesh(mesh: Mesh) -> dict[str, Any]:
    return {
        "name": mesh.name,
        "vertices": packed(mesh.vertices, "f4"),
        "faces": packed(mesh.faces, "u4"),
    }


def _motion(motion: Motion) -> dict[str, Any]:
    return {
        "name": motion.name,
        "outcome": motion.outcome,
        "seconds": packed(motion.seconds, "f4"),
        "phase": motion.phase,
        "T_world_link": packed(motion.T_world_link[:, :, :3], "f4"),
        "T_world_object": packed(motion.T_world_object[:, :, :3], "f4"),
    }
