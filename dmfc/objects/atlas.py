"""`ObjectAtlas`: the distance grids of all objects; `SceneObjects`: which of them are where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from dmfc.errors import DmfcError
from dmfc.geometry.grid import Grid
from dmfc.geometry.grid_atlas import GridAtlas

NORMAL_STEP = 1e-3
"""Metres; half the span of the differences that give a surface normal."""


class PreparedObject(Protocol):
    """What the atlas needs of an object; `dmfc.objects.model.ObjectModel` has it."""

    @property
    def id(self) -> str: ...
    @property
    def sdf(self) -> Grid: ...
    @property
    def com(self) -> np.ndarray: ...


class ObjectAtlas:
    """Signed distance of many objects, positive inside; object i is row i of the atlas."""

    def __init__(self, ids: Sequence[str], grids: Sequence[Grid], centres: np.ndarray) -> None:
        """centres [G, 3]: centre of mass of each object, object frame.

        Raises DmfcError without an object, or where an id comes twice.
        """
        if not ids:
            raise DmfcError("there is no object to train on (setting objects.train)")
        twice = {i for i in ids if list(ids).count(i) > 1} if len(set(ids)) < len(ids) else set()
        if twice:
            raise DmfcError(f"object '{min(twice)}' comes twice (setting objects.train)")
        self.ids = list(ids)
        self.grids = GridAtlas(grids)
        self.centres = torch.as_tensor(np.asarray(centres, dtype=np.float64).reshape(-1, 3))

    @classmethod
    def of(cls, objects: Sequence[PreparedObject]) -> ObjectAtlas:
        """The atlas of prepared objects, in their order."""
        centres = np.array([item.com for item in objects])
        return cls([item.id for item in objects], [item.sdf for item in objects], centres)

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True)
class SceneObjects:
    """The objects around each of n grasps, padded to K."""

    atlas: ObjectAtlas
    index: Tensor
    """[n, K] i64 row of the atlas, -1 where there is none."""
    T_world_object: Tensor
    """[n, K, 4, 4]."""

    def take(self, rows: Tensor) -> SceneObjects:
        """The objects of some rows [m] (of scenes, to grasps)."""
        return SceneObjects(self.atlas, self.index[rows], self.T_world_object[rows])

    def only(self, which: Tensor) -> SceneObjects:
        """One object for each grasp: the `which` [n] of its K."""
        rows = torch.arange(len(which), device=which.device)
        picked = self.index[rows, which][:, None], self.T_world_object[rows, which][:, None]
        return SceneObjects(self.atlas, *picked)

    @property
    def count(self) -> Tensor:
        """[n] objects around each grasp."""
        return (self.index >= 0).sum(dim=1)

    @property
    def centres(self) -> Tensor:
        """[n, K, 3] centres of mass in the world; meaningless for padding."""
        com = self.atlas.centres.to(self.T_world_object)[self.index.clamp(min=0)]
        rotation, position = self.T_world_object[..., :3, :3], self.T_world_object[..., :3, 3]
        return (rotation @ com[..., None])[..., 0] + position

    def distance(self, points: Tensor) -> Tensor:
        """Signed distance of world points [n, P, 3] to every object, [n, K, P], positive inside.

        Padding is 10 m away. Differentiable once in the points; the objects do not move.
        """
        return self.atlas.grids.distance(points, self.index, self.T_world_object)

    def depth(self, points: Tensor) -> Tensor:
        """max(distance, 0) of world points [n, P, 3] in every object, [n, K, P]; cheaper."""
        near = self.atlas.grids.distance(points, self.index, self.T_world_object, near=True)
        return near.clamp(min=0)

    def surface(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Signed distance [n, K, P] and outward unit normal [n, K, P, 3] at the closest surface.

        The normal is minus the normalised gradient of the distance, by central differences, which
        makes it differentiable: it turns as the surface curves.
        """
        steps = NORMAL_STEP * torch.eye(3, dtype=points.dtype, device=points.device)
        steps = torch.cat([torch.zeros_like(steps[:1]), steps, -steps])
        moved = (points[:, None] + steps[:, None]).flatten(1, 2)
        distance = self.distance(moved).unflatten(2, (7, -1))
        outward = (distance[:, :, 4:] - distance[:, :, 1:4]).movedim(2, -1)
        normal = torch.nn.functional.normalize(outward, dim=-1)
        return distance[:, :, 0], normal
