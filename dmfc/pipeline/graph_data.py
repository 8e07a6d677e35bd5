"""From settings to the stages of data: the hand, objects, grasps and scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dmfc.config.losses import Q1Config
from dmfc.config.scenes import ScenesConfig, SceneSetConfig
from dmfc.config.schema import Config
from dmfc.engine.kinds import Registry, kind_of
from dmfc.engine.stage import Stage, without
from dmfc.errors import DmfcError
from dmfc.files.digest import file_digest
from dmfc.grasps.library import in_library, library_file, library_folder
from dmfc.hand.description import custom_hand_digest
from dmfc.pipeline.kinds import KINDS

MOST_SHARDS = 5000
"""Most stages of one scene set."""
Inputs = dict[str, Stage | tuple[Stage, ...]]


@dataclass(frozen=True)
class ObjectRef:
    """An object: its id ('ycb/mug'), a digest of its source, and how to find it on this machine."""

    id: str
    digest: str = ""
    selector: str = ""


ObjectLister = Callable[[Sequence[str]], list[ObjectRef]]
"""Selectors -> objects. Raises DmfcError where a selector selects nothing."""


def of_every_scene(config: Config) -> ScenesConfig:
    """Settings that count for each single scene, of any set."""
    return without(config.scenes, "train", "test", "shard_size", "augmentation")


class DataGraph:
    """Builds the stages of data from settings; equal settings give stages with equal keys."""

    def __init__(
        self,
        list_objects: ObjectLister,
        kinds: Registry = KINDS,
        grasp_files: Mapping[str, Path] | None = None,
    ) -> None:
        """`grasp_files`: grasp sets that are taken as they are, by the id of their object."""
        self._list_objects, self._kinds = list_objects, kinds
        self._grasp_files = grasp_files or {}
        self._listed: dict[tuple[str, ...], list[ObjectRef]] = {}

    def stage(
        self,
        kind: str,
        name: str,
        config: Mapping[str, Any],
        inputs: Mapping[str, Stage | tuple[Stage, ...]] | None = None,
        hints: Mapping[str, str] | None = None,
    ) -> Stage:
        """A stage of a registered kind."""
        version = kind_of(kind, self._kinds).version
        return Stage(kind, name, version, config, inputs or {}, hints or {})

    def hand(self, config: Config) -> Stage:
        """The hand's model; of a custom hand, what its files hold counts, too."""
        digest = custom_hand_digest(config.hand.name)
        files = {"files": digest} if digest else {}
        return self.stage("hand", config.hand.name, {"hand": config.hand, **files})

    def objects(self, config: Config, split: str) -> tuple[Stage, ...]:
        """The prepared objects of a split: train, validation or test. DmfcError if it is empty."""
        return self._objects(config, self._split(config, split))

    def selected_objects(self, config: Config, selectors: Sequence[str]) -> tuple[Stage, ...]:
        """The prepared objects that the user's own selectors name."""
        return self._objects(config, self._select(selectors, "the selection"))

    def grasps(self, config: Config, split: str) -> tuple[Stage, ...]:
        """The planned grasps of each object of a split."""
        return tuple(self.grasps_of(config, obj) for obj in self.objects(config, split))

    def grasps_of(self, config: Config, obj: Stage) -> Stage:
        """The grasps of one prepared object: planned, or those of the library."""
        path = self._grasp_files.get(obj.name)
        if path is None:
            path = self._from_library(config, obj)
        if path is not None:
            taken = {
                "library": file_digest(path),
                "object": obj.name,
                "digest": obj.config["digest"],
            }
            return self.stage("grasps", obj.name, taken, hints={"file": str(path)})
        settings = {
            "hand": config.hand,
            "closing": config.closing,
            "grasps": without(config.grasps, "source", "library"),
            "physics": config.physics,
            # Not losses.q1: a cell that learns with another metric keeps the same labels.
            "q1": Q1Config(),
        }
        return self.stage("grasps", obj.name, settings, {"object": obj, "hand": self.hand(config)})

    def _from_library(self, config: Config, obj: Stage) -> Path | None:
        """The library's grasps of an object, where `grasps.source` wants them; None: plan."""
        source, folder = config.grasps.source, library_folder(config.grasps.library)
        there = in_library(config.hand.name, obj.name, folder)
        if source == "plan" or (source == "either" and not there):
            return None
        return library_file(config.hand.name, obj.name, folder)

    def scenes(self, config: Config, split: str, labelled: bool = True) -> tuple[Stage, ...]:
        """The shards of a scene set; the same scenes where they are not labelled with grasps."""
        chosen: SceneSetConfig = (
            config.validation.scenes if split == "validation" else getattr(config.scenes, split)
        )
        setting = "validation.scenes" if split == "validation" else f"scenes.{split}"
        size = config.scenes.shard_size
        shards = -(-chosen.count // size)
        if shards > MOST_SHARDS:
            raise DmfcError(
                f"{setting}.count {chosen.count:,} in shards of {size:,} makes {shards:,} stages, "
                f"more than {MOST_SHARDS:,}: raise scenes.shard_size"
            )
        scenes = of_every_scene(config)
        inputs: Inputs = {"hand": self.hand(config), "objects": self.objects(config, split)}
        if labelled:
            inputs["grasps"] = self.grasps(config, split)
        # Training goes on without an object that fails; a test without one is another test.
        tolerant = {"failed_objects": "left out"} if split == "train" else {}
        return tuple(
            self.stage(
                "scenes",
                f"{split}:{start // size}",
                {
                    "set": without(chosen, "count"),
                    "scenes": scenes,
                    # Labels must leave room for the opened hand; no squeeze is involved.
                    "closing": without(config.closing, "squeeze"),
                    "start": start,
                    "stop": min(start + size, chosen.count),
                    **tolerant,
                },
                inputs,
            )
            for start in range(0, chosen.count, size)
        )

    def _objects(self, config: Config, refs: Sequence[ObjectRef]) -> tuple[Stage, ...]:
        prepare = config.objects.prepare
        return tuple(
            self.stage(
                "object",
                ref.id,
                {"object": ref.id, "digest": ref.digest, "prepare": prepare},
                hints={"selector": ref.selector or ref.id},
            )
            for ref in refs
        )

    def _split(self, config: Config, split: str) -> list[ObjectRef]:
        if split == "validation":
            return self._select(config.validation.objects, "validation.objects")
        found = self._select(getattr(config.objects, split), f"objects.{split}")
        wanted = config.objects.max_train if split == "train" else 0
        return found[:wanted] if wanted else found

    def _select(self, selectors: Sequence[str], key: str) -> list[ObjectRef]:
        wanted = tuple(selectors)
        if wanted not in self._listed:
            self._listed[wanted] = self._list_objects(selectors) if selectors else []
        if not self._listed[wanted]:
            raise DmfcError(f"{key} selects no object: {list(selectors)}")
        return self._listed[wanted]
