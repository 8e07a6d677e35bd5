"""What a page shows, as arrays: a cloud, the field of its grasps, the hand, objects, a trial.

All of one view lies in one frame: that of the cloud, or the world of a scene. Metres, radians.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import fast_simplification
import numpy as np
import torch

from dmfc.execution.candidates import GraspCandidates
from dmfc.geometry.transforms import transform
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from dmfc.prediction.planner import upright
from dmfc.prediction.ranked import RankedGrasps
from dmfc.scenes.scene_set import Scene
from dmfc.visualization.glyph import palm_glyphs

FAR = 100.0
"""m: a cloud farther from its origin is shown about its middle, for a page has float32 numbers."""
POINTS = 20_000
"""Points of a larger cloud that are shown, picked evenly."""
LINK_FACES, OBJECT_FACES = 2500, 6000
"""Triangles that are kept of a link's mesh, and of an object's."""
STEM = 0.03
"""m of a glyph from the palm's centre towards the wrist: the whole way would hide the objects."""


@dataclass(frozen=True)
class Mesh:
    """Triangles in a frame of their own."""

    name: str
    vertices: np.ndarray
    """[V, 3]."""
    faces: np.ndarray
    """[F, 3] integers."""

    @classmethod
    def thinned(cls, name: str, vertices: np.ndarray, faces: np.ndarray, most: int) -> Mesh:
        """At most about `most` of the triangles, by merging edges where it shows least."""
        if len(faces) > most:
            vertices, faces = fast_simplification.simplify(
                np.ascontiguousarray(vertices, dtype=np.float32),
                np.ascontiguousarray(faces, dtype=np.int32),
                target_count=most,
            )
        return cls(name, vertices, faces)


@dataclass(frozen=True)
class GraspField:
    """G grasps, the most confident first."""

    glyphs: np.ndarray
    """[G, 3, 3] a polyline each (`dmfc.visualization.glyph`), wrist within `STEM` of its centre."""
    confidence: np.ndarray
    """[G]."""
    T_world_link: np.ndarray
    """[G, L, 4, 4] of the hand's links."""


@dataclass(frozen=True)
class Motion:
    """A trial at F looks."""

    name: str
    outcome: str
    """'held', or why not."""
    seconds: np.ndarray
    """[F] since the hand began to move."""
    phase: list[str]
    """[F]."""
    T_world_link: np.ndarray
    """[F, L, 4, 4]."""
    T_world_object: np.ndarray
    """[F, K, 4, 4]."""


@dataclass(frozen=True)
class View:
    """Everything on a page."""

    title: str
    subtitle: str
    points: np.ndarray
    """[N, 3]."""
    grasps: GraspField
    hand: list[Mesh]
    """[L] the links, each in its own frame."""
    R_view_world: np.ndarray
    """[3, 3] makes upwards the z axis."""
    floor: float
    """Height of the table along z of the turned frame."""
    point_object: np.ndarray | None = None
    """[N] index into `object_names` of the object that a point is of."""
    object_names: list[str] = field(default_factory=list)
    objects: list[Mesh] = field(default_factory=list)
    """[K] meshes in their own frames, or none where they are not known."""
    T_world_object: np.ndarray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """[K, 4, 4]."""
    selected: int | None = None
    """Grasp whose hand is shown at first."""
    motion: Motion | None = None


def cloud_view(
    points: np.ndarray,
    grasps: RankedGrasps,
    hand: HandModel,
    title: str,
    up: tuple[float, ...] = (0.0, 0.0, 1.0),
) -> View:
    """A cloud [N, 3] with what a model predicts for it; the table is where its lowest point is."""
    R_view_world = upright(up)
    subtitle = f"points: {len(points):,}; grasps: {len(grasps)}, by {grasps.model}"
    T_cloud_palm = grasps.T_cloud_palm
    if np.abs(points).max() > FAR:
        origin = np.round(points.mean(0))
        subtitle += "; coordinates from ({:.0f}, {:.0f}, {:.0f}) m".format(*origin)
        points = points - origin
        T_cloud_palm = transform(T_cloud_palm[:, :3, :3], T_cloud_palm[:, :3, 3] - origin)
    shown = points[:: -(-len(points) // POINTS)]
    return View(
        title=title,
        subtitle=subtitle,
        points=shown,
        grasps=grasp_field(T_cloud_palm, grasps.joints, grasps.confidence, hand),
        hand=hand_meshes(hand),
        R_view_world=R_view_world,
        floor=float((points @ R_view_world[2]).min()),
        selected=0 if len(grasps) else None,
    )


def scene_view(
    scene: Scene,
    objects: list[ObjectModel],
    grasps: GraspCandidates,
    hand: HandModel,
    title: str,
    selected: int = 0,
    motion: Motion | None = None,
) -> View:
    """A scene with the meshes of its `objects` and the grasps that are proposed in it.

    `selected`: row of `grasps` whose hand is shown at first.
    """
    order = np.argsort(-grasps.confidence, kind="stable")
    ranked = grasps[order]
    T_world_palm = transform(ranked.rotation, ranked.position)
    return View(
        title=title,
        subtitle=f"objects: {len(scene.object_ids)}; points: {len(scene.points):,}; "
        f"grasps: {len(grasps)}",
        points=scene.points,
        grasps=grasp_field(T_world_palm, ranked.joints, ranked.confidence, hand),
        hand=hand_meshes(hand),
        R_view_world=np.eye(3),
        floor=0.0,
        point_object=scene.point_object,
        object_names=scene.object_ids,
        objects=[Mesh.thinned(o.id, o.vertices, o.faces, OBJECT_FACES) for o in objects],
        T_world_object=scene.T_world_object,
        selected=int(np.flatnonzero(order == selected)[0]) if len(grasps) else None,
        motion=motion,
    )


def grasp_field(
    T_world_palm: np.ndarray, joints: np.ndarray, confidence: np.ndarray, hand: HandModel
) -> GraspField:
    """Of G palm poses [G, 4, 4] with joints [G, D] and confidences [G]."""
    glyphs = palm_glyphs(T_world_palm, hand.palm_reference, hand.palm_normal)
    stem = glyphs[:, 0] - glyphs[:, 1]
    length = np.linalg.norm(stem, axis=1, keepdims=True)
    glyphs[:, 0] = glyphs[:, 1] + stem * np.minimum(1.0, STEM / np.maximum(length, 1e-9))
    return GraspField(glyphs, confidence, link_poses(T_world_palm, joints, hand))


def link_poses(T_world_palm: np.ndarray, joints: np.ndarray, hand: HandModel) -> np.ndarray:
    """T_world_link [n, L, 4, 4] of palm poses [n, 4, 4] and joints [n, D]."""
    if not len(joints):
        return np.zeros((0, hand.links, 4, 4))
    kinematics = HandKinematics(hand)
    return kinematics.links(torch.as_tensor(T_world_palm), torch.as_tensor(joints)).numpy()


def hand_meshes(hand: HandModel) -> list[Mesh]:
    """The visual meshes of the links, thinned."""
    parts = zip(hand.link_names, hand.link_vertices, hand.link_faces, strict=True)
    return [Mesh.thinned(name, vertices, faces, LINK_FACES) for name, vertices, faces in parts]
