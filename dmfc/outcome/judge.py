"""`Judge`: a trained outcome predictor, read from its files and asked about grasps."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from dmfc.config.outcome import OutcomeConfig
from dmfc.errors import DmfcError
from dmfc.hand.model import HandModel
from dmfc.outcome import features
from dmfc.outcome.features import FeatureMaker, Grasps
from dmfc.outcome.network import OutcomeNet
from dmfc.outcome.report import Report

WEIGHTS, ABOUT = "outcome.safetensors", "outcome.json"


@dataclass(frozen=True)
class Verdict:
    """What is expected of n grasps, as probabilities."""

    planned: np.ndarray
    """[n] the hand gets to the grasp without running into anything."""
    held_if_planned: np.ndarray
    """[n]."""

    @property
    def held(self) -> np.ndarray:
        """[n] the object is in the hand at the end."""
        return self.planned * self.held_if_planned


class Judge:
    """Tells of grasps in a cloud what will become of them when they are executed."""

    def __init__(self, net: OutcomeNet, hand: HandModel) -> None:
        self.net = net.eval()
        self.features = FeatureMaker(hand)

    @classmethod
    def load(cls, folder: Path, hand: HandModel) -> Judge:
        """The judge in a folder, for a hand. Raises DmfcError where there is none for this hand."""
        try:
            about = json.loads((folder / ABOUT).read_text())
            tensors = load_file(folder / WEIGHTS)
            net = OutcomeNet(about["features"], about["widths"], about["members"])
            net.load_state_dict(tensors)
            hand = replace(hand, opening=about["opening"], squeeze=about["squeeze"])
        except (OSError, ValueError, KeyError, RuntimeError, SafetensorError) as error:
            text = " ".join(str(error).split())[:200]
            raise DmfcError(f"{folder} holds no outcome predictor: {text}") from error
        if about["hand"] != hand.name or about["version"] != features.VERSION:
            raise DmfcError(
                f"{folder} judges the hand '{about['hand']}' by features of version "
                f"{about['version']}, not '{hand.name}' and {features.VERSION}: train it anew"
            )
        return cls(net, hand)

    @torch.inference_mode()
    def __call__(self, grasps: Grasps, points: np.ndarray) -> Verdict:
        """Of grasps among points [N, 3] seen on objects on the table z = 0."""
        made = torch.from_numpy(self.features(grasps, points))
        said = self.net(made).double().numpy()
        return Verdict(said[:, 0], said[:, 1])


def save_judge(
    net: OutcomeNet, config: OutcomeConfig, hand: HandModel, report: Report, out: Path
) -> None:
    """Write a judge's files, weights and what they are, into the folder `out`."""
    out.mkdir(parents=True, exist_ok=True)
    state = {k: v.detach().cpu().contiguous() for k, v in net.state_dict().items()}
    save_file(state, out / WEIGHTS)
    about: dict[str, Any] = {
        "version": features.VERSION,
        "hand": hand.name,
        "opening": hand.opening,
        "squeeze": hand.squeeze,
        "features": len(net.mean),
        "widths": list(config.widths),
        "members": net.members,
        "unseen_objects": report.to_dict(),
    }
    (out / ABOUT).write_text(json.dumps(about, indent=1) + "\n")


def has_judge(folder: Path) -> bool:
    """Whether there is a judge in a folder."""
    return (folder / WEIGHTS).is_file()
