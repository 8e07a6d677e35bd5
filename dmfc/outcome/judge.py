"""`Judge`: a trained outcome predictor, read from its files and asked about grasps."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from dmfc.config.closing import ClosingConfig
from dmfc.config.outcome import OutcomeConfig
from dmfc.errors import DmfcError
from dmfc.files.atomic import write_json
from dmfc.hand.model import HandModel
from dmfc.outcome.features import FeatureMaker, SeededGrasps
from dmfc.outcome.files import ABOUT, FEATURES_VERSION, WEIGHTS
from dmfc.outcome.network import OutcomeNet
from dmfc.outcome.verdict import Verdict

if TYPE_CHECKING:
    from dmfc.outcome.report import Report

HAND = "hand."
"""Begins the names of the arrays of the hand, so that a judge needs no hand to be built."""
_PLAIN = "name", "dof_names", "link_names"
_ARRAYS = (
    "lower",
    "upper",
    "open_joints",
    "flexion",
    "parents",
    "T_parent_link",
    "joint_axis",
    "joint_dof",
    "joint_scale",
    "palm_reference",
    "palm_normal",
    "inner_link",
    "inner_points",
    "inner_normals",
)


class Judge:
    """Tells of grasps in a cloud what will become of them when they are executed."""

    def __init__(self, net: OutcomeNet, hand: HandModel) -> None:
        self.net = net.eval()
        self.features = FeatureMaker(hand)

    @classmethod
    def load(cls, folder: Path) -> Judge:
        """The judge in a folder. Raises DmfcError where there is none that is still understood."""
        try:
            about = json.loads((folder / ABOUT).read_text())
            tensors = load_file(folder / WEIGHTS)
            closing = ClosingConfig(**about["closing"])
            hand = _read_hand(about["hand"], closing, tensors)
            net = OutcomeNet(about["features"], about["widths"], about["members"])
            net.load_state_dict({k: v for k, v in tensors.items() if not k.startswith(HAND)})
            version = int(about["version"])
        except (OSError, ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as error:
            text = " ".join(str(error).split())[:200]
            raise DmfcError(f"{folder} holds no outcome predictor: {text}") from error
        if version != FEATURES_VERSION:
            raise DmfcError(
                f"{folder} judges by features of version {version}, not {FEATURES_VERSION}: "
                "train it again (dmfc outcome train)"
            )
        return cls(net, hand)

    @property
    def hand(self) -> str:
        """Name of the hand whose grasps it knows."""
        return self.features.hand.name

    def __call__(self, grasps: SeededGrasps, points: np.ndarray) -> Verdict:
        """Of grasps among points [N, 3] seen on objects on the table z = 0."""
        return self.of_features(self.features(grasps, points))

    @torch.inference_mode()
    def of_features(self, features: np.ndarray) -> Verdict:
        """Of grasps of which these features [n, F] were measured."""
        said = self.net(torch.from_numpy(features)).double().numpy()
        return Verdict(said[:, 0], said[:, 1])


def save_judge(
    net: OutcomeNet,
    config: OutcomeConfig,
    hand: HandModel,
    report: Report,
    out: Path,
    objects: Iterable[str] = (),
) -> None:
    """Write a judge's files, weights and what they are, into the folder `out`.

    `objects`: what it learned from, which it is not to be tested on.
    """
    out.mkdir(parents=True, exist_ok=True)
    state = {k: v.detach().cpu().contiguous() for k, v in net.state_dict().items()}
    shape = {HAND + k: torch.from_numpy(np.ascontiguousarray(getattr(hand, k))) for k in _ARRAYS}
    save_file(state | shape, out / WEIGHTS)
    about: dict[str, Any] = {
        "version": FEATURES_VERSION,
        "hand": {name: getattr(hand, name) for name in _PLAIN},
        "closing": dataclasses.asdict(hand.closing),
        "features": len(net.mean),
        "widths": list(config.widths),
        "members": net.members,
        "unseen_objects": report.to_dict(),
        "objects": sorted(objects),
    }
    write_json(out / ABOUT, about)


def _read_hand(
    about: Mapping[str, Any], closing: ClosingConfig, tensors: Mapping[str, torch.Tensor]
) -> HandModel:
    """What features need of the hand, without its surface and its collision geometry."""
    none = np.zeros((0, 3))
    values: dict[str, Any] = {name: about[name] for name in _PLAIN}
    values |= {name: tensors[HAND + name].numpy() for name in _ARRAYS}
    return HandModel(
        **values,
        closing=closing,
        collision_link=none[:, 0].astype(np.int64),
        collision_points=none,
        adjacency=np.eye(len(about["link_names"]), dtype=bool),
        link_grids=[],
        link_vertices=[],
        link_faces=[],
    )


def has_judge(folder: Path) -> bool:
    """Whether there is a judge in a folder."""
    return (folder / WEIGHTS).is_file()
