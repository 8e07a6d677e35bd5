"""What the verbs on scenes share: making and opening sets, their manifests and cards."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dmfc.errors import DmfcError, unknown_name
from dmfc.experiment.console import stderr
from dmfc.experiment.session import Session, require
from dmfc.pipeline.artifacts import GRASPS, SCENES, load_hand, load_object

if TYPE_CHECKING:
    from dmfc.config.presets import Presets
    from dmfc.engine.stage import Stage
    from dmfc.hand.model import HandModel
    from dmfc.objects.model import ObjectModel
    from dmfc.scenes.publish.published import PublishedSet
    from dmfc.scenes.scene_set import Scene
    from dmfc.sensing.render import CameraView

SHEET_ROWS = 5
"""Scenes of a contact sheet."""


def open_set(
    split: str, at: str | None, preset: Presets, overrides: Sequence[str] | None, store: Path
) -> tuple[PublishedSet, Session]:
    """The set at a folder or URL, or that of the settings if all its shards are made."""
    from dmfc.scenes.publish.published import MANIFEST, PublishedSet

    session = Session.open(preset, overrides, store)
    if at is not None:
        return PublishedSet.open(at), session
    shards = session.builder.scenes(session.config, check_split(split))
    missing = [shard for shard in shards if not session.ledger.finished(shard.address)]
    if missing:
        raise DmfcError(
            f"{len(missing)} of {len(shards)} shards of the {split} set are not made yet: "
            f"run `dmfc scenes make --split {split}`"
        )
    place = session.ledger.store / "scene_sets" / set_name(split, shards)
    if (place / MANIFEST).is_file():
        return PublishedSet.open(str(place)), session
    return publish_set(session, split, shards, str(place), copy=False), session


def make_shards(session: Session, split: str) -> Sequence[Stage]:
    """The shards of a split, made; damaged ones are set aside first, with a line for each."""
    from dmfc.engine.store import repair

    shards = session.builder.scenes(session.config, check_split(split))
    names = {shard.address: shard.name for shard in shards}
    for found in repair(session.ledger, names):
        what = f"shard {names[found.address]} is damaged ({', '.join(found.wrong)})"
        told = f"{what}: it is made again" if found.aside else f"{what}, and in use"
        stderr().print(told, style="yellow", markup=False, soft_wrap=True)
    require(session.make(shards), shards)
    return shards


def publish_set(
    session: Session, split: str, shards: Sequence[Stage], place: str, copy: bool
) -> PublishedSet:
    """Manifest, data card and contact sheet of a set that is made."""
    from dmfc.hand.description import load_description
    from dmfc.scenes.publish.published import publish
    from dmfc.scenes.views import scene_views

    config, ledger, hand = session.config, session.ledger, hand_of(session)
    sets = session.builder.grasps(config, split)
    there = [s for s in sets if ledger.finished(s.address) and not ledger.failure(s.address)]
    found = publish(
        place,
        shard_files(session, shards),
        {s.name: ledger.verified(s.address) / GRASPS for s in there},
        hand.palm_reference,
        config.matching,
        seeds=config.network.levels[0],
        copy=copy,
        made_by=made_by(),
        hand_pack=load_description(config.hand.name).pack,
    )
    shown = spread(found)
    objects = objects_of(session, split, shown)
    write_card(found, [scene_views(config.scenes, scene, objects) for scene in shown], hand)
    return found


def spread(found: PublishedSet) -> list[Scene]:
    """The scenes of the contact sheet."""
    import numpy as np

    rows = np.unique(np.linspace(0, len(found.scenes) - 1, SHEET_ROWS).astype(int))
    return [found.scenes[row] for row in rows]


def write_card(
    found: PublishedSet, views: Sequence[Sequence[CameraView]], hand: HandModel | None
) -> None:
    """`views`: of each scene of the sheet."""
    import io

    from dmfc.config.scenes import MatchingConfig
    from dmfc.files.storage import join, write_file
    from dmfc.scenes.publish.card import CARD, SHEET, card_text
    from dmfc.visualization.scenes import contact_sheet

    picture, grasps = io.BytesIO(), found.grasps or None
    matching = MatchingConfig(**found.manifest["matching"])
    table = found.manifest["scenes"].get("table_size", 0.8)
    contact_sheet(spread(found), views, picture, grasps, hand, matching, table)
    write_file(join(found.place, SHEET), picture.getvalue())
    write_file(join(found.place, CARD), card_text(found.manifest).encode())


def shard_files(session: Session, shards: Sequence[Stage]) -> list[Path]:
    return [session.ledger.verified(shard.address) / SCENES for shard in shards]


def hand_of(session: Session) -> HandModel:
    stage = session.builder.hand(session.config)
    require(session.make([stage]), [stage])
    return load_hand(session.ledger.verified(stage.address), session.config.closing)


def objects_of(session: Session, split: str, shown: Sequence[Scene]) -> Mapping[str, ObjectModel]:
    """The prepared objects of some scenes."""
    names = {name for scene in shown for name in scene.object_ids}
    return {
        stage.name: load_object(session.ledger.verified(stage.address))
        for stage in session.builder.objects(session.config, split)
        if stage.name in names
    }


def made_by() -> dict[str, str]:
    """Code and command, for manifests."""
    from dmfc.engine.provenance import git_commit

    return {"commit": git_commit(), "command": shlex.join(["dmfc", *sys.argv[1:]])}


def set_name(split: str, shards: Sequence[Stage]) -> str:
    """A folder's name that is the same for the same shards and version of the manifest."""
    from dmfc.files.digest import text_digest
    from dmfc.scenes.publish.published import VERSION

    text = " ".join([str(VERSION), *(shard.address for shard in shards)])
    return f"{split}-{text_digest(text)[:12]}"


def check_split(name: str) -> str:
    if name not in ("train", "test"):
        raise unknown_name("split", name, ("train", "test"))
    return name
