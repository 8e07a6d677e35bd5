"""The verbs on scenes: make, look at, take along, freeze, and bring one's own."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dmfc.cli_common import (
    PRESET,
    STORE,
    AsJson,
    Overrides,
    Preset,
    Session,
    Store,
    answer,
    require,
    show_rows,
    stderr,
)
from dmfc.errors import DmfcError, unknown_name

if TYPE_CHECKING:
    from dmfc.hand.model import HandModel
    from dmfc.objects.model import ObjectModel
    from dmfc.scenes.published import PublishedSet
    from dmfc.scenes.render import View
    from dmfc.scenes.scene_set import Scene
    from dmfc.sweep.stage import Stage

scenes = typer.Typer(no_args_is_help=True, help="Scenes: layouts, point clouds, labels.")

Split = Annotated[str, typer.Option("--split", help="train or test.")]
Out = Annotated[
    str | None,
    typer.Option("--out", help="Also copy the set, its grasps and card to this folder or URL."),
]
At = Annotated[
    str | None,
    typer.Option("--at", help="A set that `make --out` or `import` wrote: folder or URL."),
]

TEST_SETTINGS = ("single_standard", "single", "multi")
"""The test sets of the paper: one object in standard pose, in random pose, several objects."""
SHEET_ROWS = 5


@scenes.command("make")
def scenes_make(
    split: Split = "train",
    out: Out = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Make the scene set of a split, with all that it needs, and its data card.

    Shards that are damaged are made again."""
    session = Session.open(preset, overrides, store)
    shards = _made(session, split)
    place = out or str(session.ledger.store / "scene_sets" / _set_name(split, shards))
    found = _publish(session, split, shards, place, copy=out is not None)
    _show(found, as_json)


@scenes.command("stats")
def scenes_stats(
    split: Split = "train",
    at: At = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Read all files, and name those that are damaged.")
    ] = False,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Counts, dropped labels and positive rates of a scene set that is there already."""
    found, _ = _open(split, at, preset, overrides, store)
    if verify and (damaged := found.damaged()):
        raise DmfcError(
            f"{len(damaged)} files of {found.place} are missing or damaged "
            f"({', '.join(damaged[:3])}): `{found.manifest['made_by']['command']}` makes them again"
        )
    _show(found, as_json)


@scenes.command("show")
def scenes_show(
    number: Annotated[int, typer.Argument(help="Position in the set.", min=0)],
    split: Split = "train",
    at: At = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="PNG file.")] = Path("scene.png"),
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Draw a scene: depth images, cloud by object, positive points, some grasps."""
    from dmfc.scenes.picture import scene_picture
    from dmfc.scenes.views import scene_views

    found, session = _open(split, at, preset, overrides, store)
    if number >= len(found.scenes):
        raise DmfcError(f"there is no scene {number}: the set holds {len(found.scenes)}")
    scene = found.scenes[number]
    config = session.config
    objects = None if at else _objects(session, split, [scene])
    views = scene_views(config.scenes, scene, objects)
    hand = _hand(session) if found.grasps else None
    out.parent.mkdir(parents=True, exist_ok=True)
    table = config.scenes.table_size
    scene_picture(scene, out, views, found.grasps or None, hand, config.matching, 4, table)
    row = {
        "scene": scene.scene,
        "objects": ", ".join(scene.object_ids),
        "labels": len(scene.grasp_index),
        "dropped": sum(scene.dropped.values()),
        "picture": str(out),
    }
    show_rows("scene", [row], as_json)


@scenes.command("import")
def scenes_import(
    clouds: Annotated[list[Path], typer.Argument(help="Clouds: .npy .ply .xyz .txt .csv")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder of the new set.")],
    unit: Annotated[str, typer.Option(help="m, cm, mm or inch.")] = "m",
    above: Annotated[float, typer.Option(help="Leave out points below this height, m.")] = -1e9,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Your own scenes: clouds of objects on a table top z = 0, without labels, as a scene set."""
    from dmfc.config.load import load_config
    from dmfc.scenes.own import import_clouds
    from dmfc.scenes.published import publish

    config = load_config(preset, overrides or [])
    out.mkdir(parents=True, exist_ok=True)
    shard = out / "scenes.parquet"
    import_clouds(clouds, shard, config.scenes, unit, above)
    found = publish(
        str(out), [shard], {}, [0.0, 0.0, 0.0], config.matching, copy=False, made_by=_made_by()
    )
    _write_card(found, [[] for _ in _spread(found)], None)
    _show(found, as_json)


@scenes.command("freeze")
def scenes_freeze(
    record: Annotated[Path, typer.Argument(help="File of digests, such as results/test_sets.json")],
    check: Annotated[bool, typer.Option("--check", help="Compare with it; 1 if they differ.")] = (
        False
    ),
    preset: Preset = "paper",
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Record the digests of the three test sets, or make them and check that they are the same.

    --check takes preset and settings from the file."""
    from dmfc.scenes.frozen import differing, set_digest
    from dmfc.scenes.scene_set import SceneSet

    given = overrides or []
    if check:
        known = _recorded(record)
        preset, given = known["preset"], known["set"]
    rows, sets = [], {}
    for kind in TEST_SETTINGS:
        session = Session.open(preset, [*given, f"scenes.test.kind={kind}"], store)
        made = SceneSet.open(_files(session, _made(session, "test")))
        sets[kind] = set_digest(made)
        row: dict[str, Any] = {"test set": kind, "scenes": len(made)}
        if check:
            wrong = differing(known["sets"][kind], sets[kind])
            row |= {f"{part} that differ": len(found) for part, found in wrong.items()}
        rows.append(row)
    if not check:
        content = {"preset": preset, "set": given, **_made_by(), "sets": sets}
        record.parent.mkdir(parents=True, exist_ok=True)
        record.write_text(json.dumps(content, indent=1) + "\n")
    show_rows("test sets", rows, as_json)
    if any(value for row in rows for name, value in row.items() if name.endswith("differ")):
        raise typer.Exit(1)


def _recorded(record: Path) -> dict[str, Any]:
    try:
        return json.loads(record.read_text())
    except (OSError, json.JSONDecodeError) as error:
        raise DmfcError(f"no digests of test sets in {record}: {error}") from error


def _open(
    split: str, at: str | None, preset: str, overrides: Sequence[str] | None, store: Path
) -> tuple[PublishedSet, Session]:
    """The set at a folder or URL, or that of the settings if all its shards are made."""
    from dmfc.scenes.published import PublishedSet

    session = Session.open(preset, overrides, store)
    if at is not None:
        return PublishedSet.open(at), session
    shards = session.builder.scenes(session.config, _split(split))
    missing = [shard for shard in shards if not session.ledger.finished(shard.address)]
    if missing:
        raise DmfcError(
            f"{len(missing)} of {len(shards)} shards of the {split} set are not made yet: "
            f"run `dmfc scenes make --split {split}`"
        )
    place = session.ledger.store / "scene_sets" / _set_name(split, shards)
    if (place / "manifest.json").is_file():
        return PublishedSet.open(str(place)), session
    return _publish(session, split, shards, str(place), copy=False), session


def _made(session: Session, split: str) -> Sequence[Stage]:
    """The shards of a split, made; what is damaged is forgotten first, and told."""
    from dmfc.sweep.store import forget_damaged

    shards = session.builder.scenes(session.config, _split(split))
    names = {shard.address: shard.name for shard in shards}
    for address, wrong in forget_damaged(session.ledger, names):
        told = f"shard {names[address]} is damaged ({', '.join(wrong)}): it is made again"
        stderr().print(told, style="yellow", markup=False, soft_wrap=True)
    require(session.make(shards), shards)
    return shards


def _publish(
    session: Session, split: str, shards: Sequence[Stage], place: str, copy: bool
) -> PublishedSet:
    """Manifest, data card and contact sheet of a set that is made."""
    from dmfc.hand.description import load_description
    from dmfc.scenes.published import publish
    from dmfc.scenes.views import scene_views

    config, ledger, hand = session.config, session.ledger, _hand(session)
    sets = session.builder.grasps(config, split)
    there = [s for s in sets if ledger.finished(s.address) and not ledger.failure(s.address)]
    found = publish(
        place,
        _files(session, shards),
        {s.name: ledger.folder(s.address) / "grasps.parquet" for s in there},
        hand.palm_reference,
        config.matching,
        seeds=config.network.levels[0],
        copy=copy,
        made_by=_made_by(),
        hand_pack=load_description(config.hand.name).pack,
    )
    shown = _spread(found)
    objects = _objects(session, split, shown)
    _write_card(found, [scene_views(config.scenes, scene, objects) for scene in shown], hand)
    return found


def _spread(found: PublishedSet) -> list[Scene]:
    """The scenes of the contact sheet."""
    import numpy as np

    rows = np.unique(np.linspace(0, len(found.scenes) - 1, SHEET_ROWS).astype(int))
    return [found.scenes[row] for row in rows]


def _write_card(
    found: PublishedSet, views: Sequence[Sequence[View]], hand: HandModel | None
) -> None:
    """`views`: of each scene of the sheet."""
    import io

    from dmfc.config.scenes import MatchingConfig
    from dmfc.scenes.card import CARD, SHEET, card_text
    from dmfc.scenes.picture import contact_sheet
    from dmfc.scenes.storage import join, write_file

    picture, grasps = io.BytesIO(), found.grasps or None
    matching = MatchingConfig(**found.manifest["matching"])
    table = found.manifest["scenes"].get("table_size", 0.8)
    contact_sheet(_spread(found), views, picture, grasps, hand, matching, table)
    write_file(join(found.place, SHEET), picture.getvalue())
    write_file(join(found.place, CARD), card_text(found.manifest).encode())


def _show(found: PublishedSet, as_json: bool) -> None:
    from dmfc.scenes.stats import stats_rows

    manifest = found.manifest
    if as_json:
        answer({"place": found.place, "bytes": manifest["bytes"], **manifest["statistics"]})
        return
    rows = [
        {"quantity": "MB on disk", "value": f"{manifest['bytes'] / 1e6:.2f}"},
        *stats_rows(manifest["statistics"]),
    ]
    show_rows(f"scenes; card: {found.place}/README.md", rows, as_json=False)


def _files(session: Session, shards: Sequence[Stage]) -> list[Path]:
    return [session.ledger.folder(shard.address) / "scenes.parquet" for shard in shards]


def _hand(session: Session) -> HandModel:
    from dmfc.hand.model import HandModel

    stage = session.builder.hand(session.config)
    require(session.make([stage]), [stage])
    return HandModel.load(session.ledger.folder(stage.address) / "hand.npz")


def _objects(session: Session, split: str, shown: Sequence[Scene]) -> Mapping[str, ObjectModel]:
    """The prepared objects of some scenes."""
    from dmfc.objects.model import ObjectModel

    names = {name for scene in shown for name in scene.object_ids}
    return {
        stage.name: ObjectModel.load(session.ledger.folder(stage.address) / "object.npz")
        for stage in session.builder.objects(session.config, split)
        if stage.name in names
    }


def _made_by() -> dict[str, str]:
    """Code and command, for manifests."""
    from dmfc.sweep.provenance import git_commit

    return {"commit": git_commit(), "command": shlex.join(["dmfc", *sys.argv[1:]])}


def _set_name(split: str, shards: Sequence[Stage]) -> str:
    """A folder's name that is the same for the same shards and version of the manifest."""
    import hashlib

    from dmfc.scenes.published import VERSION

    text = " ".join([str(VERSION), *(shard.address for shard in shards)])
    return f"{split}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def _split(name: str) -> str:
    if name not in ("train", "test"):
        raise unknown_name("split", name, ("train", "test"))
    return name
