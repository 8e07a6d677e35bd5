"""Projected targets: each prediction is moved down its own terms, and the network regresses to it.

The terms are summed over predictions that share their weights, so a few of them that penetrate
deeply steer all others. Here each prediction takes its own bounded steps, with the network left
out of it; what the network learns from one is never larger than the bounds, and nothing where no
step helped.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from dmfc.config.losses import GraspSpace
from dmfc.config.training import ProjectionConfig
from dmfc.geometry.rotations import axis_angle_matrix, sixd_from_matrix
from dmfc.losses.chamfer import grasp_distance, grasp_vector
from dmfc.training.batch import Batch
from dmfc.training.candidates import Candidates
from dmfc.training.task import Task

SMALLEST = 1e-3
"""A sum of terms below this is not worth a step; a term may always grow by it."""
SHORTER, LONGER = 0.5, 1.2
"""Factors of a prediction's step after one that was refused, and after one that was taken."""


@dataclass(frozen=True)
class Projected:
    """Where n predictions went, and what their terms were; without gradients."""

    shift: Tensor
    """[n, 9 + J] from the prediction to its target, in grasp space."""
    before: dict[str, Tensor]
    """[n] each term at the prediction."""
    after: dict[str, Tensor]
    """[n] each term at the target."""
    moved: Tensor
    """[n] bool: a step was taken."""

    def distance(self, rows: Candidates, space: GraspSpace) -> Tensor:
        """Squared distance of the predictions to their targets in grasp space, [n]."""
        vector = grasp_vector(rows.aim, rows.rotation6d, rows.joints, space)
        return grasp_distance(vector, vector.detach() + self.shift)


class Moves:
    """Motions of predictions: [n, 6 + J] numbers, 1 the bound of each: palm, turn, joints."""

    def __init__(self, rows: Candidates, task: Task, config: ProjectionConfig) -> None:
        self.rows, self.config = rows, config
        self.aim, self.rotation = rows.aim.detach(), rows.rotation.detach()
        self.joints = task.kinematics.clamp(rows.joints.detach())
        lever = self.aim - rows.position.detach()
        self.lever = (self.rotation.mT @ lever[..., None])[..., 0]

    def parts(self, move: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Aim [n, 3], rotation [n, 3, 3] about it, and joints [n, J] after a motion."""
        config = self.config
        turn = axis_angle_matrix(config.angle * move[:, 3:6])
        aim = self.aim + config.position * move[:, :3]
        return aim, turn @ self.rotation, self.joints + config.joints * move[:, 6:]

    def rows_at(self, move: Tensor) -> Candidates:
        """The predictions after a motion, differentiable in it."""
        aim, rotation, joints = self.parts(move)
        position = aim - (rotation @ self.lever[..., None])[..., 0]
        sixd = sixd_from_matrix(rotation)
        moved = {"aim": aim, "position": position, "rotation6d": sixd, "joints": joints}
        return dataclasses.replace(self.rows, **moved)

    def shift(self, move: Tensor, space: GraspSpace) -> Tensor:
        """[n, 9 + J]: the motion in grasp space."""
        aim, rotation, joints = self.parts(move)
        end = grasp_vector(aim, sixd_from_matrix(rotation), joints, space)
        start = grasp_vector(self.aim, sixd_from_matrix(self.rotation), self.joints, space)
        return end - start

    @property
    def still(self) -> Tensor:
        """No motion, [n, 6 + J]."""
        return self.aim.new_zeros(len(self.aim), 6 + self.joints.shape[1])


def bounded(move: Tensor) -> Tensor:
    """The motion [n, 6 + J] within its bounds: lengths of palm and turn, and each joint."""
    palm, turn, joints = move[:, :3], move[:, 3:6], move[:, 6:]
    shortened = [part / part.norm(dim=1, keepdim=True).clamp(min=1) for part in (palm, turn)]
    return torch.cat([*shortened, joints.clamp(-1, 1)], dim=1)


def descent(moves: Moves, move: Tensor, task: Task, batch: Batch) -> tuple[dict, Tensor, Tensor]:
    """Terms [n] at a motion, their weighted sum [n], and its gradient [n, 6 + J] of each alone."""
    with torch.enable_grad():
        move = move.detach().requires_grad_()
        terms = task.cheap_terms(moves.rows_at(move), batch)
        total = task.total(terms)
        (slope,) = torch.autograd.grad(total.sum(), move)
    return {n: v.detach() for n, v in terms.items()}, total.detach(), slope.nan_to_num()


def project(rows: Candidates, batch: Batch, task: Task, config: ProjectionConfig) -> Projected:
    """Move each of the predictions down the weighted sum of its own terms (chamfer left out).

    Each step goes along the normalised gradient in units of the bounds. It is taken where the sum
    falls and no term is above its first value by more than the share `worse`; else the prediction
    stays and its next step is half as long.
    """
    moves = Moves(rows, task, config)
    with torch.no_grad():
        before = task.cheap_terms(moves.rows_at(moves.still), batch)
        total = task.total(before)
    moving = (total > SMALLEST).nonzero()[:, 0]
    move, after = moves.still, before
    if len(moving):
        move[moving], ended = _steps(rows.take(moving), batch, task, config)
        after = {name: value.index_copy(0, moving, ended[name]) for name, value in before.items()}
    return Projected(moves.shift(move, task.space), before, after, move.abs().amax(1) > 0)


def _steps(
    rows: Candidates, batch: Batch, task: Task, config: ProjectionConfig
) -> tuple[Tensor, dict[str, Tensor]]:
    """The motions [n, 6 + J] of predictions, and their terms [n] after them."""
    moves = Moves(rows, task, config)
    move = moves.still
    before, total, slope = descent(moves, move, task, batch)
    limit = {name: value * (1 + config.worse) + SMALLEST for name, value in before.items()}
    after, length = before, torch.full_like(total, 2.0 / config.steps)
    for _ in range(config.steps):
        direction = slope / slope.norm(dim=1, keepdim=True).clamp(min=SMALLEST**2)
        trial = bounded(move - length[:, None] * direction)
        terms, new, new_slope = descent(moves, trial, task, batch)
        taken = new < total
        for name, value in terms.items():
            taken &= value <= limit[name]
        move, slope = (
            torch.where(taken[:, None], a, b) for a, b in ((trial, move), (new_slope, slope))
        )
        total = torch.where(taken, new, total)
        after = {name: torch.where(taken, terms[name], value) for name, value in after.items()}
        length = length * torch.where(taken, LONGER, SHORTER)
    return move, after
