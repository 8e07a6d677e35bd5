"""How many of the exactly hardest predictions the cheap ranking picks, on the scenes of `study`.

python -m analysis.rank_overlap STORE [PRESET]      (after `dmfc sweep study`)

With the weights of each fine-tuned cell and the pre-trained network, as at the first step of
fine-tuning. A column per number of collision points: mean (least) share over the batches, and the
sum of the exact errors of the picked over that of the hardest.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import torch

from dmfc.config.schema import Config
from dmfc.errors import DmfcError
from dmfc.sweep.sweep_file import cell_config, load_sweep, seeds_of
from dmfc.training.batch import Batch
from dmfc.training.selection import hardest
from dmfc.training.task import Task
from tests.benchmarks.trained import Trained, trained

POINTS = (100, 250, 500)
BATCHES = 4


@torch.no_grad()
def overlaps(found: Trained, config: Config, batch: Batch) -> list[tuple[float, float]]:
    """For each of POINTS: share of the hardest that the cheap ranking picked, and of their error.

    Both are 1 where it picked the same.
    """
    prediction = found.net(batch.points, batch.seed_index)
    seeds = config.training.finetune_seeds
    tasks = [Task("finetune", config.losses, found.hand, found.atlas, n, seeds) for n in POINTS]
    rows = tasks[0].candidates(prediction, batch)
    sure = rows.logit.sigmoid() if config.training.hard_error == "weighted" else 1.0
    count, scope = config.training.hard_samples, config.training.hard_scope
    exact = sure * tasks[0].exact_errors(rows, batch)
    wanted = hardest(exact, rows.scene, count, scope)
    result = []
    for task in tasks:
        picked = hardest(sure * task.errors(rows, batch), rows.scene, count, scope)
        shared = torch.isin(wanted, picked).float().mean()
        result.append((shared.item(), (exact[picked].sum() / exact[wanted].sum()).item()))
    return result


def table_rows(store: Path, preset: str) -> Iterator[list[str]]:
    """A row per fine-tuned cell of the sweep."""
    sweep = load_sweep("study")
    for cell in sweep.cells:
        if cell.model != "finetuned":
            continue
        config = cell_config(sweep, cell, seeds_of(sweep, preset)[0], preset, [])
        found = trained(config, "pretrained", cell.name, store)
        values = torch.tensor(
            [
                overlaps(found, config, batch)
                for batch, _ in zip(
                    found.batches(config.training.batch_size), range(BATCHES), strict=False
                )
            ]
        )
        mean, least = values.mean(0), values[..., 0].min(0).values
        yield [cell.name] + [
            f"{share:.2f} ({low:.2f}), {error:.3f}"
            for (share, error), low in zip(mean.tolist(), least.tolist(), strict=True)
        ]


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    print(f"| weights of | {' | '.join(f'{n} points' for n in POINTS)} |")
    print("|---|" + "---|" * len(POINTS))
    try:
        for row in table_rows(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "quick"):
            print(f"| {' | '.join(row)} |", flush=True)
    except DmfcError as error:
        raise SystemExit(str(error)) from error
