"""Lower bound of the Q1 metric: the exact Q1 of pyramids inside the friction cones.

Q1 = min_{|s|=1} h(s), h the support function of the hull W of all wrenches M w_i (Ferrari and Canny
1992). A polytope P inside W gives Q1(P) <= Q1(W); here P is the hull of the edges of a pyramid in
each cone (Miller and Allen 1999), of the contacts that weigh most. Q1(P) is the distance d of the
facet closest to the origin. Its normal n certifies it, d = max_k n.y_k, and the gradient is that
of n.y for the point y = sum_k x_k y_k where ball and facet touch (envelope theorem). The paper
leaves a semidefinite relaxation (Dai et al. 2015) as future work; listing facets is exact.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

from dmfc.config.losses import Q1Config, Q1LowerConfig

INSIDE = 1e-9
"""The origin is in the hull of unit forces if it is this near to it."""


def q1_lower_of_contacts(
    arms: Tensor, normals: Tensor, distance: Tensor, config: Q1Config, bound: Q1LowerConfig
) -> Tensor:
    """Lower bound of Q1 from contacts, [n], as `q1_of_contacts` takes them; on the CPU, in float64.

    Where the wrenches do not surround the origin it is 0, and with `floor` off minus their distance
    from it. Grows with friction, with `contacts`, and with `edges` when those are doubled.
    """
    heaviest = distance.detach().abs().argsort(dim=1, stable=True)[:, : bound.contacts or None]
    row = torch.arange(len(arms), device=arms.device)[:, None]
    p, n, d = (x[row, heaviest].double().cpu() for x in (arms, normals, distance))
    wrenches = pyramid_wrenches(p, n, d, config, bound.edges)
    metric = wrenches.new_tensor([1.0, 1.0, 1.0] + [config.torque_weight] * 3)
    values = [_of_hull(hull, config.floor) for hull in wrenches * metric]
    return torch.stack(values).to(arms) if values else arms.new_zeros(0)


def pyramid_wrenches(
    arms: Tensor, normals: Tensor, distance: Tensor, config: Q1Config, edges: int
) -> Tensor:
    """Force and torque about the centre of each edge of each weighted cone, [n, V * edges, 6].

    w = exp(-alpha |d|) (f, p x f), f = -n + mu (cos a * t1 + sin a * t2): N and N m for a unit
    normal force, before the metric.
    """
    axis = torch.eye(3, dtype=normals.dtype)[normals.detach().abs().argmin(-1)]
    first = torch.nn.functional.normalize(torch.linalg.cross(normals, axis, dim=-1), dim=-1)
    second = torch.linalg.cross(normals, first, dim=-1)
    angle = torch.arange(edges, dtype=normals.dtype) * (2 * torch.pi / edges)
    across, up = angle.cos()[:, None] * first[..., None, :], angle.sin()[:, None]
    tangent = across + up * second[..., None, :]
    force = -normals[..., None, :] + config.friction * tangent
    torque = torch.linalg.cross(arms[..., None, :].expand_as(force), force, dim=-1)
    weight = torch.exp(-config.alpha * distance.abs())[..., None, None]
    return (weight * torch.cat([force, torque], dim=-1)).flatten(1, 2)


def _of_hull(wrenches: Tensor, floor: bool) -> Tensor:
    """Q1 of the hull of wrenches [k, 6], in the metric."""
    points = wrenches.detach().numpy()
    shares = _nearest_to_origin(points)
    apart = torch.from_numpy(shares) @ wrenches
    if apart.detach().norm() > INSIDE:
        return -apart.norm() * (0.0 if floor else 1.0)
    closest = _closest_facet(points)
    if closest is None:
        return 0.0 * apart.sum()
    normal, offset = closest
    # The facet touches the ball at offset * normal, a combination of the points in its plane.
    facet = np.flatnonzero(np.abs(points @ normal - offset) <= INSIDE)
    shares = _nearest_to_origin(points[facet] - offset * normal)
    return torch.from_numpy(shares) @ wrenches[facet] @ torch.from_numpy(normal)


def _nearest_to_origin(points: np.ndarray) -> np.ndarray:
    """Shares [k] >= 0, of sum 1, of the convex combination of points [k, 6] nearest to the origin.

    |sum_k x_k p_k|^2 + (sum_k x_k - 1)^2 over x >= 0 is least along the same ray.
    """
    shares, _ = nnls(np.concatenate([points.T, np.ones((1, len(points)))]), np.eye(7)[6])
    return shares / shares.sum()


def _closest_facet(points: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Unit normal [6] and distance from the origin of the closest facet of the hull of points.

    The hull, of points [k, 6] about the origin, is taken with forces and torques of the same size:
    a metric that hardly counts torques would make it too flat to be found. None where it is flat,
    or the origin on its surface.
    """
    unit = np.repeat(np.abs(points).reshape(-1, 2, 3).max(axis=(0, 2)), 3)
    if not unit.all():
        return None
    try:
        equations = ConvexHull(points / unit).equations
    except QhullError:
        return None
    normals = equations[:, :-1] / unit
    length = np.linalg.norm(normals, axis=1)
    closest = (-equations[:, -1] / length).argmin()
    offset = -equations[closest, -1] / length[closest]
    return (normals[closest] / length[closest], offset) if offset > 0 else None
