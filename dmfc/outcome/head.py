"""The network's confidence head, trained on the outcomes of executed predictions.

The paper's form of a judge: nothing but the last layers of the network, all else frozen. It is the
row that an outcome predictor with features of its own is compared with.
"""

from __future__ import annotations

import copy
import dataclasses
import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from dmfc.config.network import NetworkConfig
from dmfc.config.outcome import OutcomeConfig
from dmfc.errors import DmfcError, one_line
from dmfc.files.atomic import write_json
from dmfc.network.model import DmfcGraspNet
from dmfc.outcome.calibration import platt
from dmfc.outcome.features import SeededGrasps
from dmfc.outcome.files import ABOUT, WEIGHTS
from dmfc.outcome.fit import folds, object_weights
from dmfc.outcome.judge import Judge
from dmfc.outcome.report import Report, report
from dmfc.outcome.trials import Trials, trials_of
from dmfc.outcome.verdict import Verdict
from dmfc.scenes.scene_set import SceneSet


class HeadJudge:
    """A network whose confidence is the probability of being held."""

    def __init__(self, net: DmfcGraspNet, hand: str, slope: float, shift: float) -> None:
        """`slope`, `shift`: the calibration of the head's logit."""
        self.net, self.hand, self.slope, self.shift = net.eval(), hand, slope, shift

    @classmethod
    def load(cls, folder: Path) -> HeadJudge:
        """The judge in a folder. Raises DmfcError where there is none."""
        try:
            about = json.loads((folder / ABOUT).read_text())
            tensors = load_file(folder / WEIGHTS)
            buffers = [tensors[name] for name in ("lower", "upper", "centre")]
            net = DmfcGraspNet(NetworkConfig(**about["network"]), *buffers)
            net.load_state_dict(tensors)
            return cls(net, about["hand"]["name"], *about["calibration"])
        except (OSError, ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as error:
            text = one_line(error)
            raise DmfcError(f"{folder} holds no retrained confidence head: {text}") from error

    def save(self, found: Report, out: Path, objects: Iterable[str] = ()) -> None:
        """Write its files into the folder `out`; `objects`: what it learned from."""
        out.mkdir(parents=True, exist_ok=True)
        state = {k: v.detach().cpu().contiguous() for k, v in self.net.state_dict().items()}
        save_file(state, out / WEIGHTS)
        about = {
            "form": "head",
            "hand": {"name": self.hand},
            "network": dataclasses.asdict(self.net.config),
            "calibration": [self.slope, self.shift],
            "unseen_objects": found.to_dict(),
            "objects": sorted(objects),
        }
        write_json(out / ABOUT, about)

    @torch.inference_mode()
    def __call__(self, grasps: SeededGrasps, points: np.ndarray) -> Verdict:
        """Of grasps that this network predicted at seeds of the cloud [N, 3].

        Raises DmfcError where one was not predicted at a seed.
        """
        said = self.net(torch.as_tensor(points, dtype=torch.float32)[None])
        logit = np.full(len(points), np.nan)
        logit[said.seed_index[0].numpy()] = said.logit[0].double().numpy()
        chosen = logit[grasps.seed_point]
        if np.isnan(chosen).any():
            raise DmfcError("a retrained confidence head knows the network's own seeds alone")
        held = 1 / (1 + np.exp(-(self.slope * chosen + self.shift)))
        return Verdict(np.ones(len(chosen)), held)


def load_judge(folder: Path) -> Judge | HeadJudge:
    """The judge in a folder, of whatever form. Raises DmfcError where there is none."""
    path = folder / ABOUT
    form = json.loads(path.read_text()).get("form") if path.is_file() else None
    return HeadJudge.load(folder) if form == "head" else Judge.load(folder)


def read_rows(net: DmfcGraspNet, files: Sequence[tuple[Path, Path]]) -> tuple[Tensor, Trials]:
    """What the confidence head saw of each executed grasp, [n, F], and what became of them."""
    rows: list[Tensor] = []
    trials: list[Trials] = []
    seen: list[Tensor] = []
    hook = net.confidence_head.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    with hook, torch.no_grad():
        for rows_file, scenes_file in files:
            table = pd.read_parquet(rows_file)
            for scene in SceneSet.open([scenes_file]) if len(table) else ():
                of_scene = table[table["scene"] == scene.scene]
                if not len(of_scene):
                    continue
                seen.clear()
                said = net.eval()(torch.as_tensor(scene.points)[None])
                place = np.full(len(scene.points), -1)
                place[said.seed_index[0].numpy()] = np.arange(said.seed_index.shape[1])
                chosen = seen[0][place[of_scene["seed_point"].to_numpy()]]
                rows.append(chosen)
                trials.append(trials_of(chosen.numpy(), of_scene, len(trials)))
    return torch.cat(rows), Trials.of(trials)


def fit_head(
    net: DmfcGraspNet, files: Sequence[tuple[Path, Path]], config: OutcomeConfig, seed: int
) -> tuple[DmfcGraspNet, tuple[float, float], Report]:
    """The network with its retrained head, the calibration (slope, shift), and how well it does.

    Measured and calibrated on objects that a head of the same kind had not seen.
    """
    rows, trials = read_rows(net, files)
    fold = folds(trials.object, config.members, seed)
    unseen = np.empty(len(trials))
    for number in range(config.members):
        left = fold == number
        head = _fitted(net, rows, trials, ~left, config, seed)
        with torch.no_grad():
            unseen[left] = head(rows[torch.from_numpy(left)])[:, 0].double().numpy()
    weight, clear = object_weights(trials.object), trials.clear
    slope, shift = platt(unseen[clear], trials.held[clear], weight[clear])
    held = 1 / (1 + np.exp(-(slope * unseen + shift)))
    done = copy.deepcopy(net)
    done.confidence_head = _fitted(net, rows, trials, np.ones(len(trials), bool), config, seed)
    return done, (slope, shift), report(np.ones(len(trials)), held, trials)


def _fitted(
    net: DmfcGraspNet,
    rows: Tensor,
    trials: Trials,
    used: np.ndarray,
    config: OutcomeConfig,
    seed: int,
) -> torch.nn.Sequential:
    """A copy of the head, trained on the rows [n] that are `used`; its norms keep their counts."""
    torch.manual_seed(seed)
    head = copy.deepcopy(net.confidence_head).eval()
    optimizer = torch.optim.AdamW(
        head.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
    )
    held = torch.from_numpy(trials.held.astype(np.float32))
    weight = torch.from_numpy(object_weights(trials.object).astype(np.float32))
    chosen = torch.from_numpy(np.flatnonzero(used))
    for _ in range(config.epochs):
        for batch in chosen[torch.randperm(len(chosen))].split(config.batch_size):
            logit = head(rows[batch])[:, 0]
            loss = binary_cross_entropy_with_logits(logit, held[batch], weight[batch])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    return head
