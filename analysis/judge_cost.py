"""CPU time of judging 512 grasps of a cloud on one core: python -m analysis.judge_cost SCENES...

SCENES are `scenes.parquet` files of a store. Prints the least of several runs over all their
scenes: the network, the features of its grasps, the predictor, and the cloud check of the best 32.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import torch

from dmfc.config.execution import ExecutionConfig
from dmfc.config.hand import HandConfig
from dmfc.geometry.transforms import transform
from dmfc.hand.build import build_hand
from dmfc.network.checkpoint import load_alone
from dmfc.network.inference import predict
from dmfc.outcome.features import SeededGrasps
from dmfc.outcome.judge import Judge
from dmfc.prediction.cloud_check import CloudCheck
from dmfc.prediction.models import model_folder
from dmfc.scenes.scene_set import SceneSet

RUNS = 6


def main(paths: list[str]) -> None:
    """Prints milliseconds."""
    torch.set_num_threads(1)
    folder = model_folder("table1-pretrained")
    net, _ = load_alone(folder)
    judge = Judge.load(folder)
    check = CloudCheck(build_hand(HandConfig()), ExecutionConfig())
    spent = []
    for scene in SceneSet.open([Path(path) for path in paths]):
        for _ in range(RUNS):
            times = [time.process_time()]
            found = predict(net, scene.points)
            times.append(time.process_time())
            grasps = SeededGrasps(
                found.position, found.rotation, found.joints, found.seed_index, found.confidence
            )
            features = judge.features(grasps, scene.points)
            times.append(time.process_time())
            best = np.argsort(-judge.of_features(features).held)[:32]
            times.append(time.process_time())
            T_world_palm = transform(grasps.rotation[best], grasps.position[best])
            check.clear(T_world_palm, grasps.joints[best], scene.points)
            times.append(time.process_time())
            spent.append(np.diff(times))
    least = 1000 * np.min(spent, axis=0)
    for name, value in zip(("network", "features", "predictor", "check of 32"), least, strict=True):
        print(f"{name}: {value:.0f} ms")
    print(f"in all: {least.sum():.0f} ms")


if __name__ == "__main__":
    main(sys.argv[1:])
