"""Depth and segmentation with MuJoCo's own OpenGL renderer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from dmfc.objects.model import ObjectModel
from dmfc.physics.gl import current_context, probe
from dmfc.sensing.cameras import Camera
from dmfc.sensing.render import NOTHING, TABLE, CameraView

__all__ = ["create", "probe"]
NEAR, FAR = 0.02, 10.0
"""Clipping planes, metres."""


def create() -> MujocoRenderer:
    return MujocoRenderer()


class MujocoRenderer:
    """See `dmfc.sensing.render.Renderer`. A model is compiled per scene."""

    name = "mujoco"

    def __init__(self) -> None:
        self._gl: Any = None
        self._size = (0, 0)

    def render(
        self,
        cameras: Sequence[Camera],
        objects: Sequence[ObjectModel],
        T_world_object: np.ndarray,
        table_size: float,
    ) -> list[CameraView]:
        model = _scene_spec(cameras, objects, T_world_object, table_size).compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._make_context(cameras[0].width, cameras[0].height)
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
        context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        try:
            return [_draw(model, data, context, i, camera) for i, camera in enumerate(cameras)]
        finally:
            context.free()

    def close(self) -> None:
        if self._gl is not None:
            self._gl.free()
            self._gl = None

    def _make_context(self, width: int, height: int) -> None:
        if self._gl is not None and self._size != (width, height):
            self.close()
        if self._gl is None:
            self._gl, self._size = current_context(width, height), (width, height)
        self._gl.make_current()


def _scene_spec(
    cameras: Sequence[Camera],
    objects: Sequence[ObjectModel],
    T_world_object: np.ndarray,
    table_size: float,
) -> mujoco.MjSpec:
    """Table (geom 0) and objects (geoms 1..k) fixed in the world, with the cameras in order."""
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth = max(camera.width for camera in cameras)
    spec.visual.global_.offheight = max(camera.height for camera in cameras)
    spec.visual.quality.offsamples = 0  # blended edges would be neither depth nor id
    spec.stat.extent, spec.visual.map.znear, spec.visual.map.zfar = 1.0, NEAR, FAR
    half = table_size / 2
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[half, half, 0.01], pos=[0, 0, -0.01]
    )
    for index, model in enumerate(objects):
        mesh = spec.add_mesh(name=f"mesh{index}")
        mesh.uservert = np.asarray(model.vertices, dtype=np.float32).reshape(-1)
        mesh.userface = np.asarray(model.faces, dtype=np.int32).reshape(-1)
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # also where it is not watertight
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh.name,
            pos=T_world_object[index, :3, 3],
            quat=_quaternion(T_world_object[index, :3, :3]),
        )
    opengl = np.diag([1.0, -1.0, -1.0])  # x right, y up, z backward
    for camera in cameras:
        spec.worldbody.add_camera(
            pos=camera.position,
            quat=_quaternion(camera.T_world_camera[:3, :3] @ opengl),
            fovy=float(np.rad2deg(camera.fov_y)),
        )
    return spec


def _draw(
    model: mujoco.MjModel, data: mujoco.MjData, context: mujoco.MjrContext, number: int, cam: Camera
) -> CameraView:
    view = mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, number
    scene = mujoco.MjvScene(model, maxgeom=2 * model.ngeom + 16)
    options, perturb = mujoco.MjvOption(), mujoco.MjvPerturb()
    everything = mujoco.mjtCatBit.mjCAT_ALL
    mujoco.mjv_updateScene(model, data, options, perturb, view, everything, scene)
    scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = 1
    scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
    rect = mujoco.MjrRect(0, 0, cam.width, cam.height)
    mujoco.mjr_render(rect, scene, context)
    colour = np.zeros((cam.height, cam.width, 3), np.uint8)
    raw = np.zeros((cam.height, cam.width), np.float32)
    mujoco.mjr_readPixels(colour, raw, rect, context)
    colour, raw = colour[::-1].astype(np.int32), raw[::-1].astype(np.float64)
    geoms = np.array([-1] + [geom.objid for geom in scene.geoms[: scene.ngeom]])
    segment = colour[..., 0] + 256 * colour[..., 1] + 65536 * colour[..., 2]
    geom = geoms[segment]
    # reversed z buffer: raw = 1 at the near plane, 0 at the far one, linear in 1/depth
    depth = NEAR * FAR / (NEAR + raw * (FAR - NEAR))
    index = np.where(geom < 0, NOTHING, np.where(geom == 0, TABLE, geom - 1))
    depth = np.where(geom < 0, 0, depth)
    return CameraView(depth.astype(np.float32), index.astype(np.int16), None)


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """wxyz [4] of a rotation matrix [3, 3]."""
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).reshape(-1))
    return quaternion
