"""Differentiable, batched forward kinematics of a hand, through pytorch-kinematics.

The chain is built from its `Frame` objects: its own MJCF reader fails on MuJoCo 3.17.
"""

from __future__ import annotations

import numpy as np
import torch
from pytorch_kinematics.chain import Chain
from pytorch_kinematics.frame import Frame, Joint, Link
from pytorch_kinematics.transforms import Transform3d
from torch import Tensor

from dmfc.geometry.transforms import rotate
from dmfc.hand.model import HandModel


class HandKinematics:
    """Poses of links and of points on them, from a palm pose and joint angles.

    Follows the dtype and device of the joints it is given; angles are not clamped to the limits.
    """

    def __init__(self, hand: HandModel) -> None:
        self.hand = hand
        self._prepared: dict[tuple[torch.dtype, torch.device], _Prepared] = {}

    def forward(self, joints: Tensor) -> Tensor:
        """T_palm_link [B, L, 4, 4] of joints [B, D] rad."""
        ready = self._on(joints)
        angles = joints[:, ready.joint_dof] * ready.joint_scale
        poses = ready.chain.forward_kinematics(angles)
        stacked = [poses[name].get_matrix().expand(len(joints), 4, 4) for name in ready.names]
        return torch.stack(stacked, dim=1)

    def links(self, T_x_palm: Tensor, joints: Tensor) -> Tensor:
        """T_x_link [B, L, 4, 4] of palm poses T_x_palm [B, 4, 4] in any frame x."""
        return T_x_palm[:, None] @ self.forward(joints)

    def collision_points(self, T_x_palm: Tensor, joints: Tensor) -> Tensor:
        """The collision points in frame x, [B, P, 3]."""
        return self.collision_points_of_links(self.links(T_x_palm, joints))

    def collision_points_of_links(self, T_x_link: Tensor) -> Tensor:
        """The collision points of links that are placed already, [B, L, 4, 4] -> [B, P, 3]."""
        ready = self._on(T_x_link)
        return ready.collision.place(T_x_link)

    def inner_points(self, T_x_palm: Tensor, joints: Tensor) -> tuple[Tensor, Tensor]:
        """The inner points and their unit normals in frame x, [B, V, 3] each."""
        return self.inner_points_of_links(self.links(T_x_palm, joints))

    def inner_points_of_links(self, T_x_link: Tensor) -> tuple[Tensor, Tensor]:
        """The inner points and normals of links that are placed already, [B, V, 3] each."""
        ready = self._on(T_x_link)
        normals = rotate(T_x_link[:, ready.inner_link], ready.inner_normals[None, :, None])
        return ready.inner.place(T_x_link), normals[:, :, 0]

    def clamp(self, joints: Tensor) -> Tensor:
        """Joints [..., D] clamped to the hand's limits; no gradient beyond a limit."""
        ready = self._on(joints)
        return torch.clamp(joints, ready.lower, ready.upper)

    def _on(self, like: Tensor) -> _Prepared:
        key = (like.dtype, like.device)
        if key not in self._prepared:
            self._prepared[key] = _Prepared(self.hand, *key)
        return self._prepared[key]


class _Prepared:
    """The constants of one hand for one dtype and device."""

    def __init__(self, hand: HandModel, dtype: torch.dtype, device: torch.device) -> None:
        def tensor(array: np.ndarray) -> Tensor:
            kind = torch.int64 if array.dtype.kind == "i" else dtype
            return torch.as_tensor(array, dtype=kind, device=device)

        self.names = [f"{i}:{name}" for i, name in enumerate(hand.link_names)]
        # The constructor ignores `device` for some of its members; `to` moves them all.
        self.chain = _chain(hand, self.names, dtype).to(dtype=dtype, device=device)
        order = [int(name.split(":")[0]) for name in self.chain.get_joint_parameter_names()]
        self.joint_dof = tensor(hand.joint_dof[order])
        self.joint_scale = tensor(hand.joint_scale[order])
        self.lower, self.upper = tensor(hand.lower), tensor(hand.upper)
        self.collision = _LinkPoints(tensor(hand.collision_link), tensor(hand.collision_points))
        self.inner_link = tensor(hand.inner_link)
        self.inner = _LinkPoints(self.inner_link, tensor(hand.inner_points))
        self.inner_normals = tensor(hand.inner_normals)


class _LinkPoints:
    """Points fixed to links, sorted by link so that each link's are placed by one product."""

    def __init__(self, link: Tensor, points: Tensor) -> None:
        order = torch.argsort(link, stable=True)
        self.back = torch.argsort(order)
        self.in_order = bool((order == torch.arange(len(order), device=order.device)).all())
        present, counts = torch.unique_consecutive(link[order], return_counts=True)
        pieces = torch.split(points[order], counts.tolist())
        self.pieces = list(zip(present.tolist(), pieces, strict=True))

    def place(self, T_x_link: Tensor) -> Tensor:
        """[B, L, 4, 4] -> [B, P, 3]."""
        placed = [
            piece @ T_x_link[:, link, :3, :3].mT + T_x_link[:, link, None, :3, 3]
            for link, piece in self.pieces
        ]
        points = torch.cat(placed, dim=1)
        return points if self.in_order else points[:, self.back]


def _chain(hand: HandModel, names: list[str], dtype: torch.dtype) -> Chain:
    """The kinematic tree; joint "i:name" turns link i."""
    frames: list[Frame] = []
    for i, name in enumerate(names):
        offset = Transform3d(matrix=torch.as_tensor(hand.T_parent_link[i], dtype=dtype)[None])
        turns = hand.joint_dof[i] >= 0
        joint = Joint(
            name=name,
            offset=offset,
            joint_type="revolute" if turns else "fixed",
            axis=torch.as_tensor(hand.joint_axis[i]) if turns else None,
            dtype=dtype,
        )
        frames.append(Frame(name=name, link=Link(name=name), joint=joint))
        if hand.parents[i] >= 0:
            frames[hand.parents[i]].add_child(frames[i])
    return Chain(frames[0], dtype=dtype)
