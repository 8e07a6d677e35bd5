"""The two ways in which the planner makes candidates, and their trials in simulation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from dmfc.config.grasps import GraspsConfig
from dmfc.config.losses import Q1Config
from dmfc.grasps.check import Verdict, check, lifts, seat
from dmfc.grasps.propose import Candidates, Proposer
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.q1 import q1_upper
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World


@dataclass(frozen=True)
class Verified:
    """A verified grasp."""

    T_object_palm: np.ndarray
    joints: np.ndarray
    stable_pose: int
    verdict: Verdict

    @property
    def place(self) -> np.ndarray:
        """[9] whose distance says how far apart two palms are, metres."""
        return places(self.T_object_palm[None])[0]


class Trials:
    """Trials of one object in simulation; the clock counts simulated seconds."""

    def __init__(
        self, world: World, hand: HandModel, proposer: Proposer, config: GraspsConfig
    ) -> None:
        self.world, self.hand, self.proposer, self.config = world, hand, proposer, config
        self.clock = 0.0

    def verified(self, T: np.ndarray, joints: np.ndarray, stable_pose: int) -> Verified | None:
        """The grasp, if it passes both checks."""
        verdict = check(self.world, self.hand, T, joints, self.config)
        self._tick()
        if not verdict.held or not self.lifts(T, joints, stable_pose):
            return None
        return Verified(T, joints, stable_pose, verdict)

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

    def robustness(self, grasp: Verified, generator: np.random.Generator) -> float:
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


class Way(ABC):
    """A way of making candidates, and what it has given. The best of a batch by Q1 are tried."""

    def __init__(self, trials: Trials, score: Scorer) -> None:
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

    def attempt(self, candidate: Candidates) -> Verified | None:
        """Try one of them."""
        began = self.trials.clock
        found = self._attempt(candidate)
        self.held += found is not None
        self.seconds += self.trials.clock - began
        return found

    @abstractmethod
    def _batch(self, generator: np.random.Generator) -> Candidates: ...

    @abstractmethod
    def _attempt(self, candidate: Candidates) -> Verified | None: ...


class Closed(Way):
    """Fingers closed by signed distance."""

    def _batch(self, generator: np.random.Generator) -> Candidates:
        return self.trials.proposer.draw(self.config.batch, generator)

    def _attempt(self, candidate: Candidates) -> Verified | None:
        pose = int(candidate.stable_pose[0])
        return self.trials.verified(candidate.T[0], candidate.joints[0], pose)


class Seated(Way):
    """A fist closed around the free object."""

    def _batch(self, generator: np.random.Generator) -> Candidates:
        return self.trials.proposer.draw_open(self.config.batch, generator)

    def _attempt(self, candidate: Candidates) -> Verified | None:
        seated = self.trials.seated(candidate.T[0], candidate.preshape[0])
        if seated is None:
            return None
        reached = self.trials.proposer.reached(*seated)
        return self.trials.verified(*seated, int(reached[0])) if len(reached) else None


class Scorer:
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


def places(T_object_palm: np.ndarray) -> np.ndarray:
    """[n, 9] of palms [n, 4, 4]: position, and two columns of the rotation: 1 rad is about 5 cm."""
    turned = 0.05 * T_object_palm[:, :3, :2].swapaxes(1, 2).reshape(-1, 6)
    return np.concatenate([T_object_palm[:, :3, 3], turned], axis=1)
