"""The data card of a scene set: its manifest in words, and a contact sheet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

CARD, SHEET = "README.md", "sheet.png"
REASONS = {
    "table": "hand in the table",
    "neighbour": "hand in a neighbour",
    "limit": "more than `scenes.max_grasps`",
}
"""The reasons of `dmfc.scenes.labels` in words."""


def card_text(manifest: Mapping[str, Any]) -> str:
    """The data card as Markdown, for a manifest of `dmfc.scenes.publish.published`."""
    stats = manifest["statistics"]
    settings = _flat({"set": manifest["set"], **manifest["scenes"]})
    lines = ["# Scene set", "", *_table(("", ""), _facts(manifest).items()), ""]
    lines += ["## What is in it", "", *_table(("quantity", "value"), _counts(stats)), ""]
    if "matching" in stats:
        lines += _label_part(manifest)
    lines += [
        f"![Some scenes]({SHEET})",
        "",
        "Per row, as far as the set has them: two depth images around the objects, the cloud by",
        "object on lines 10 cm apart, the points with a label (red), and some labels.",
        "",
        "## Settings",
        "",
        *_table(("setting", "value"), settings.items()),
        "",
    ]
    return "\n".join(lines)


def _facts(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """What it is, where it comes from, who made it."""
    stats, shards = manifest["statistics"], manifest["shards"]
    kinds = Counter(name.split("/")[0] for name in manifest["objects"])
    facts = {
        "scenes": stats["scenes"],
        "kind": manifest["set"].get("kind", "own clouds"),
        "seed": manifest["set"].get("seed", ""),
        "size": f"{manifest['bytes'] / 1e6:.2f} MB in {len(shards)} shards, "
        f"{manifest['bytes'] / max(1, stats['scenes']) / 1e3:.1f} kB per scene",
        "objects": ", ".join(f"{count} {kind}" for kind, count in kinds.items()),
        "packs": ", ".join(f"{n} ({sha[:12]})" for n, sha in manifest["packs"].items()),
        "hand": manifest["hand"] or "none, no labels",
        "renderer": manifest["renderer"] or "",
        **manifest["made_by"],
    }
    return {name: value for name, value in facts.items() if value != ""}


def _counts(stats: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Counts, and the share of the objects' grasps that each reason costs."""
    rows: list[tuple[str, Any]] = [("points per scene", stats["points"] // stats["scenes"])]
    if stats["objects"]:
        often = f"{stats['appearances_min']} to {stats['appearances_max']}"
        rows += [
            ("objects per scene", f"{stats['objects_per_scene']:.2f}"),
            ("scenes in which an object appears", often),
        ]
    if "matching" in stats:
        candidates = stats["grasps"] + sum(stats["dropped"].values())
        share = 100 / max(1, candidates)
        rows += [
            ("grasps of the objects, scene by scene", candidates),
            *(
                (f"dropped: {REASONS[reason]}", f"{count} ({count * share:.1f} %)")
                for reason, count in stats["dropped"].items()
            ),
            ("labels", f"{stats['grasps']} ({stats['grasps'] * share:.1f} %)"),
            ("labels of a scene, median", f"{stats['grasps_per_scene_median']:g}"),
            ("scenes without a label", stats["scenes_without_grasps"]),
        ]
    return rows


def _label_part(manifest: Mapping[str, Any]) -> list[str]:
    """The positive rates of every way of matching; that of the settings is bold."""
    stats, chosen = manifest["statistics"], manifest["matching"]["mode"]
    head = ("matching", "points", "labels of points", "seeds", "labels of seeds")
    names = ("points", "grasps", "seeds", "grasps_of_seeds")
    rows = [
        (
            f"**{mode}**" if mode == chosen else mode,
            *(f"{100 * rates[f'positive_{name}']:.1f} %" for name in names),
        )
        for mode, rates in stats["matching"].items()
    ]
    return [
        "## Positive rates",
        "",
        *_table(head, rows),
        "",
        "The share of points, or of the seeds that a network predicts at, with a label; and of",
        f"labels with such a point, over {stats['scenes_rated']} scenes. A label that matches no",
        "seed is lost.",
        "",
    ]


def _table(head: tuple[str, ...], rows: Iterable[tuple[Any, ...]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(map(str, line)) + " |" for line in lines]


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        inner = isinstance(value, Mapping)
        flat |= _flat(value, f"{prefix}{name}.") if inner else {f"{prefix}{name}": value}
    return flat
