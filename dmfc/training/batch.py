"""What training reads: scenes as tensors, one by one and as padded batches."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class SceneItem:
    """One scene as training sees it; world frame, metres and rad, float32 and int64."""

    points: Tensor
    """`[N,3]`."""
    seed_index: Tensor
    """`[S]`: rows of the seed points in `points`."""
    grasp_position: Tensor
    """`[G,3]` of the palms of the labels, those that match a seed point."""
    grasp_rotation: Tensor
    """`[G,3,3]` R_world_palm."""
    grasp_joints: Tensor
    """`[G,J]`."""
    match: Tensor
    """`[S,G]` bool: which labels belong to which seed points."""
    object_index: Tensor
    """`[k]`: the scene's objects, as rows of the atlas."""
    T_world_object: Tensor
    """`[k,4,4]`."""
    scene_number: Tensor
    """`[]`: number of the scene in its set."""


@dataclass(frozen=True)
class Batch:
    """B scenes, padded to the most labels G (at least one) and the most objects k of a scene."""

    points: Tensor
    """`[B,N,3]` float32, world frame, metres."""
    seed_index: Tensor
    """`[B,S]` int64: rows of the seed points in `points`."""
    grasp_position: Tensor
    """`[B,G,3]`; 0 where `grasp_mask` is false."""
    grasp_rotation: Tensor
    """`[B,G,3,3]` R_world_palm; 0 where `grasp_mask` is false."""
    grasp_joints: Tensor
    """`[B,G,J]` rad; 0 where `grasp_mask` is false."""
    grasp_mask: Tensor
    """`[B,G]` bool: which labels are there."""
    match: Tensor
    """`[B,S,G]` bool: which labels belong to which seed points."""
    object_index: Tensor
    """`[B,k]` int64: rows of the atlas; -1 for padding."""
    T_world_object: Tensor
    """`[B,k,4,4]` float32; the identity for padding."""
    scene_number: Tensor
    """`[B]` int64: numbers of the scenes in their set."""

    def __len__(self) -> int:
        return len(self.points)

    def tensors(self) -> dict[str, Tensor]:
        """The tensors by name."""
        return {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}

    def to(self, device: torch.device | str, non_blocking: bool = False) -> Batch:
        """The batch on a device; Lightning calls this."""
        moved = {k: v.to(device, non_blocking=non_blocking) for k, v in self.tensors().items()}
        return Batch(**moved)


def collate(items: Sequence[SceneItem]) -> Batch:
    """The batch of scenes, padded as `Batch` says."""
    most = max(1, *(len(item.grasp_position) for item in items))
    objects = max(len(item.object_index) for item in items)
    counts = torch.tensor([len(item.grasp_position) for item in items])
    T_world_object = torch.eye(4).expand(len(items), objects, 4, 4).clone()
    for row, item in enumerate(items):
        T_world_object[row, : len(item.T_world_object)] = item.T_world_object
    return Batch(
        points=torch.stack([item.points for item in items]),
        seed_index=torch.stack([item.seed_index for item in items]),
        grasp_position=torch.stack([_padded(item.grasp_position, most, 0) for item in items]),
        grasp_rotation=torch.stack([_padded(item.grasp_rotation, most, 0) for item in items]),
        grasp_joints=torch.stack([_padded(item.grasp_joints, most, 0) for item in items]),
        grasp_mask=torch.arange(most) < counts[:, None],
        match=torch.stack([_padded(item.match.mT, most, False).mT for item in items]),
        object_index=torch.stack([_padded(item.object_index, objects, -1) for item in items]),
        T_world_object=T_world_object,
        scene_number=torch.stack([item.scene_number for item in items]),
    )


def _padded(values: Tensor, size: int, fill: float) -> Tensor:
    """Values [n, ...] followed by `fill` up to length `size`."""
    result = values.new_full((size, *values.shape[1:]), fill)
    result[: len(values)] = values
    return result
