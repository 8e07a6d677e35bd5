"""Training steps with the Shadow Hand: 4 scenes, 4 objects each, all terms, 64 hard samples."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from dmfc.config.losses import LossWeights
from tests.benchmarks.compare import Compare
from tests.benchmarks.workload import LOSSES, batch_of, module_of


def step_of(batch, stage, hand, losses=LOSSES, **training):
    """One step of a stage, optimizer included."""
    module = module_of(stage, hand, losses=losses, **training)
    optimizer = module.configure_optimizers()

    def step():
        optimizer.zero_grad()
        module.training_step(batch, 0).backward()
        optimizer.step()

    return step


@pytest.mark.benchmark(group="fine-tuning step, 4 scenes")
def test_finetuning_step(compare: Compare, hand):
    batch = batch_of(4, hand.dofs)
    ours, other = (step_of(batch, stage, hand) for stage in ("finetune", "pretrain"))
    compare(ours, other, "the pre-training step", limit=2.5)


@pytest.mark.benchmark(group="fine-tuning step, 4 scenes")
@pytest.mark.parametrize(("form", "limit"), [("gradient", 2.5), ("projected", 4.5)])
def test_swept_step(compare: Compare, hand, form, limit):
    """Swept collision of 128 random predictions, by its gradient and by projected targets."""
    batch = batch_of(4, hand.dofs)
    weights = LossWeights(1.0, 0.0, 0.0, 0.0, swept=1.0)
    losses = dataclasses.replace(LOSSES, weights=weights, saturated=True)
    chosen = {"hard_error": "random", "hard_samples": 32}
    ours = step_of(batch, "finetune", hand, losses, finetune_form=form, **chosen)
    compare(ours, step_of(batch, "pretrain", hand), "the pre-training step", limit=limit)


@pytest.mark.benchmark(group="parts of the fine-tuning step")
@pytest.mark.parametrize("part", ["rank", "terms"])
def test_parts(benchmark, hand, part):
    module, batch = module_of("finetune", hand), batch_of(4, hand.dofs)
    rows = module.task.candidates(module.net(batch.points, batch.seed_index), batch)
    rows = dataclasses.replace(
        rows,
        **{name: getattr(rows, name).detach() for name in ("position", "rotation6d", "joints")},
    )
    few = rows.take(torch.arange(64))
    few.position.requires_grad_()
    few.joints.requires_grad_()

    def terms():
        sum(v.sum() for n, v in module.task.terms(few, batch).items() if n != "chamfer").backward()

    run = terms if part == "terms" else lambda: module.task.errors(rows, batch)
    benchmark.pedantic(run, rounds=7, warmup_rounds=1)
