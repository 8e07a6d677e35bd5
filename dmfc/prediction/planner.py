"""`GraspPlanner`: a trained network as a function of a user's cloud."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.config.hand import HandConfig
from dmfc.errors import DmfcError, unknown_name
from dmfc.geometry.compiled import with_compiled_loops
from dmfc.geometry.points import choose
from dmfc.geometry.transforms import transform
from dmfc.hand.description import load_description
from dmfc.network.checkpoint import load_alone
from dmfc.network.inference import PredictedGrasps, predict
from dmfc.network.model import DmfcGraspNet
from dmfc.outcome.features import SeededGrasps
from dmfc.outcome.judge import Judge, has_judge
from dmfc.prediction.models import model_folder
from dmfc.prediction.ranked import RankedGrasps
from dmfc.prediction.table_plane import find_table
from dmfc.sensing.check_cloud import CheckedCloud, check_cloud, require_points

if TYPE_CHECKING:
    from dmfc.prediction.cloud_check import CloudCheck

POINTS = 2048
"""Points that the network is given, as in its training."""
TABLE = ("refuse", "remove", "keep")
SCORES = ("outcome", "confidence")
UP = (0.0, 0.0, 1.0)


def load(model: str | Path | None = None, compiled: bool = True) -> GraspPlanner:
    """The planner of a model: a shipped one's name (None: the default), or a model's folder.

    `compiled=False` does without compiled loops: five times as slow, but at once (see
    `dmfc.geometry.compiled`). Raises DmfcError where there is no such model.
    """
    folder = model_folder(model)
    net, hand = load_alone(folder)
    dof_names = load_description(hand).dof_names
    if len(dof_names) != len(net.lower):
        raise DmfcError(
            f"{folder}: {len(net.lower)} joints, but the hand '{hand}' has {len(dof_names)}"
        )
    judge = Judge.load(folder) if has_judge(folder) else None
    return GraspPlanner(net, hand, dof_names, folder.name, compiled, judge)


class GraspPlanner:
    """Called with a cloud, answers its grasps; the same cloud gives the same grasps."""

    def __init__(
        self,
        net: DmfcGraspNet,
        hand: str,
        dof_names: list[str],
        model: str,
        compiled: bool = True,
        judge: Judge | None = None,
    ) -> None:
        """`judge`: predicts how likely each grasp is to hold; this is then its confidence."""
        self.net, self.hand, self.dof_names, self.judge = net, hand, dof_names, judge
        self.model, self.compiled = model, compiled

    def __call__(
        self,
        points: np.ndarray,
        *,
        unit: str = "m",
        up: Sequence[float] = UP,
        table: str = "refuse",
        drop_invalid: bool = False,
        check: bool = False,
        score: str = "",
    ) -> RankedGrasps:
        """Grasps of the objects whose surface `points` [N, 3] are, in the same frame, in metres.

        `unit` of the points: m, cm, mm or inch. `up` [3]: against gravity, in the cloud's frame,
        which may lie anywhere. `table`: what to do about one in the cloud: refuse, remove or keep.
        `check`: leave out grasps that the points or the table are in the way of, which is taken to
        be where the lowest point is (`CloudCheck`); the first time it builds the hand's model.
        `score`: what the confidence is: "outcome", the probability of being held by the model's
        outcome predictor, or "confidence", the network's own; empty: the former where there is one.
        At most one grasp per point, so 512 in all. Raises DmfcError as `check_cloud` does, and
        where a table was left in the cloud.
        """
        R_scene_cloud = upright(up)
        cloud = check_cloud(points, unit, drop_invalid)
        cloud = _without_table(cloud, R_scene_cloud[2], table)
        judge = self._asked(score)
        chosen = cloud[choose(len(cloud.points), POINTS, np.random.default_rng(0))]
        # About their centre in float64: the network's float32 loses a map's coordinates.
        centre = chosen.points.mean(0) @ R_scene_cloud.T * self._moved
        seen = chosen.points @ R_scene_cloud.T - centre
        with with_compiled_loops(self.compiled):
            found = predict(self.net, seen)
        point = chosen.rows[found.seed_index]
        once = np.sort(np.unique(point, return_index=True)[1])
        height = np.array([0.0, 0.0, seen[:, 2].min()])  # of the table
        if check:
            T_table_palm = transform(found.rotation[once], found.position[once] - height)
            once = once[self._cloud_check.clear(T_table_palm, found.joints[once], seen - height)]
        confidence = found.confidence
        if judge is not None:
            confidence = judge(_on_table(found, height), seen - height).held
            once = once[np.argsort(-confidence[once], kind="stable")]
        grasps = found[once].in_frame(transform(R_scene_cloud.T, R_scene_cloud.T @ centre))
        return RankedGrasps(
            grasps.position,
            grasps.rotation,
            grasps.joints,
            confidence[once],
            point[once],
            self.dof_names,
            self.hand,
            self.model,
        )

    @property
    def _moved(self) -> np.ndarray:
        """[3] 1 along the axes on which the network's answer moves with the cloud."""
        return np.array([1.0, 1.0, 0.0 if self.net.config.height_feature else 1.0])

    def _asked(self, score: str) -> Judge | None:
        if score not in ("", *SCORES):
            raise unknown_name("score", score, SCORES)
        if score == "outcome" and self.judge is None:
            raise DmfcError(
                f"the model '{self.model}' has no outcome predictor (--score confidence)"
            )
        return None if score == "confidence" else self.judge

    @cached_property
    def _cloud_check(self) -> CloudCheck:
        from dmfc.hand.build import build_hand
        from dmfc.prediction.cloud_check import CloudCheck

        return CloudCheck(build_hand(HandConfig(name=self.hand)), ExecutionConfig())


def _on_table(found: PredictedGrasps, height: np.ndarray) -> SeededGrasps:
    """Predictions as a judge knows them, with the table at [0, 0, z] moved to z = 0."""
    return SeededGrasps(
        found.position - height, found.rotation, found.joints, found.seed_index, found.confidence
    )


def upright(up: Sequence[float]) -> np.ndarray:
    """R_scene_cloud [3, 3], the smallest turn that makes `up` the z axis.

    Raises DmfcError where `up` is no direction.
    """
    vector = np.asarray(up, dtype=np.float64)
    length = np.linalg.norm(vector) if vector.shape == (3,) else np.nan
    if not (np.isfinite(length) and length > 0):
        raise DmfcError(f"up is a direction of three numbers such as 0,0,1, not {up} (--up)")
    x, y, z = vector / length
    if z < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    # Rodrigues' formula about up x z
    skew = np.array([[0, 0, -x], [0, 0, -y], [x, y, 0]])
    return np.eye(3) + skew + skew @ skew / (1 + z)


def _without_table(cloud: CheckedCloud, up: np.ndarray, table: str) -> CheckedCloud:
    if table not in TABLE:
        raise unknown_name("way with a table", table, TABLE)
    found = None if table == "keep" else find_table(cloud.points, up)
    if found is None:
        return cloud
    if table == "refuse":
        raise DmfcError(
            f"{found.mean():.0%} of the points lie on a plane below the rest: a table was left in "
            "the cloud; take it out with --table remove, or keep it as an object with --table keep"
        )
    left = cloud[~found]
    require_points(left, f"{int(found.sum())} lay on the table")
    return left
