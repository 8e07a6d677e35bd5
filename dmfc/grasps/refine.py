"""Refine candidates by gradient descent on the differentiable terms of the task loss.

objective_i = w_c collision_i + w_g guidance_i + w_q exp(-Q1_i), in the units of the losses.
Collision counts the object, the table under it and the hand's own links. Joints are held within
their limits by projection: after every step they are clamped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from dmfc.config.grasps import GraspsConfig, RefineConfig
from dmfc.config.losses import LossConfig, LossWeights, Q1Config
from dmfc.geometry.rotations import matrix_from_6d, sixd_from_matrix
from dmfc.geometry.transforms import inverse, transform
from dmfc.grasps.propose import Candidates
from dmfc.hand.model import HandModel
from dmfc.losses.task import SceneTerms, active_terms, weighted_sum
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from dmfc.objects.model import ObjectModel

PALM_UNIT = 0.05
"""Metres that the palm moves where a joint turns by 1 rad, as in the planner's distances."""


@dataclass(frozen=True)
class Refined:
    """n hands after the descent, each at the lowest objective that it came by."""

    position: Tensor
    """[n, 3] palm origin in the world, metres."""
    rotation: Tensor
    """[n, 3, 3] R_world_palm."""
    joints: Tensor
    """[n, D] rad, within the limits."""
    before: Tensor
    """[n] objective at the start."""
    after: Tensor
    """[n] objective now, never above `before`."""


class Objective:
    """What is descended: a sum of terms for one hand, without a graph through the objects."""

    def __init__(self, hand: HandModel, config: RefineConfig, q1: Q1Config) -> None:
        self.weights = LossWeights(
            chamfer=0.0,
            collision=config.collision_weight,
            guidance=config.guidance_weight,
            q1_upper=config.q1_weight,
        )
        thinned = hand.thinned(config.points) if config.points else hand
        self.terms = SceneTerms(thinned, LossConfig(weights=self.weights, q1=q1))
        self.lower, self.upper = torch.as_tensor(hand.lower), torch.as_tensor(hand.upper)

    def __call__(
        self, position: Tensor, rotation: Tensor, joints: Tensor, objects: SceneObjects
    ) -> Tensor:
        """[n], of palms [n, 3], [n, 3, 3] in the world (table at z = 0) and joints [n, D] rad."""
        names = active_terms(self.weights)
        terms = self.terms(position, rotation, joints, objects, names)
        return weighted_sum(terms, self.weights)


def refine(
    objective: Objective,
    position: Tensor,
    rotation: Tensor,
    joints: Tensor,
    objects: SceneObjects,
    config: RefineConfig,
) -> Refined:
    """`config.steps` steps of Adam from palms [n, 3], [n, 3, 3] in the world and joints [n, D].

    The palm's rotation is descended in the 6-D form. Hands do not affect one another.
    """
    lower, upper = objective.lower.to(joints), objective.upper.to(joints)
    place = (position / PALM_UNIT).clone().requires_grad_()
    turn = sixd_from_matrix(rotation).clone().requires_grad_()
    bend = joints.clamp(lower, upper).clone().requires_grad_()
    descent = torch.optim.Adam([place, turn, bend], lr=config.step)
    best = [leaf.detach().clone() for leaf in (place, turn, bend)]
    before = after = torch.full_like(position[:, 0], torch.inf)
    for step in range(config.steps + 1):
        R = matrix_from_6d(turn[:, :3], turn[:, 3:])
        value = objective(PALM_UNIT * place, R, bend, objects)
        now = value.detach()
        before = now if step == 0 else before
        lower_now = now < after
        after = torch.where(lower_now, now, after)
        for kept, leaf in zip(best, (place, turn, bend), strict=True):
            kept[lower_now] = leaf.detach()[lower_now]
        if step < config.steps:
            descent.zero_grad()
            value.sum().backward()
            descent.step()
            with torch.no_grad():
                bend.clamp_(lower, upper)
    moved, turned, bent = best
    R = matrix_from_6d(turned[:, :3], turned[:, 3:])
    return Refined(PALM_UNIT * moved, R, bent, before, after)


class Refiner:
    """Refines candidates for one object, which rests in the stable pose of each candidate."""

    def __init__(
        self, model: ObjectModel, hand: HandModel, config: GraspsConfig, q1: Q1Config
    ) -> None:
        self.config, self.objective = config.refine, Objective(hand, config.refine, q1)
        self.atlas = ObjectAtlas.of([model])
        # The last one, -1, is of candidates without a table: far above it.
        poses = transform(model.stable_rotations, np.zeros((len(model.stable_heights), 3)))
        poses[:, 2, 3] = model.stable_heights
        self.T_world_object = np.concatenate([poses, _FLOATING[None]])

    def __call__(self, candidates: Candidates) -> Candidates:
        """The candidates with palms and joints moved; which fingers touch is not known any more."""
        T = torch.as_tensor(self.T_world_object[candidates.stable_pose], dtype=torch.float32)
        palm = T @ torch.as_tensor(candidates.T_object_palm, dtype=torch.float32)
        joints = torch.as_tensor(candidates.joints, dtype=torch.float32)
        index = torch.zeros(len(candidates), 1, dtype=torch.int64)
        objects = SceneObjects(self.atlas, index, T[:, None])
        found = refine(
            self.objective, palm[:, :3, 3], palm[:, :3, :3], joints, objects, self.config
        )
        moved = inverse(T.double()) @ transform(found.rotation.double(), found.position.double())
        return replace(
            candidates,
            position=moved[:, :3, 3].numpy(),
            rotation=moved[:, :3, :3].numpy(),
            joints=found.joints.double().numpy(),
            touching=np.zeros_like(candidates.touching),
        )


_FLOATING = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]])
"""T_world_object where no table is near."""
