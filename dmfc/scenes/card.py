"""The data card of a scene set: what its manifest says, for people, beside a contact sheet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dmfc.scenes.stats import stats_rows

CARD, SHEET = "README.md", "sheet.png"


def card_text(manifest: Mapping[str, Any]) -> str:
    """The data card as Markdown, for a manifest of `dmfc.scenes.published`."""
    stats = manifest["statistics"]
    kept = manifest["scenes"].get("depth") == "keep"
    settings = _flat({"set": manifest["set"], **manifest["scenes"]})
    facts = {
        "scenes": stats["scenes"],
        "kind": manifest["set"].get("kind", "own clouds"),
        "seed": manifest["set"].get("seed", ""),
        "size": f"{manifest['bytes'] / 1e6:.2f} MB in {len(manifest['shards'])} shards, "
        f"{manifest['bytes'] / max(1, stats['scenes']) / 1e3:.1f} kB per scene",
        "depth images": "kept" if kept else "not kept, rendered anew when shown",
        "renderer": manifest["renderer"] or "",
        "objects": f"{len(manifest['objects'])}",
        "packs": ", ".join(f"{n} ({sha[:12]})" for n, sha in manifest["packs"].items()) or "none",
        "hand": manifest["hand"] or "none, no labels",
        **manifest["made_by"],
    }
    lines = ["# Scene set", "", *_table(("", ""), facts.items()), "", "## What is in it", ""]
    rows = [(row["quantity"], row["value"]) for row in stats_rows(stats)]
    lines += [
        *_table(("quantity", "value"), rows),
        "",
        "A label is dropped where the hand would be in the table or in a neighbour, and where the",
        "object has more than `scenes.max_grasps`. Positive rates: the share of points (or of the",
        "seeds that a network predicts at) with a grasp, and of grasps with a point, over",
        f"{stats.get('scenes_rated', 0)} scenes.",
        "",
        f"![Some scenes]({SHEET})",
        "",
        "Per row: two depth images, the cloud by object, the positive points, some grasps.",
        "",
        "## Settings",
        "",
        *_table(("setting", "value"), settings.items()),
        "",
    ]
    return "\n".join(lines)


def _table(head: tuple[str, str], rows: Any) -> list[str]:
    lines = [f"| {head[0]} | {head[1]} |", "| --- | --- |"]
    return lines + [f"| {name} | {value} |" for name, value in rows]


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        inner = isinstance(value, Mapping)
        flat |= _flat(value, f"{prefix}{name}.") if inner else {f"{prefix}{name}": value}
    return flat
