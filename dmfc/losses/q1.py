"""Upper bound of the Q1 metric, generalised to hand points that are not in contact yet.

Q = min_j max_i s_j^T M w_i over directions s_j of the 6-D sphere and all wrenches w_i that contact
i can apply with unit normal force (Ferrari and Canny 1992; the bound over finitely many directions:
Schulman et al. 2017; the weight of distant points: Liu et al. 2020).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from dmfc.config.losses import Q1Config
from dmfc.losses.q1_kernel import critical
from dmfc.objects.atlas import SceneObjects

LEVELS = {64: 2, 728: 3, 4032: 4}
"""Number of directions r^6 - (r - 2)^6 -> r, lattice points along an edge of the 6-D cube."""
CHUNK = 4_000_000
"""Supports computed at a time."""
SMALLEST_SQUARE = 1e-12
"""Keeps the root of a tangential part that is not there differentiable."""


def q1_upper(points: Tensor, objects: SceneObjects, config: Q1Config) -> Tensor:
    """Upper bound of Q1 of each grasp, [n]; the loss is exp(-Q).

    points: [n, V, 3] the inner points in the world. A grasp is judged on one object, the one that
    its points are closest to (the largest sum of weights); torques are about its centre of mass.
    """
    return q1_of_contacts(*grasp_contacts(points, objects, config), config)


def grasp_contacts(
    points: Tensor, objects: SceneObjects, config: Q1Config
) -> tuple[Tensor, Tensor, Tensor]:
    """Arms [n, V, 3], outward normals [n, V, 3] and distances [n, V] of points [n, V, 3].

    Of the one object that each grasp is judged on; arms are from its centre of mass.
    """
    with torch.no_grad():
        weights = torch.exp(-config.alpha * objects.distance(points).abs())
        target = weights.sum(-1).argmax(-1)
    grasped = objects.only(target)
    distance, normals = grasped.surface(points)
    return points - grasped.centres.to(points.dtype), normals[:, 0], distance[:, 0]


def q1_of_contacts(arms: Tensor, normals: Tensor, distance: Tensor, config: Q1Config) -> Tensor:
    """Upper bound of Q1 from contacts, [n].

    arms: [n, V, 3] contact points relative to the point that torques are about, metres; normals:
    [n, V, 3] outward unit normals of the object; distance: [n, V] signed distance, metres.
    Of each minimum over directions and maximum over contacts only the element that attains it has a
    gradient, so only that one is computed with a graph. With `worst` above 1 it is the mean over so
    many directions, those of the least support: it is never below the minimum.
    """
    directions = lattice_directions(config.directions).to(arms)
    force, torque = directions[:, :3], config.torque_weight * directions[:, 3:]
    weight = torch.exp(-config.alpha * distance.abs())
    with torch.no_grad():
        compiled = arms.device.type == "cpu" and config.worst == 1
        find = _critical_compiled if compiled else _critical
        rows = max(CHUNK // (arms.shape[1] * len(directions)), 1)
        pieces = zip(arms.split(rows), normals.split(rows), weight.split(rows), strict=True)
        chosen = [find(*piece, force, torque, config) for piece in pieces]
        contact = torch.cat([piece[0] for piece in chosen])
        direction = torch.cat([piece[1] for piece in chosen])
    row = torch.arange(len(arms), device=arms.device)[:, None]
    along = force[direction] + torch.linalg.cross(torque[direction], arms[row, contact], dim=-1)
    perpendicular = -(normals[row, contact] * along).sum(-1)
    squared = along.square().sum(-1)
    return (weight[row, contact] * cone_support(perpendicular, squared, config)).mean(-1)


def cone_support(perpendicular: Tensor, squared: Tensor, config: Q1Config) -> Tensor:
    """Largest u.f over the forces f of a friction cone with unit normal force, any shape.

    perpendicular: component of u along the pressing direction; squared: |u|^2. It is
    max(0, perp + mu * par), par the length of the tangential part.
    """
    tangential = (squared - perpendicular.square()).clamp(min=SMALLEST_SQUARE)
    value = perpendicular + config.friction * tangential.sqrt()
    return value.clamp(min=0) if config.floor else value


@lru_cache(maxsize=len(LEVELS))
def lattice_directions(count: int) -> Tensor:
    """Unit vectors [count, 6] float64 through the lattice points on the faces of the 6-D cube.

    count: 64, 728 or 4032, for 2, 3 or 4 points along an edge.
    """
    edge = np.linspace(-1.0, 1.0, LEVELS[count])
    lattice = np.stack(np.meshgrid(*[edge] * 6, indexing="ij"), axis=-1).reshape(-1, 6)
    surface = lattice[np.abs(lattice).max(axis=1) == 1.0]
    return torch.from_numpy(surface / np.linalg.norm(surface, axis=1, keepdims=True))


def _critical(
    arms: Tensor, normals: Tensor, weight: Tensor, force: Tensor, torque: Tensor, config: Q1Config
) -> tuple[Tensor, Tensor]:
    """Contacts and directions [n, worst] of the least max_i over directions j.

    With u = a + b x r: u.n = (n, r x n).(a, b), and |u|^2 = |a|^2 + 2 r.(a x b) + |b|^2 |r|^2 -
    (b.r)^2, so that both are matrix products of features of contacts and of directions.
    """
    wrench = torch.cat([normals, torch.linalg.cross(arms, normals, dim=-1)], dim=-1)
    perpendicular = -wrench @ torch.cat([force, torque], dim=-1).T
    ones = torch.ones_like(arms[..., :1])
    of_contacts = torch.cat([ones, 2 * arms, arms.square().sum(-1, keepdim=True)], dim=-1)
    of_directions = torch.cat(
        [
            force.square().sum(-1, keepdim=True),
            torch.linalg.cross(force, torque, dim=-1),
            torque.square().sum(-1, keepdim=True),
        ],
        dim=-1,
    )
    squared = of_contacts @ of_directions.T - (arms @ torque.T).square()
    support = weight[..., None] * cone_support(perpendicular, squared, config)
    best, contact = support.max(dim=1)
    direction = best.topk(config.worst, dim=1, largest=False).indices
    return contact.gather(1, direction), direction


def _critical_compiled(
    arms: Tensor, normals: Tensor, weight: Tensor, force: Tensor, torque: Tensor, config: Q1Config
) -> tuple[Tensor, Tensor]:
    """As `_critical` with one direction; where several attain the bound, one of them."""
    features = [force, torque, 2 * torch.linalg.cross(force, torque, dim=-1)]
    squares = [vector.square().sum(-1, keepdim=True) for vector in (force, torque)]
    directions = torch.cat([*features, *squares], dim=-1).T.contiguous().numpy()
    contact, direction = (torch.empty(len(arms), dtype=torch.int64) for _ in range(2))
    kind = directions.dtype.type
    critical(
        arms.detach().contiguous().numpy(),
        normals.detach().contiguous().numpy(),
        weight.detach().contiguous().numpy(),
        directions,
        kind(config.friction),
        kind(SMALLEST_SQUARE),
        config.floor,
        contact.numpy(),
        direction.numpy(),
    )
    return contact[:, None], direction[:, None]
