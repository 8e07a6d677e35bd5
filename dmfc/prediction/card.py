"""The card of a shipped model: its training data, its code, and its measured rates."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from dmfc.config.interpolation import refuse_interpolation
from dmfc.engine.record import RECORD
from dmfc.network.model_files import CONFIG, SUMMARY

UNMEASURED = "This model was not evaluated."


def model_card(stage: Path, name: str, measured: str = "") -> str:
    """Markdown for the trained network in the folder `stage`; says only what its files say."""
    settings: Any = OmegaConf.load(stage / CONFIG)
    refuse_interpolation(settings, str(stage / CONFIG))
    record = _json(stage / RECORD)
    summary = _json(stage / SUMMARY)
    # Stages of before the rename have `own`.
    weights = {
        **settings.losses.weights,
        **settings.losses.get("custom", settings.losses.get("own", {})),
    }
    rows = {
        "network": f"PointNet++, {settings.network.levels[0]} grasps per cloud, "
        f"{_or_unknown(summary.get('parameters'))} parameters",
        "hand": settings.hand,
        "trained with": f"stage {settings.stage}, {_or_unknown(summary.get('epochs'))} epochs, "
        f"batch {settings.training.batch_size}, seed {settings.training.seed}",
        "losses": ", ".join(f"{term} {weight:g}" for term, weight in weights.items() if weight),
        "data": _data(stage, record),
        "code": f"commit {str(record.get('commit') or 'unknown')[:7]}",
        "key of the stage": f"{record.get('kind', '?')}/{record.get('key', '?')}",
        "digest of the data": str(summary.get("data_digest", "unknown"))[:16],
    }
    table = "\n".join(f"| {what} | {value} |" for what, value in rows.items())
    last = summary.get("last", {}).get("train", {})
    errors = [
        f"{last[key]:.0f} {unit}"
        for key, unit in (("translation_mm", "mm"), ("rotation_deg", "degrees"))
        if key in last
    ]
    return f"""# {name}

A dense multi-fingered grasp network of `dmfc` (`dmfc predict CLOUD --model {name}`).

| | |
|---|---|
{table}

{measured or UNMEASURED}

{_errors(errors)}
Input: points on the visible surface of objects on a table, without the table, gravity along -z, in
metres. Output: palm poses and joint angles. The network does not check them for collision
(`--check` does, against the cloud), and the confidence is its own, not a measured rate. Not tried
on a real hand or a real camera.

Licence: Apache-2.0, as the package.
"""


def _data(stage: Path, record: dict[str, Any]) -> str:
    """What the stages that it was trained on say; they lie beside it in a store."""
    shards = [_json(stage.parents[1] / a / RECORD) for a in _inputs(record, "scenes")]
    made = [shard.get("config", {}) for shard in shards]
    if not made or not all(made):
        return "unknown"
    count = sum(config["stop"] - config["start"] for config in made)
    kinds = " and ".join(sorted({config["set"]["kind"] for config in made}))
    points = made[0]["scenes"]["points"]
    return (
        f"{count} scenes ({kinds}) of {len(_inputs(record, 'objects'))} objects, {points} points "
        "each, from four simulated depth cameras"
    )


def _inputs(record: dict[str, Any], name: str) -> list[str]:
    given = record.get("inputs", {}).get(name, [])
    return [given] if isinstance(given, str) else given


def _errors(errors: list[str]) -> str:
    if not errors:
        return ""
    told = " and ".join(errors)
    return f"On its training scenes the nearest label of a labelled point is {told} away.\n"


def _or_unknown(value: Any) -> str:
    return "unknown" if value is None else f"{value:,}"


def _json(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.is_file() else {}


def judge_card(stage: Path, measured: str = "") -> str:
    """Markdown for the outcome predictor in the folder `stage`; says only what its files say."""
    about = _json(stage / "outcome.json")
    record = _json(stage / "stage.json")
    found = about["unseen_objects"]
    bins = found["reliability"]
    rows = "\n".join(
        f"| {said:.2f} | {happened:.2f} | {trials} |"
        for said, happened, trials in zip(
            bins["said"], bins["happened"], bins["trials"], strict=True
        )
    )
    return f"""# Outcome predictor

Tells how likely a grasp is to be planned, and to hold once it is planned, from the cloud and the
hand alone: {about["features"]} numbers, {about["members"]} networks of widths {about["widths"]}.
Hand: {about["hand"]["name"]}. Code: commit {str(record.get("commit") or "unknown")[:7]}, stage
`{record.get("kind", "?")}/{record.get("key", "?")}`.

It learned from executed predictions of its model ({found["trials"]} that were clear of the cloud,
of {found["objects"]} objects in {found["scenes"]} scenes; {found["held_rate"]:.2f} held). On
objects that a network of it had not seen:

| | |
|---|---|
| AUC of held | {found["held_auc"]:.3f} |
| the same within a scene | {found["held_auc_within"]:.3f} |
| AUC of planned | {found["planned_auc"]:.3f} |
| expected calibration error | {found["calibration_error"]:.3f} |

| said | held | trials |
|---|---|---|
{rows}

{measured or UNMEASURED.replace("model", "predictor")}

It learned in the simulator that judges. Of what the cameras did not see it knows only that a place
is inside an object where nearly every way out of it meets an observed point. Not tried on a real
hand.
"""
