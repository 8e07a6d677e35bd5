"""What fine-tuning does to predictions and labels, measured after each epoch on a few scenes.

A term that is minimised over all predictions may still make most of them worse: few that penetrate
deeply steer the shared weights. So each prediction is compared with itself at the start of the
stage: whether its own terms fell, and whether it went where they pointed.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator

import torch
from torch import Tensor
from torch.nn.functional import cosine_similarity

from dmfc.config.training import ProjectionConfig
from dmfc.geometry.rotations import rotation_vector
from dmfc.network.model import DmfcGraspNet
from dmfc.training.batch import Batch
from dmfc.training.candidates import Candidates
from dmfc.training.projection import SMALLEST, Moves, descent
from dmfc.training.task import Task

EASY = 0.8
"""Share of the predictions, those of the least terms at the start, that count as easy."""
GRADIENT_ROWS = 64
"""Predictions whose terms' gradients in the weights are compared."""


class Diagnostics:
    """The predictions of the labelled seeds of `batch` at the start of fine-tuning, to compare."""

    def __init__(
        self, net: DmfcGraspNet, task: Task, batch: Batch, config: ProjectionConfig
    ) -> None:
        """`config`: its bounds are the units in which motions of palm and joints are compared."""
        self.task, self.batch, self.config = task, batch, config
        with _evaluating(net), torch.no_grad():
            self.start = self._rows(net)
        moves = Moves(self.start, task, config)
        _, self.total, self.slope = descent(moves, moves.still, task, batch)
        with torch.no_grad():
            self.at_labels = task.cheap_terms(self.start.at_labels(batch), batch)

    def measure(self, net: DmfcGraspNet) -> dict[str, Tensor]:
        """Values by name, each of any number, of the network as it is now.

        own_terms_fell: of each prediction that had any at the start, whether the weighted sum of
        its terms has fallen; own_cosine_easy, own_cosine_hard: of the easiest 80 % and of the
        others, those that moved and had a slope, the cosine of the descent direction at the start
        and the motion since; TERM_at_labels: each term at the label that was nearest at the start;
        gradient_norm_TERM and gradient_cosine_TERM_TERM: of the gradients in the weights of each
        term's mean.
        """
        with _evaluating(net):
            rows = self._rows(net)
            found = self._gradients(net, rows)
        with torch.no_grad():
            total = self.task.total(self.task.cheap_terms(rows, self.batch))
            motion = self._motion(rows)
        found["own_terms_fell"] = (total < self.total)[self.total > SMALLEST].float()
        went = (motion.norm(dim=1) > SMALLEST) & (self.slope.norm(dim=1) > 0)
        easy = self.total <= self.total.quantile(EASY)
        cosine = cosine_similarity(-self.slope, motion, dim=1)
        found["own_cosine_easy"] = cosine[easy & went]
        found["own_cosine_hard"] = cosine[~easy & went]
        return found | {f"{name}_at_labels": value for name, value in self.at_labels.items()}

    def _rows(self, net: DmfcGraspNet) -> Candidates:
        prediction = net(self.batch.points, self.batch.seed_index)
        rows = Candidates.of(prediction, self.batch, self.task.space)
        return rows.take(rows.positive)

    def _motion(self, rows: Candidates) -> Tensor:
        """From the start to now, [n, 6 + J], in units of the bounds."""
        config, start = self.config, self.start
        turn = rotation_vector(rows.rotation @ start.rotation.mT)
        clamp = self.task.kinematics.clamp
        parts = [
            (rows.aim - start.aim) / config.position,
            turn / config.angle,
            (clamp(rows.joints) - clamp(start.joints)) / config.joints,
        ]
        return torch.cat(parts, dim=1)

    def _gradients(self, net: DmfcGraspNet, rows: Candidates) -> dict[str, Tensor]:
        step = max(1, len(rows) // GRADIENT_ROWS)
        few = rows.take(torch.arange(0, len(rows), step, device=rows.scene.device))
        terms = {"chamfer": few.chamfer, **self.task.cheap_terms(few, self.batch)}
        weights = list(net.parameters())
        gradients: dict[str, Tensor] = {}
        for name, value in terms.items():
            parts = torch.autograd.grad(
                value.mean(), weights, retain_graph=True, materialize_grads=True
            )
            gradients[name] = torch.cat([part.flatten() for part in parts])
        found = {f"gradient_norm_{name}": value.norm() for name, value in gradients.items()}
        for first, second in itertools.combinations(gradients, 2):
            cosine = cosine_similarity(gradients[first], gradients[second], dim=0)
            found[f"gradient_cosine_{first}_{second}"] = cosine
        return found


@contextlib.contextmanager
def _evaluating(net: DmfcGraspNet) -> Iterator[None]:
    """The network with the running statistics of its norms, as it is executed."""
    training = net.training
    net.eval()
    try:
        yield
    finally:
        net.train(training)
