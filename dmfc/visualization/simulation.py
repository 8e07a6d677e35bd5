"""Pictures of a `World`: off-screen frames, and strips of them."""

from __future__ import annotations

import mujoco
import numpy as np
from PIL import Image, ImageDraw

from dmfc.physics.gl import current_context
from dmfc.physics.world import World

MAX_GEOMS = 10_000
"""Shapes that a frame may have."""


class Camera:
    """Renders a world built with `visual=True`; needs GL (EGL or OSMesa without a screen)."""

    def __init__(
        self,
        world: World,
        width: int = 320,
        height: int = 320,
        *,
        look_at: tuple[float, float, float] = (0.0, 0.0, 0.12),
        distance: float = 0.75,
        azimuth: float = 130.0,
        elevation: float = -20.0,
    ) -> None:
        """look_at, distance in metres; azimuth and elevation in degrees, as MuJoCo has them."""
        self.world = world
        model = world.model
        model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(height, model.vis.global_.offheight)
        self._gl = current_context(width, height)
        self._scene = mujoco.MjvScene(model, maxgeom=MAX_GEOMS)
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._camera = mujoco.MjvCamera()
        self._camera.lookat[:] = look_at
        self._camera.distance = distance
        self._camera.azimuth, self._camera.elevation = azimuth, elevation
        self._options = mujoco.MjvOption()
        self._options.geomgroup[3] = 0

    def turn(self, azimuth: float) -> None:
        """Go round what it looks at, to `azimuth` degrees."""
        self._camera.azimuth = azimuth

    def frame(self) -> np.ndarray:
        """[height, width, 3] uint8, as the world is now."""
        world, everything = self.world, mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(
            world.model, world.data, self._options, None, self._camera, everything, self._scene
        )
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._context)
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return pixels[::-1].copy()  # OpenGL counts rows from below

    def close(self) -> None:
        self._context.free()
        self._gl.free()

    def __enter__(self) -> Camera:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def strip(frames: list[np.ndarray], labels: list[str]) -> Image.Image:
    """Frames side by side, each with its label in the corner."""
    picture = Image.fromarray(np.concatenate(frames, axis=1))
    draw = ImageDraw.Draw(picture)
    left = 0
    for frame, label in zip(frames, labels, strict=True):
        draw.text(
            (left + 6, 4), label, fill=(20, 20, 20), stroke_fill=(255, 255, 255), stroke_width=2
        )
        left += frame.shape[1]
    return picture
