"""From settings to stages: what depends on which settings is decided here and nowhere else.

A stage is given a settings dataclass with every field that it must not depend on put back to its
default, so that stages of cells that differ elsewhere have one key.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dmfc.config.custom_function import is_own, own_class, own_function
from dmfc.config.execution import ExecutionConfig
from dmfc.config.losses import LossWeights, Q1Config
from dmfc.config.protocol import executed
from dmfc.config.scenes import ScenesConfig, SceneSetConfig
from dmfc.config.schema import Config
from dmfc.engine.kinds import Registry, kind_of
from dmfc.engine.stage import Stage, without
from dmfc.errors import DmfcError
from dmfc.files.digest import file_digest
from dmfc.grasps.library import in_library, library_file, library_folder
from dmfc.hand.description import own_hand_digest
from dmfc.network.model_files import BACKBONE, WEIGHTS
from dmfc.pipeline.graph_method import method_settings
from dmfc.pipeline.graph_outcome import judge
from dmfc.pipeline.kinds import KINDS
from dmfc.prediction.models import model_folder

HARD_SAMPLES = "hard_samples", "hard_error", "hard_scope", "rank_points"
"""Settings of `training` that choose hard samples."""
OF_FINETUNING = (
    "finetune",
    "finetune_seeds",
    "finetune_form",
    "finetune_from",
    "projection",
    "diagnostic_scenes",
)
"""Settings of `training` that pre-training knows nothing of."""
APPROACH = "pregrasp_distance", "waypoints", "approach_tolerance", "grasp_tolerance"
"""Settings of `execution` that the swept collision depends on."""
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


@dataclass(frozen=True)
class CellStages:
    """The stages of one cell at one seed."""

    model: Stage | None
    """The trained model; None for the planner's and for random grasps."""
    evaluations: tuple[Stage, ...]
    """One per shard of test scenes."""

    @property
    def last(self) -> tuple[Stage, ...]:
        """Those that no other stage of the cell uses."""
        return self.evaluations or ((self.model,) if self.model else ())


def _in_units(under: Config) -> ExecutionConfig:
    """Settings of execution as an evaluation has them: the threshold of confidence as it is."""
    execution = without(under.execution, "protocol", "changes", "confidence_unit")
    if under.execution.confidence_unit == "one":
        return execution
    least = execution.min_confidence * under.losses.weights.confidence
    return dataclasses.replace(execution, min_confidence=least)


def _unused_in_pretraining(config: Config) -> tuple[str, ...]:
    """Settings of `training` that are of fine-tuning, or are left to it."""
    chosen = () if config.training.hard_stages == "both" else HARD_SAMPLES
    return *OF_FINETUNING, *chosen


def _of_every_scene(config: Config) -> ScenesConfig:
    """Settings that count for each single scene, of any set."""
    return without(config.scenes, "train", "test", "shard_size", "augmentation")


class GraphBuilder:
    """Builds stages from settings; equal settings give stages with equal keys."""

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
        """The hand's model; of a user's own hand, what its files hold counts, too."""
        own = own_hand_digest(config.hand.name)
        files = {"files": own} if own else {}
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
        scenes = _of_every_scene(config)
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

    def pretrain(self, config: Config) -> Stage:
        """Stage 1: depends on chamfer and confidence, on no other term, and not on stage 2."""
        weights = LossWeights(
            chamfer=1.0,
            collision=0.0,
            guidance=0.0,
            q1_upper=0.0,
            confidence=config.losses.weights.confidence,
        )
        unused = ("q1", "q1_lower", "units", "self_collision", "own", "swept", "saturated")
        losses = dataclasses.replace(without(config.losses, *unused), weights=weights)
        settings = {
            **self._learning(config),
            "losses": losses,
            "training": without(config.training, *_unused_in_pretraining(config)),
        }
        name = f"{config.scenes.train.kind} seed {config.training.seed}"
        return self.stage("pretrain", name, settings, self._learning_inputs(config))

    def finetune(self, config: Config, name: str) -> Stage:
        """Stage 2, from stage 1's weights or those of a trained model."""
        settings = {
            **self._learning(config),
            "losses": config.losses,
            "training": without(config.training, "pretrain", "finetune_from"),
        }
        if config.losses.weights.swept != 0:
            way = {name: getattr(config.execution, name) for name in APPROACH}
            settings["execution"] = dataclasses.replace(ExecutionConfig(), **way)
            settings["closing"] = without(config.closing, "squeeze")
        if config.losses.own:
            own = {text: own_function(text, "losses.own").digest for text in config.losses.own}
            settings["own_losses"] = own
        inputs, hints = self._learning_inputs(config), {}
        start = config.training.finetune_from
        if start:
            folder = model_folder(start)
            settings["start"] = file_digest(folder / WEIGHTS)
            hints["start"] = str(folder)
        else:
            inputs["weights"] = self.pretrain(config)
        return self.stage(
            "finetune", f"{name} seed {config.training.seed}", settings, inputs, hints
        )

    def cell(
        self,
        config: Config,
        model: str,
        name: str,
        checkpoint: Path | None = None,
        method: str | Path | None = None,
    ) -> CellStages:
        """The stages of a cell whose `model` is pretrained, finetuned, planner or random.

        With a `checkpoint`, the folder of a trained model, that one is executed; with a `method`,
        that one (see `method_settings`).
        Raises DmfcError where a model would be tested on an object that it was trained on.
        """
        trained: Stage | None = None
        hints: dict[str, str] = {}
        if model == "pretrained":
            trained = self.pretrain(config)
        elif model == "finetuned":
            trained = self.finetune(config, name)
        under = executed(config)
        settings = {
            "row": "model" if trained or checkpoint else model,
            "hand": under.hand,
            "closing": under.closing,
            "execution": _in_units(under),
            "physics": under.physics,
        }
        if is_own(under.execution.test):
            settings["own_test"] = own_class(under.execution.test, "execution.test").digest
        if method is not None:
            own, hints = method_settings(method)
            settings |= own
        if checkpoint:
            settings["weights"] = file_digest(checkpoint / WEIGHTS)
            if (checkpoint / BACKBONE).is_file():
                settings["backbone"] = file_digest(checkpoint / BACKBONE)
            hints["weights"] = str(checkpoint)
        inputs: Inputs = {
            "hand": self.hand(config),
            "objects": self.objects(config, "test"),
        }
        if trained:
            inputs["model"] = trained
        if model == "planner":
            inputs["grasps"] = self.grasps(config, "test")
        if under.execution.score == "outcome":
            more = judge(self, config, trained, checkpoint)
            settings, inputs, hints = settings | more[0], inputs | more[1], hints | more[2]
        # Only the planner executes labels. Those of the library cost nothing; where they would have
        # to be planned, the scenes have none, and the planner's row labels them itself.
        labelled = all("library" in stage.config for stage in self.grasps(config, "test"))
        if model == "planner" and not labelled:
            settings["labels"] = _of_every_scene(config)
        shards = self.scenes(config, "test", labelled)
        return CellStages(
            trained,
            tuple(
                self.stage(
                    "evaluate",
                    f"{name}:{place} seed {config.execution.seed}",
                    settings,
                    {**inputs, "scenes": shard},
                    hints,
                )
                for place, shard in enumerate(shards)
            ),
        )

    def _learning(self, config: Config) -> dict[str, Any]:
        """Settings that both stages of training depend on; validation where there is any."""
        more: dict[str, Any] = {}
        if config.validation.objects:
            more["validation"] = config.validation
        if is_own(config.network.backbone):
            backbone = own_class(config.network.backbone, "network.backbone")
            more["own_backbone"] = {config.network.backbone: backbone.digest}
        return more | {
            "hand": config.hand,
            "network": config.network,
            "matching": config.matching,
            "scenes": without(config.scenes, "train", "test", "shard_size"),
        }

    def _learning_inputs(self, config: Config) -> Inputs:
        tested = {ref.id for ref in self._split(config, "test")}
        shared = tested & {ref.id for ref in self._split(config, "train")}
        if shared:
            raise DmfcError(
                f"'{min(shared)}' is in objects.train and in objects.test: a model must not be "
                "tested on what it was trained on"
            )
        inputs: Inputs = {
            "hand": self.hand(config),
            "objects": self.objects(config, "train"),
            "grasps": self.grasps(config, "train"),
            "scenes": self.scenes(config, "train"),
        }
        if config.validation.objects:
            held_out = {ref.id for ref in self._split(config, "validation")}
            shared = held_out & (tested | {ref.id for ref in self._split(config, "train")})
            if shared:
                raise DmfcError(
                    f"'{min(shared)}' is in validation.objects and in objects.train or "
                    "objects.test: validation needs objects of its own"
                )
            for part in ("objects", "grasps", "scenes"):
                inputs[f"validation_{part}"] = getattr(self, part)(config, "validation")
        return inputs

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
