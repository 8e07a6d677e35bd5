"""By how much one training differs between processors: instruction sets restricted.

    python -m analysis.processors STORE [EPOCHS]

Pre-trains the smoke preset (4 steps an epoch) once per instruction set, each time in a new process
on the same data, and prints how far losses and weights are from those with all that the processor
has. An older processor would do so, as far as its instruction set goes.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from dmfc.engine.engine import run_stages
from dmfc.experiment.session import Session
from dmfc.network.model_files import WEIGHTS
from dmfc.pipeline.kinds import KINDS

DMFC = str(Path(sys.executable).with_name("dmfc"))
EVERY = "all that is here"
OLD = {
    "AVX2": {
        "ATEN_CPU_CAPABILITY": "avx2",
        "ONEDNN_MAX_CPU_ISA": "AVX2",
        "MKL_ENABLE_INSTRUCTIONS": "AVX2",
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "",
    },
    "SSE4": {
        "ATEN_CPU_CAPABILITY": "default",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
        "NUMBA_CPU_NAME": "nehalem",
        "NUMBA_CPU_FEATURES": "",
    },
}
"""Environment that restricts torch's own kernels, oneDNN, MKL and numba."""
KERNELS = {"AVX2, torch's kernels alone": {"ATEN_CPU_CAPABILITY": "avx2"}}
LIBRARIES = {"AVX2, MKL alone": {"MKL_ENABLE_INSTRUCTIONS": "AVX2"}}
RUNS: dict[str, dict[str, str]] = {EVERY: {}, "the same again": {}, **OLD, **KERNELS, **LIBRARIES}
TWO = "all that is here, two threads"
STEPS_PER_EPOCH = 4


def train(data: Path, name: str, epochs: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean loss of each epoch, and all weights at the end."""
    store = data.with_name("run")
    shutil.rmtree(store, ignore_errors=True)
    shutil.copytree(data, store)
    shutil.rmtree(store / "stages" / "pretrain", ignore_errors=True)
    line = [DMFC, "train", "--stage", "pretrain", "--json"]
    line += [*_settings(epochs), "--store", str(store)]
    line += ["--set", "training.threads=2"] if name == TWO else []
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(data.with_name("numba")),
        **RUNS.get(name, {}),
    }
    told = subprocess.run(line, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    answer = json.loads(told.stdout)
    weights = load_file(Path(answer["folder"]) / WEIGHTS)
    flat = np.concatenate([weights[key].ravel().astype(float) for key in sorted(weights)])
    return np.array([row["loss"] for row in answer["metrics"] if row["split"] == "train"]), flat


def main(store: Path, epochs: int) -> None:
    """A row per instruction set, after one epoch and after all."""
    data = store / "data"
    session = Session.open("smoke", [], data)
    given = session.builder.pretrain(session.config).parents
    run_stages(given, session.ledger, session.config, KINDS, local=True)
    ends = (1, epochs)
    heads = [f"loss, weights after {end * STEPS_PER_EPOCH} steps" for end in ends]
    print(f"| instruction set | {' | '.join(heads)} |\n|---|---|---|")
    reference = [train(data, EVERY, end) for end in ends]
    for name in [*list(RUNS)[1:], TWO]:
        cells = []
        for (loss, weights), end in zip(reference, ends, strict=True):
            found, others = train(data, name, end)
            apart = np.linalg.norm(others - weights) / np.linalg.norm(weights)
            cells.append(f"{abs(found[-1] / loss[-1] - 1):.1e}, {apart:.1e}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def _settings(epochs: int) -> list[str]:
    return ["--preset", "smoke", "--set", f"training.pretrain.epochs={epochs}"]


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 25)
