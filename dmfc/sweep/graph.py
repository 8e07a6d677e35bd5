"""From settings to stages: what depends on which settings is decided here and nowhere else.

A stage is given a settings dataclass with every field that it must not depend on put back to its
default, so that stages of cells that differ elsewhere have one key.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from dmfc.config.losses import LossWeights, Q1Config
from dmfc.config.scenes import SceneSetConfig
from dmfc.config.schema import Config
from dmfc.errors import DmfcError
from dmfc.grasps.library import file_digest, library_file
from dmfc.sweep.kinds import KINDS, Registry, kind_of
from dmfc.sweep.stage import Stage

T = TypeVar("T")
Inputs = dict[str, Stage | tuple[Stage, ...]]


@dataclass(frozen=True)
class ObjectRef:
    """An object: its id ('ycb/mug'), a digest of its source, and how to find it on this machine."""

    id: str
    digest: str = ""
    selector: str = ""


ObjectLister = Callable[[Sequence[str]], list[ObjectRef]]
"""Selectors -> objects. Raises DmfcError where a selector selects nothing."""


@dataclass(frozen=True)
class CellStages:
    """The stages of one cell at one seed."""

    model: Stage | None
    """The trained model; None for the planner's and for random grasps."""
    evaluations: tuple[Stage, ...]
    """One per shard of test scenes."""


def without(settings: T, *fields: str) -> T:
    """`settings` with those fields back at their defaults."""
    fresh = {}
    for field in dataclasses.fields(settings):  # type: ignore[arg-type]
        if field.name in fields:
            made = field.default_factory
            fresh[field.name] = field.default if made is dataclasses.MISSING else made()
    if len(fresh) != len(fields):
        raise ValueError(f"{type(settings).__name__} lacks one of {fields}")
    return dataclasses.replace(settings, **fresh)  # type: ignore[type-var]


class GraphBuilder:
    """Builds stages from settings; equal settings give stages with equal keys."""

    def __init__(self, list_objects: ObjectLister, kinds: Registry = KINDS) -> None:
        self._list_objects, self._kinds = list_objects, kinds
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
        """The hand's model."""
        return self.stage("hand", config.hand.name, {"hand": config.hand})

    def objects(self, config: Config, split: str) -> tuple[Stage, ...]:
        """The prepared objects of a split ('train' or 'test').

        Raises DmfcError if the split is empty, or an object is in both.
        """
        train = self._select(config.objects.train, "objects.train")
        if config.objects.max_train:
            train = train[: config.objects.max_train]
        test = self._select(config.objects.test, "objects.test")
        shared = {ref.id for ref in train} & {ref.id for ref in test}
        if shared:
            raise DmfcError(
                f"'{min(shared)}' is in objects.train and in objects.test: a model must not be "
                "tested on what it was trained on"
            )
        return self._objects(config, train if split == "train" else test)

    def selected_objects(self, config: Config, selectors: Sequence[str]) -> tuple[Stage, ...]:
        """The prepared objects that the user's own selectors name."""
        return self._objects(config, self._select(selectors, "the selection"))

    def grasps(self, config: Config, split: str) -> tuple[Stage, ...]:
        """The planned grasps of each object of a split."""
        return tuple(self.grasps_of(config, obj) for obj in self.objects(config, split))

    def grasps_of(self, config: Config, obj: Stage) -> Stage:
        """The grasps of one prepared object: planned, or those of the library."""
        if config.grasps.source == "library":
            path = library_file(config.hand.name, obj.name)
            taken = {
                "library": file_digest(path),
                "object": obj.name,
                "digest": obj.config["digest"],
            }
            return self.stage("grasps", obj.name, taken, hints={"file": str(path)})
        settings = {
            "hand": config.hand,
            "grasps": without(config.grasps, "source"),
            "physics": config.physics,
            # Not losses.q1: a cell that learns with another metric keeps the same labels.
            "q1": Q1Config(),
        }
        return self.stage("grasps", obj.name, settings, {"object": obj, "hand": self.hand(config)})

    def scenes(self, config: Config, split: str) -> tuple[Stage, ...]:
        """The shards of a scene set."""
        chosen: SceneSetConfig = getattr(config.scenes, split)
        if chosen.count < 1:
            raise DmfcError(f"scenes.{split}.count is {chosen.count}: no scenes to make")
        size = max(1, config.scenes.shard_size)
        scenes = without(config.scenes, "train", "test", "shard_size", "augmentation")
        inputs: Inputs = {
            "hand": self.hand(config),
            "objects": self.objects(config, split),
            "grasps": self.grasps(config, split),
        }
        return tuple(
            self.stage(
                "scenes",
                f"{split}:{start // size}",
                {
                    "set": without(chosen, "count"),
                    "scenes": scenes,
                    "start": start,
                    "stop": min(start + size, chosen.count),
                },
                inputs,
            )
            for start in range(0, chosen.count, size)
        )

    def pretrain(self, config: Config) -> Stage:
        """Stage 1: depends on no weight but that of the confidence term, and not on stage 2."""
        weights = LossWeights(
            chamfer=1.0,
            collision=0.0,
            guidance=0.0,
            q1_upper=0.0,
            confidence=config.losses.weights.confidence,
        )
        losses = dataclasses.replace(without(config.losses, "q1"), weights=weights)
        settings = {
            **self._learning(config),
            "losses": losses,
            "training": without(config.training, "finetune"),
        }
        name = f"{config.scenes.train.kind} seed {config.training.seed}"
        return self.stage("pretrain", name, settings, self._learning_inputs(config))

    def finetune(self, config: Config, name: str) -> Stage:
        """Stage 2, from stage 1's weights."""
        settings = {
            **self._learning(config),
            "losses": config.losses,
            "training": without(config.training, "pretrain"),
        }
        inputs: Inputs = {**self._learning_inputs(config), "weights": self.pretrain(config)}
        return self.stage("finetune", f"{name} seed {config.training.seed}", settings, inputs)

    def cell(self, config: Config, model: str, name: str) -> CellStages:
        """The stages of a cell whose `model` is pretrained, finetuned, planner or random."""
        trained: Stage | None = None
        if model == "pretrained":
            trained = self.pretrain(config)
        elif model == "finetuned":
            trained = self.finetune(config, name)
        settings = {
            "row": "model" if trained else model,
            "hand": config.hand,
            "execution": config.execution,
            "physics": config.physics,
        }
        inputs: Inputs = {
            "hand": self.hand(config),
            "objects": self.objects(config, "test"),
        }
        if trained:
            inputs["model"] = trained
        if model == "planner":
            inputs["grasps"] = self.grasps(config, "test")
        shards = self.scenes(config, "test")
        return CellStages(
            trained,
            tuple(
                self.stage(
                    "evaluate",
                    f"{name}:{place} seed {config.execution.seed}",
                    settings,
                    {**inputs, "scenes": shard},
                )
                for place, shard in enumerate(shards)
            ),
        )

    def _learning(self, config: Config) -> dict[str, Any]:
        """Settings that both stages of training depend on."""
        return {
            "hand": config.hand,
            "network": config.network,
            "matching": config.matching,
            "scenes": without(config.scenes, "train", "test", "shard_size"),
        }

    def _learning_inputs(self, config: Config) -> Inputs:
        return {
            "hand": self.hand(config),
            "objects": self.objects(config, "train"),
            "grasps": self.grasps(config, "train"),
            "scenes": self.scenes(config, "train"),
        }

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

    def _select(self, selectors: Sequence[str], key: str) -> list[ObjectRef]:
        wanted = tuple(selectors)
        if wanted not in self._listed:
            self._listed[wanted] = self._list_objects(selectors) if selectors else []
        if not self._listed[wanted]:
            raise DmfcError(f"{key} selects no object: {list(selectors)}")
        return self._listed[wanted]
