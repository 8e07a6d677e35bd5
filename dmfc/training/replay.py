"""Computes the terms of a saved batch again, to find which one was not finite, and where."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import torch
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dmfc.config.interpolation import refuse_interpolation
from dmfc.errors import DmfcError, first_line
from dmfc.hand.model import HandModel
from dmfc.network.checkpoint import new_network
from dmfc.objects.atlas import ObjectAtlas
from dmfc.training.batch import Batch
from dmfc.training.failure import Failure
from dmfc.training.module import GraspTraining
from dmfc.training.settings import FitConfig
from dmfc.training.task import Stage, Task


def replay(
    saved: Mapping[str, Any], hand: HandModel, atlas: ObjectAtlas
) -> list[dict[str, float | str]]:
    """The terms of a saved batch, computed again: a row per term.

    Each with the mean and the largest of its finite values over the predictions that were
    back-propagated, how many were not finite, the scenes of those, and the norm of the gradient of
    its mean in the weights. Raises DmfcError where hand or objects are not those of the run.
    """
    if saved["hand"] != hand.name or saved["objects"] != atlas.ids:
        raise DmfcError(
            f"the batch is of the hand '{saved['hand']}' and {len(saved['objects'])} objects, not "
            f"of '{hand.name}' and {len(atlas)}: give the run's --preset and --set"
        )
    config = _config(saved["config"])
    stage: Stage = saved["stage"]
    net = new_network(config.network, hand)
    net.load_state_dict(saved["weights"])
    training = config.training
    points, seeds = training.rank_points, training.finetune_seeds
    task = Task(stage, config.losses, hand, atlas, points, seeds, config.approach)
    module = GraspTraining(net, task, training, Failure(Path(), config, hand.name))
    batch = Batch(**saved["batch"])
    prediction = net.train()(batch.points, batch.seed_index)
    chosen = module.hardest(task.candidates(prediction, batch), batch)
    rows: list[dict[str, float | str]] = []
    for name, values in {**task.terms(chosen, batch), "confidence": chosen.logit}.items():
        finite = values.detach().isfinite()
        scenes = batch.scene_number[chosen.scene[~finite].unique()].tolist()
        fine = values.detach()[finite]
        gradients = torch.autograd.grad(
            values.mean(), list(net.parameters()), retain_graph=True, allow_unused=True
        )
        norm = torch.nn.utils.get_total_norm([g for g in gradients if g is not None])
        rows.append(
            {
                "term": name,
                "mean": fine.mean().item() if len(fine) else float("nan"),
                "largest": fine.max().item() if len(fine) else float("nan"),
                "not_finite": int((~finite).sum()),
                "in_scenes": ", ".join(str(scene) for scene in scenes),
                "gradient_norm": norm.item(),
            }
        )
    return rows


def _config(text: str) -> FitConfig:
    try:
        given = json.loads(text)
        refuse_interpolation(given, "the settings of the batch")
        merged = OmegaConf.merge(OmegaConf.structured(FitConfig), given)
        return cast(FitConfig, OmegaConf.to_object(merged))
    except (OmegaConfBaseException, ValueError) as error:
        message = first_line(error)
        raise DmfcError(f"the batch was saved with settings of another dmfc: {message}") from error
