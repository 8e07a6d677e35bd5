"""From settings to stages: what depends on which settings is decided here and nowhere else.

A stage is given a settings dataclass with every field that it must not depend on put back to its
default, so that stages of cells that differ elsewhere have one key.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dmfc.config.custom_function import custom_class, custom_function, is_custom
from dmfc.config.execution import ExecutionConfig
from dmfc.config.losses import LossWeights
from dmfc.config.protocol import executed
from dmfc.config.schema import Config
from dmfc.engine.stage import Stage, without
from dmfc.errors import DmfcError
from dmfc.files.digest import file_digest
from dmfc.hand.approach import Approach
from dmfc.network.model_files import BACKBONE, WEIGHTS
from dmfc.pipeline.graph_data import DataGraph, Inputs, of_every_scene
from dmfc.pipeline.graph_method import method_settings
from dmfc.pipeline.graph_outcome import judge
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


class GraphBuilder(DataGraph):
    """Builds all stages from settings; equal settings give stages with equal keys."""

    def pretrain(self, config: Config) -> Stage:
        """Stage 1: depends on chamfer and confidence, on no other term, and not on stage 2."""
        weights = LossWeights(
            chamfer=1.0,
            collision=0.0,
            guidance=0.0,
            q1_upper=0.0,
            confidence=config.losses.weights.confidence,
        )
        unused = ("q1", "q1_lower", "units", "self_collision", "custom", "swept", "saturated")
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
            settings["approach"] = Approach.of_execution(config.execution)
            settings["closing"] = without(config.closing, "squeeze")
        if config.losses.custom:
            settings["own_losses"] = {
                text: custom_function(text, "losses.custom").digest for text in config.losses.custom
            }
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
        if is_custom(under.execution.test):
            settings["custom_test"] = custom_class(under.execution.test, "execution.test").digest
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
            settings["labels"] = of_every_scene(config)
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
        if is_custom(config.network.backbone):
            backbone = custom_class(config.network.backbone, "network.backbone")
            more["custom_backbone"] = {config.network.backbone: backbone.digest}
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
