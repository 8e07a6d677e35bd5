"""The commands on scenes: make, count, show, freeze, and import of a user's clouds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dmfc.cli.common import PRESET, STORE, AsJson, Overrides, Preset, Store, number
from dmfc.cli.outputs import file_to_write, folder_to_write, made
from dmfc.cli.predict import DropInvalid
from dmfc.errors import DmfcError
from dmfc.experiment.console import answer, show_rows
from dmfc.experiment.scene_sets import (
    hand_of,
    made_by,
    make_shards,
    objects_of,
    open_set,
    publish_set,
    set_name,
    shard_files,
    spread,
    write_card,
)
from dmfc.experiment.session import Session
from dmfc.files.foreign import reading

if TYPE_CHECKING:
    from dmfc.scenes.publish.published import PublishedSet

scenes = typer.Typer(no_args_is_help=True, help="Scenes: layouts, point clouds, labels.")

Split = Annotated[str, typer.Option("--split", help="train or test.")]
Out = Annotated[
    str | None,
    typer.Option(
        "--out",
        help="Also copy the set, its grasps and card to this folder or URL.",
        callback=folder_to_write(),
    ),
]
At = Annotated[
    str | None,
    typer.Option("--at", help="A set that `make --out` or `import` wrote: folder or URL."),
]

TEST_SETTINGS = ("single_standard", "single", "multi")
"""The test sets of the paper: one object in standard pose, in random pose, several objects."""


@scenes.command("make")
def scenes_make(
    split: Split = "train",
    out: Out = None,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Make the scene set of a split, after making its inputs, and its data card.

    Shards that are damaged are made again."""
    session = Session.open(preset, overrides, store)
    shards = make_shards(session, split)
    place = out or str(session.ledger.store / "scene_sets" / set_name(split, shards))
    found = publish_set(session, split, shards, place, copy=out is not None)
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
    """Counts, dropped labels and positive rates of an existing scene set."""
    found, _ = open_set(split, at, preset, overrides, store)
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
    out: Annotated[
        Path, typer.Option("-o", "--out", help="PNG file.", callback=file_to_write(".png"))
    ] = Path("scene.png"),
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Draw a scene: depth images, cloud by object, positive points, some grasps."""
    from dmfc.scenes.views import scene_views
    from dmfc.visualization.scenes import scene_picture

    found, session = open_set(split, at, preset, overrides, store)
    if number >= len(found.scenes):
        raise DmfcError(f"there is no scene {number}: the set holds {len(found.scenes)}")
    scene = found.scenes[number]
    config = session.config
    objects = None if at else objects_of(session, split, [scene])
    views = scene_views(config.scenes, scene, objects)
    hand = hand_of(session) if found.grasps else None
    made(out)
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
    clouds: Annotated[
        list[Path], typer.Argument(help="Clouds: .ply .pcd .npy .npz .xyz .txt .csv")
    ],
    out: Annotated[
        Path,
        typer.Option("-o", "--out", help="Folder of the new set.", callback=folder_to_write()),
    ],
    unit: Annotated[str, typer.Option(help="m, cm, mm or inch.")] = "m",
    above: Annotated[
        float, typer.Option(help="Leave out points below this height, m.", callback=number())
    ] = -1e9,
    drop_invalid: DropInvalid = False,
    preset: Preset = PRESET,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Import clouds of objects on a table top at z = 0 as a scene set without labels."""
    from dmfc.config.load import load_config
    from dmfc.pipeline.artifacts import SCENES
    from dmfc.scenes.custom import import_clouds
    from dmfc.scenes.publish.published import publish

    config = load_config(preset, overrides or [])
    shard = out / SCENES
    import_clouds(clouds, shard, config.scenes, unit, above, drop_invalid)
    found = publish(
        str(out), [shard], {}, [0.0, 0.0, 0.0], config.matching, copy=False, made_by=made_by()
    )
    write_card(found, [[] for _ in spread(found)], None)
    _show(found, as_json)


@scenes.command("freeze")
def scenes_freeze(
    record: Annotated[
        Path,
        typer.Argument(
            help="File of digests, such as results/test_sets.json", callback=file_to_write()
        ),
    ],
    check: Annotated[
        bool, typer.Option("--check", help="Compare with the file; exit status 1 if scenes differ.")
    ] = (False),
    preset: Preset = ["full"],  # noqa: B006
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Record the digests of the three test sets, or make them and check that they are the same.

    --check takes preset and settings from the file."""
    from dmfc.files.atomic import write_json
    from dmfc.scenes.publish.digests import differing, set_digest
    from dmfc.scenes.scene_set import SceneSet

    given = overrides or []
    if check:
        known = _recorded(record)
        preset, given = known["preset"], known["set"]
    rows, sets = [], {}
    for kind in TEST_SETTINGS:
        session = Session.open(preset, [*given, f"scenes.test.kind={kind}"], store)
        found = SceneSet.open(shard_files(session, make_shards(session, "test")))
        sets[kind] = set_digest(found)
        row: dict[str, Any] = {"test set": kind, "scenes": len(found)}
        if check:
            wrong = differing(known["sets"][kind], sets[kind])
            row |= {f"{part} that differ": len(which) for part, which in wrong.items()}
        rows.append(row)
    if not check:
        content = {"preset": preset, "set": given, **made_by(), "sets": sets}
        write_json(made(record), content)
    show_rows("test sets", rows, as_json)
    if any(value for row in rows for name, value in row.items() if name.endswith("differ")):
        raise typer.Exit(1)


def _recorded(record: Path) -> dict[str, Any]:
    with reading(record, "digests of test sets"):
        found: dict[str, Any] = json.loads(record.read_text())
    if not isinstance(found, dict) or not {"preset", "set", "sets"} <= set(found):
        raise DmfcError(f"{record} holds no digests of test sets: preset, set, sets")
    return found


def _show(found: PublishedSet, as_json: bool) -> None:
    from dmfc.scenes.publish.stats import stats_rows

    manifest = found.manifest
    if as_json:
        answer({"place": found.place, "bytes": manifest["bytes"], **manifest["statistics"]})
        return
    rows = [
        {"quantity": "MB on disk", "value": f"{manifest['bytes'] / 1e6:.2f}"},
        *stats_rows(manifest["statistics"]),
    ]
    show_rows(f"scenes; card: {found.place}/README.md", rows, as_json=False)
