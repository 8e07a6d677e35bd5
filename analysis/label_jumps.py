"""Errors of a pre-trained model where the nearest label changes from seed to seed, and elsewhere.

python -m analysis.label_jumps STORE PRESET [key=value ...]      (after `dmfc train`)
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch
from torch import Tensor

from dmfc.config.load import load_config
from dmfc.config.losses import GraspSpace
from dmfc.network.model import Prediction
from dmfc.training.batch import Batch
from dmfc.training.candidates import label_vectors, prediction_vectors
from dmfc.training.measures import label_errors
from tests.benchmarks.trained import trained

NEIGHBOURS = 4


def jumps(prediction: Prediction, batch: Batch, space: GraspSpace) -> Tensor:
    """Farthest, in metres, that the nearest label of a seed's labelled neighbours is from its own.

    [p], the p seeds with a label in the order of `label_errors`; 0 where all have the same label.
    """
    ours = prediction_vectors(prediction, space)
    labelled = batch.match.any(-1)
    apart = torch.cdist(ours, label_vectors(batch, space, prediction.centre))
    nearest = apart.masked_fill(~batch.match, torch.inf).argmin(-1)
    found = []
    for row, there in enumerate(labelled):
        position = batch.grasp_position[row, nearest[row, there]]
        seeds = prediction.seeds[row, there]
        near = torch.cdist(seeds, seeds).topk(NEIGHBOURS + 1, largest=False).indices
        found.append((position[near] - position[:, None]).norm(dim=-1).amax(1))
    return torch.cat(found)


@torch.no_grad()
def main(store: Path, preset: str, overrides: list[str]) -> None:
    """Print the means over all training scenes."""
    config = load_config(preset, overrides)
    model, space = trained(config, "pretrained", "model", store), config.losses.grasp_space
    errors, apart = [], []
    for batch in model.batches(config.training.batch_size):
        prediction = model.net(batch.points, batch.seed_index)
        errors.append(label_errors(prediction, batch, space)["translation_mm"])
        apart.append(jumps(prediction, batch, space))
    error, jump = torch.cat(errors), torch.cat(apart)
    border = jump > 0
    print(f"{len(error)} labelled seeds: mean {error.mean():.1f} mm, median {error.median():.1f}")
    print(f"at a jump: {border.float().mean():.0%}, of {1000 * jump[border].mean():.0f} mm")
    print(f"error there {error[border].mean():.1f} mm, elsewhere {error[~border].mean():.1f} mm")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    main(Path(sys.argv[1]), sys.argv[2], sys.argv[3:])
