"""Plans the ground-truth grasps of an object: propose, check in physics, select.

Candidates are made in two ways. `Closed`: fingers are closed by signed distance on an object that
stays where it is, and the best by Q1 are checked. `Seated`: a fist closes in simulation around an
object that is free, and where both come to rest is checked. The first gives light and small objects
their precise grasps, the second wide and heavy ones theirs; each gets batches by what it has given.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dmfc.config.grasps import GraspsConfig
from dmfc.config.losses import Q1Config
from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.check import checking_world
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.palm_hits import palm_hits
from dmfc.grasps.propose import Proposer
from dmfc.grasps.ways import Closed, Scorer, Seated, Trials, Verified, Way, places
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel

Progress = Callable[[float, str], None]


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
    score = Scorer(model, hand, q1)
    trials = Trials(checking_world(description, model, physics, config), hand, proposer, config)
    ways: list[Way] = [Closed(trials, score), Seated(trials, score)]
    wanted = round(config.per_object * config.surplus)
    found: list[Verified] = []
    checked = 0
    for _ in range(config.max_batches):
        rates = np.array([way.rate**2 for way in ways])
        way = ways[generator.choice(len(ways), p=rates / rates.sum())]
        for candidate in way.draw(generator):
            worse = way.rate < 0.5 * max(other.rate for other in ways)
            if worse or checked >= config.max_checks or len(found) >= wanted:
                break
            if _is_near(candidate.T[0], found, config.min_distance):
                continue
            checked += 1
            hit = way.attempt(candidate)
            if hit is not None and not _is_near(hit.T_object_palm, found, config.min_distance):
                found.append(hit)
            progress(
                max(len(found) / wanted, checked / config.max_checks),
                f"{len(found)} of {checked} checked hold",
            )
        if len(found) >= wanted or checked >= config.max_checks:
            break
    notes = {
        "proposed": str(sum(way.proposed for way in ways)),
        "checked": str(checked),
        "held": str(len(found)),
        "seated": str(ways[1].held),
    }
    chosen = [found[row] for row in _spread(found, config.per_object, config.min_distance)]
    robustness = [trials.robustness(grasp, generator) for grasp in chosen]
    return _as_set(model, hand, chosen, score, robustness, config, notes)


def _as_set(
    model: ObjectModel,
    hand: HandModel,
    chosen: list[Verified],
    score: Scorer,
    robustness: list[float],
    config: GraspsConfig,
    notes: dict[str, str],
) -> GraspSet:
    if not chosen:
        return GraspSet.empty(model.id, hand.name, hand.dof_names, notes)
    T = np.array([grasp.T_object_palm for grasp in chosen])
    joints = np.array([grasp.joints for grasp in chosen])
    position, rotation = T[:, :3, 3], T[:, :3, :3]
    return GraspSet(
        object_id=model.id,
        hand=hand.name,
        dof_names=hand.dof_names,
        position=position,
        rotation=rotation,
        joints=joints,
        palm_hit=palm_hits(
            model,
            position + rotation @ hand.palm_reference,
            rotation @ hand.palm_normal,
            config.palm_reach,
        ),
        q1=score(T, joints),
        penetration=np.array([grasp.verdict.penetration for grasp in chosen]),
        robustness=np.array(robustness),
        contacts=np.array([grasp.verdict.contacts for grasp in chosen]),
        notes=notes,
    )


def _is_near(T_object_palm: np.ndarray, found: list[Verified], min_distance: float) -> bool:
    """Whether a palm [4, 4] is nearly where that of a grasp is that is found already."""
    if not found:
        return False
    place = places(T_object_palm[None])
    apart = np.linalg.norm(np.array([grasp.place for grasp in found]) - place, axis=1)
    return bool(apart.min() < min_distance)


def _spread(found: list[Verified], count: int, min_distance: float) -> list[int]:
    """Rows of at most `count` grasps, farthest first, none nearer than `min_distance`."""
    if not found:
        return []
    place = np.array([grasp.place for grasp in found])
    rows = [0]
    nearest = np.linalg.norm(place - place[0], axis=1)
    while len(rows) < min(count, len(place)):
        row = int(np.argmax(nearest))
        if nearest[row] < min_distance:
            break
        rows.append(row)
        nearest = np.minimum(nearest, np.linalg.norm(place - place[row], axis=1))
    return rows
