"""Plans the ground-truth grasps of an object: propose, check in physics, select.

Candidates are made in two ways. `_Closed`: fingers are closed by signed distance on an object that
stays where it is, and the best by Q1 are checked. `_Seated`: a fist closes in simulation around an
object that is free, and where both come to rest is checked. The first gives light and small objects
their precise grasps, the second wide and heavy ones theirs; each gets batches by what it has given.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from dmfc.config.grasps import GraspsConfig
from dmfc.config.losses import Q1Config
from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.check import Verdict, check, checking_world, lifts, seat
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.propose import Candidates, Proposer
from dmfc.hand.description import HandDescription
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.q1 import q1_upper
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class _Found:
    """A verified grasp."""

    T_object_palm: np.ndarray
    joints: np.ndarray
    stable_pose: int
    verdict: Verdict

    @property
    def place(self) -> np.ndarray:
        """[9] whose distance says how far apart two palms are, metres."""
        return _places(self.T_object_palm[None])[0]


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
    score = _Scorer(model, hand, q1)
    trials = _Trials(checking_world(description, model, physics, config), hand, proposer, config)
    ways: list[_Way] = [_Closed(trials, score), _Seated(trials, score)]
    wanted = round(config.per_object * config.surplus)
    found: list[_Found] = []
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


class _Trials:
    """Trials of one object in simulation; the clock counts simulated seconds."""

    def __init__(
        self, world: World, hand: HandModel, proposer: Proposer, config: GraspsConfig
    ) -> None:
        self.world, self.hand, self.proposer, self.config = world, hand, proposer, config
        self.clock = 0.0

    def verified(self, T: np.ndarray, joints: np.ndarray, stable_pose: int) -> _Found | None:
        """The grasp, if it passes both checks."""
        verdict = check(self.world, self.hand, T, joints, self.config)
        self._tick()
        if not verdict.held or not self.lifts(T, joints, stable_pose):
            return None
        return _Found(T, joints, stable_pose, verdict)

    def seated(
        self, T_object_palm: np.ndarray, joints: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """The same of a fist that has closed from there."""
        seated = seat(self.world, self.hand, T_object_palm, joints, self.config)
        self._tick()
        return seated

    def lifts(self, T_object_palm: np.ndarray, joints: np.ndarray, stable_pose: int) -> bool:
        """Whether it lifts the object from a table in its stable pose; true if it has none."""
        if stable_pose < 0:
            return True
        model = self.world.objects[0]
        T = np.eye(4)
        T[:3, :3], T[2, 3] = model.stable_rotations[stable_pose], model.stable_heights[stable_pose]
        lifted = lifts(self.world, self.hand, T, T_object_palm, joints, self.config)
        self._tick()
        return lifted

    def robustness(self, grasp: _Found, generator: np.random.Generator) -> float:
        """Share that held of the verified grasp and repeats with palm and joints a little off.

        A repeat is a lift from the table, as in execution; a check where there is no stable pose.
        """
        config, held = self.config, 1
        for _ in range(config.repeats):
            near = grasp.T_object_palm.copy()
            near[:3, 3] += generator.normal(0.0, config.repeat_shift, 3)
            joints = grasp.joints + generator.normal(0.0, config.repeat_turn, len(grasp.joints))
            if grasp.stable_pose < 0:
                held += check(self.world, self.hand, near, joints, config).held
            else:
                held += self.lifts(near, joints, grasp.stable_pose)
        return held / (config.repeats + 1)

    def _tick(self) -> None:
        self.clock += self.world.data.time


class _Way(ABC):
    """A way of making candidates, and what it has given. The best of a batch by Q1 are tried."""

    def __init__(self, trials: _Trials, score: _Scorer) -> None:
        self.trials, self.config, self.score = trials, trials.config, score
        self.held, self.seconds, self.proposed = 0, 0.0, 0

    @property
    def rate(self) -> float:
        """Grasps per simulated second, as if it had begun with one in one second."""
        return (self.held + 1) / (self.seconds + 1.0)

    def draw(self, generator: np.random.Generator) -> Iterator[Candidates]:
        """A batch, one by one, the most promising first."""
        batch = self._batch(generator)
        self.proposed += self.config.batch
        best = np.argsort(-self.score(batch.T, batch.joints), kind="stable")
        kept = batch[best[: max(1, round(self.config.keep * len(batch)))]]
        for row in range(len(kept)):
            yield kept[row : row + 1]

    def attempt(self, candidate: Candidates) -> _Found | None:
        """Try one of them."""
        began = self.trials.clock
        found = self._attempt(candidate)
        self.held += found is not None
        self.seconds += self.trials.clock - began
        return found

    @abstractmethod
    def _batch(self, generator: np.random.Generator) -> Candidates: ...

    @abstractmethod
    def _attempt(self, candidate: Candidates) -> _Found | None: ...


class _Closed(_Way):
    """Fingers closed by signed distance."""

    def _batch(self, generator: np.random.Generator) -> Candidates:
        return self.trials.proposer.draw(self.config.batch, generator)

    def _attempt(self, candidate: Candidates) -> _Found | None:
        pose = int(candidate.stable_pose[0])
        return self.trials.verified(candidate.T[0], candidate.joints[0], pose)


class _Seated(_Way):
    """A fist closed around the free object."""

    def _batch(self, generator: np.random.Generator) -> Candidates:
        return self.trials.proposer.draw_open(self.config.batch, generator)

    def _attempt(self, candidate: Candidates) -> _Found | None:
        seated = self.trials.seated(candidate.T[0], candidate.preshape[0])
        if seated is None:
            return None
        reached = self.trials.proposer.reached(*seated)
        return self.trials.verified(*seated, int(reached[0])) if len(reached) else None


class _Scorer:
    """Q1 of a batch of candidates at the hand's inner points."""

    def __init__(self, model: ObjectModel, hand: HandModel, config: Q1Config) -> None:
        self.kinematics, self.config = HandKinematics(hand), config
        self.atlas = ObjectAtlas.of([model])

    def __call__(self, T_object_palm: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """[B], of palms [B, 4, 4] and joints [B, D]."""
        count = len(joints)
        if not count:
            return np.zeros(0)
        T = torch.as_tensor(T_object_palm, dtype=torch.float32)
        with torch.no_grad():
            angles = torch.as_tensor(joints, dtype=torch.float32)
            points, _ = self.kinematics.inner_points(T, angles)
            index = torch.zeros(count, 1, dtype=torch.int64)
            pose = torch.eye(4).repeat(count, 1, 1, 1)
            value = q1_upper(points, SceneObjects(self.atlas, index, pose), self.config)
        return value.numpy().astype(np.float64)


def _as_set(
    model: ObjectModel,
    hand: HandModel,
    chosen: list[_Found],
    score: _Scorer,
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


def _places(T_object_palm: np.ndarray) -> np.ndarray:
    """[n, 9] of palms [n, 4, 4]: position, and two columns of the rotation: 1 rad is about 5 cm."""
    turned = 0.05 * T_object_palm[:, :3, :2].swapaxes(1, 2).reshape(-1, 6)
    return np.concatenate([T_object_palm[:, :3, 3], turned], axis=1)


def _is_near(T_object_palm: np.ndarray, found: list[_Found], min_distance: float) -> bool:
    """Whether a palm [4, 4] is nearly where that of a grasp is that is found already."""
    if not found:
        return False
    place = _places(T_object_palm[None])
    apart = np.linalg.norm(np.array([grasp.place for grasp in found]) - place, axis=1)
    return bool(apart.min() < min_distance)


def _spread(found: list[_Found], count: int, min_distance: float) -> list[int]:
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
