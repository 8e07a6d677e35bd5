"""Plans the ground-truth grasps of an object: propose, rank by Q1, check in physics, select."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from dmfc.config.grasps import GraspsConfig
from dmfc.config.losses import Q1Config
from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.check import Verdict, check, lifts
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.propose import Candidates, Proposer
from dmfc.hand.description import HandDescription
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.atlas import ObjectAtlas, SceneObjects
from dmfc.losses.q1 import q1_upper
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World

Progress = Callable[[float, str], None]


@dataclass
class _Found:
    """A verified grasp."""

    position: np.ndarray
    rotation: np.ndarray
    joints: np.ndarray
    q1: float
    verdict: Verdict
    robustness: float


def plan(
    model: ObjectModel,
    hand: HandModel,
    description: HandDescription,
    config: GraspsConfig,
    physics: PhysicsConfig,
    q1: Q1Config,
    progress: Progress = lambda fraction, message: None,
) -> GraspSet:
    """Up to `config.per_object` verified grasps of an object; fewer, even none, if it is hard.

    The same settings and seed give the same set.
    """
    generator = np.random.default_rng(config.seed)
    proposer = Proposer(model, hand, description, config)
    world = World(description, [model], physics, table_size=2.0, can_hold=True)
    score = _Scorer(model, hand, q1)
    wanted = round(config.per_object * config.surplus)
    found: list[_Found] = []
    checked = proposed = 0
    while len(found) < wanted and checked < config.max_checks:
        batch = proposer.draw(config.batch, generator)
        proposed += config.batch
        if proposed > config.max_batches * config.batch:
            break
        values = score(batch)
        best = np.argsort(-values, kind="stable")[: max(1, round(config.keep * len(batch)))]
        for row in best[: config.max_checks - checked]:
            checked += 1
            hit = _verified(world, hand, batch, int(row), float(values[row]), config, generator)
            if hit is not None:
                found.append(hit)
            progress(
                max(len(found) / wanted, checked / config.max_checks),
                f"{len(found)} of {checked} checked hold",
            )
            if len(found) >= wanted:
                break
    notes = {"proposed": str(proposed), "checked": str(checked), "held": str(len(found))}
    return _select(model, hand, found, config, notes)


class _Scorer:
    """Q1 of a batch of candidates at the hand's inner points."""

    def __init__(self, model: ObjectModel, hand: HandModel, config: Q1Config) -> None:
        self.kinematics, self.config = HandKinematics(hand), config
        self.atlas = ObjectAtlas.of([model])

    def __call__(self, batch: Candidates) -> np.ndarray:
        """[B]."""
        count = len(batch)
        if not count:
            return np.zeros(0)
        T = torch.eye(4, dtype=torch.float32).repeat(count, 1, 1)
        T[:, :3, :3] = torch.as_tensor(batch.rotation)
        T[:, :3, 3] = torch.as_tensor(batch.position)
        with torch.no_grad():
            joints = torch.as_tensor(batch.joints, dtype=torch.float32)
            points, _ = self.kinematics.inner_points(T, joints)
            index = torch.zeros(count, 1, dtype=torch.int64)
            pose = torch.eye(4).repeat(count, 1, 1, 1)
            value = q1_upper(points, SceneObjects(self.atlas, index, pose), self.config)
        return value.numpy().astype(np.float64)


def _verified(
    world: World,
    hand: HandModel,
    batch: Candidates,
    row: int,
    q1: float,
    config: GraspsConfig,
    generator: np.random.Generator,
) -> _Found | None:
    """Check a candidate and, if it holds, perturbed repeats of it."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = batch.rotation[row], batch.position[row]
    verdict = check(world, hand, T, batch.joints[row], config)
    if not verdict.held or not _lifts(world, hand, batch, row, T, config):
        return None
    held = 1
    for _ in range(config.repeats):
        near = T.copy()
        near[:3, 3] += generator.normal(0.0, config.repeat_shift, 3)
        joints = batch.joints[row] + generator.normal(0.0, config.repeat_turn, len(batch.joints[0]))
        held += check(world, hand, near, joints, config).held
    return _Found(T[:3, 3], T[:3, :3], batch.joints[row], q1, verdict, held / (config.repeats + 1))


def _lifts(
    world: World,
    hand: HandModel,
    batch: Candidates,
    row: int,
    T_object_palm: np.ndarray,
    config: GraspsConfig,
) -> bool:
    """Whether it lifts the object from a table in its stable pose; true if it has none."""
    pose, model = batch.stable_pose[row], world.objects[0]
    if pose < 0:
        return True
    T = np.eye(4)
    T[:3, :3], T[2, 3] = model.stable_rotations[pose], model.stable_heights[pose]
    return lifts(world, hand, T, T_object_palm, batch.joints[row], config)


def _select(
    model: ObjectModel,
    hand: HandModel,
    found: list[_Found],
    config: GraspsConfig,
    notes: dict[str, str],
) -> GraspSet:
    """Spread over palm poses by farthest point sampling; near-duplicates are dropped."""
    if not found:
        return GraspSet.empty(model.id, hand.name, hand.dof_names, notes)
    position = np.array([grasp.position for grasp in found])
    rotation = np.array([grasp.rotation for grasp in found])
    # Two columns of the rotation: a turn by 1 rad is a distance of about 5 cm.
    pose = np.concatenate([position, 0.05 * rotation[:, :, 0], 0.05 * rotation[:, :, 1]], axis=1)
    rows = _spread(pose, config.per_object, config.min_distance)
    chosen = [found[row] for row in rows]
    position, rotation = position[rows], rotation[rows]
    return GraspSet(
        object_id=model.id,
        hand=hand.name,
        dof_names=hand.dof_names,
        position=position,
        rotation=rotation,
        joints=np.array([grasp.joints for grasp in chosen]),
        palm_hit=palm_hits(
            model,
            position + rotation @ hand.palm_reference,
            rotation @ hand.palm_normal,
            config.palm_reach,
        ),
        q1=np.array([grasp.q1 for grasp in chosen]),
        penetration=np.array([grasp.verdict.penetration for grasp in chosen]),
        robustness=np.array([grasp.robustness for grasp in chosen]),
        contacts=np.array([grasp.verdict.contacts for grasp in chosen]),
        notes=notes,
    )


def _spread(pose: np.ndarray, count: int, min_distance: float) -> np.ndarray:
    """Rows of at most `count` poses [n, 9], farthest first, none nearer than `min_distance`."""
    rows = [0]
    nearest = np.linalg.norm(pose - pose[0], axis=1)
    while len(rows) < min(count, len(pose)):
        row = int(np.argmax(nearest))
        if nearest[row] < min_distance:
            break
        rows.append(row)
        nearest = np.minimum(nearest, np.linalg.norm(pose - pose[row], axis=1))
    return np.array(rows)


def palm_hits(
    model: ObjectModel, reference: np.ndarray, direction: np.ndarray, reach: float
) -> np.ndarray:
    """Where rays [n, 3] x 2 (object frame, unit directions) first meet the surface, [n, 3].

    A ray that passes the object within `reach` metres is given the surface point nearest to it, and
    NaN if it passes farther off. Sphere tracing in the signed-distance grid: a step as long as the
    distance cannot overshoot.
    """
    travelled = np.zeros(len(reference))
    best, best_gap = np.zeros(len(reference)), np.full(len(reference), np.inf)
    for _ in range(200):
        points = reference + travelled[:, None] * direction
        gap = np.maximum(-model.sdf.distance(points), 0.0)
        closer = gap < best_gap
        best[closer], best_gap[closer] = travelled[closer], gap[closer]
        # Beyond the grid its distance may be too long by twice the way to the grid.
        beyond = points - np.clip(points, model.sdf.origin, model.sdf.upper)
        to_grid = np.linalg.norm(beyond, axis=1)
        step = np.maximum(gap - 2 * to_grid, to_grid)
        travelled += np.maximum(step, 0.0005) * (gap > 0.0)
    hits = reference + best[:, None] * direction
    beside = best_gap > 0.0005
    if beside.any():
        rows = cKDTree(model.surface_points).query(hits[beside])[1]
        hits[beside] = model.surface_points[rows]
    hits[best_gap > reach] = np.nan
    return hits
