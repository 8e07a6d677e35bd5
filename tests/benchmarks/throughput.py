"""Training throughput on the accelerator there is, and how long Table II's recipe takes on it.

    python -m tests.benchmarks.throughput        # in the root of the checkout; both precisions
    python -m tests.benchmarks.throughput --precision bf16-mixed --batch 4 --hand hand.npz

Needs torch, numpy and Lightning; the Shadow Hand is built with MuJoCo unless `--hand` is a hand
that was built elsewhere. Scenes are synthetic and in memory: the loader is not in the times.
"""

from __future__ import annotations

import argparse
import contextlib
import statistics
import time
from dataclasses import dataclass
from pathlib import Path

import torch

from dmfc.config.network import NetworkConfig
from dmfc.config.training import TrainingConfig
from dmfc.hand.model import HandModel
from dmfc.training.task import Stage
from tests.benchmarks.workload import batch_of, module_of

TABLE2_SCENES = 10_000


@dataclass(frozen=True)
class Throughput:
    """Median seconds of a step of `batch` scenes, optimiser included; peak memory in MiB."""

    stage: Stage
    batch: int
    seconds: float
    memory: float

    @property
    def scenes_per_second(self) -> float:
        return self.batch / self.seconds


def measure(
    stage: Stage,
    hand: HandModel,
    device: torch.device,
    precision: str = "32-true",
    batch: int = 4,
    steps: int = 20,
    network: NetworkConfig | None = None,
    points: int = 2048,
    labels: int = 256,
) -> Throughput:
    """Times `steps` training steps after three that warm up."""
    module = module_of(stage, hand, network).to(device)
    seeds = module.net.config.levels[0]
    scenes = batch_of(batch, hand.dofs, points, seeds, labels)
    scenes = scenes.to(device)
    optimizer = module.configure_optimizers()
    mixed = (
        torch.autocast(device.type, torch.bfloat16)
        if precision == "bf16-mixed"
        else contextlib.nullcontext()
    )
    accelerator = device.type if device.type != "cpu" else None
    times = []
    for _ in range(3 + steps):
        started = time.perf_counter()
        optimizer.zero_grad()
        with mixed:
            loss = module.training_step(scenes, 0)
        assert loss is not None
        loss.backward()
        optimizer.step()
        if accelerator:
            torch.accelerator.synchronize()
        times.append(time.perf_counter() - started)
    memory = torch.cuda.max_memory_allocated() / 2**20 if device.type == "cuda" else 0.0
    return Throughput(stage, batch, statistics.median(times[3:]), memory)


def table2_minutes(pretrain: Throughput, finetune: Throughput) -> float:
    """Minutes for 10,000 scenes in the default schedule: 50 epochs of the one, 20 of the other."""
    schedule = TrainingConfig()
    epochs = ((pretrain, schedule.pretrain.epochs), (finetune, schedule.finetune.epochs))
    return sum(TABLE2_SCENES * count / part.scenes_per_second for part, count in epochs) / 60


def report(pretrain: Throughput, finetune: Throughput, precision: str, device: str) -> str:
    lines = [f"{device}, {precision}, {torch.__version__}"]
    lines += [
        f"{part.stage:9} {1000 * part.seconds:8.1f} ms per step of {part.batch} scenes, "
        f"{part.scenes_per_second:7.1f} scenes/s, peak {part.memory:.0f} MiB"
        for part in (pretrain, finetune)
    ]
    minutes = table2_minutes(pretrain, finetune)
    return "\n".join([*lines, f"Table II ({TABLE2_SCENES} scenes, 70 epochs): {minutes:.0f} min"])


def main() -> None:
    parser = argparse.ArgumentParser(description="Training throughput and Table II's time.")
    parser.add_argument("--device", help="cuda, cpu, ...; default: the accelerator there is")
    parser.add_argument("--precision", nargs="+", default=["32-true", "bf16-mixed"])
    parser.add_argument("--batch", type=int, default=TrainingConfig().batch_size)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--hand", type=Path, help="file of a hand's stage; default: built here")
    given = parser.parse_args()
    found = torch.accelerator.current_accelerator() if torch.accelerator.is_available() else None
    device = torch.device(given.device or found or "cpu")
    if given.hand:
        hand = HandModel.load(given.hand)
    else:
        from dmfc.config.hand import HandConfig
        from dmfc.hand.build import build_hand

        hand = build_hand(HandConfig())
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else str(device)
    for precision in given.precision:
        pretrain, finetune = (
            measure(stage, hand, device, precision, given.batch, given.steps)
            for stage in ("pretrain", "finetune")
        )
        print(report(pretrain, finetune, precision, name), flush=True)


if __name__ == "__main__":
    main()
