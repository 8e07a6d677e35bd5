"""Pictures of a `World`: off-screen frames, and strips of them."""

from __future__ import annotations

import mujoco
import numpy as np
from PIL import Image, ImageDraw

from dmfc.errors import DmfcError
from dmfc.physics.world import World


class Camera:
    """Renders a world that was built with `visual=True`; needs GL (EGL or OSMesa where headless).

    Which GL is used is decided by the environment variable MUJOCO_GL before mujoco is imported.
    Raises DmfcError where that one does not work.
    """

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
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except mujoco.FatalError as error:
            raise DmfcError(
                "no OpenGL for pictures: set the environment variable MUJOCO_GL to egl or osmesa "
                "where there is no display"
            ) from error
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
        self._renderer.update_scene(self.world.data, self._camera, self._options)
        return self._renderer.render()

    def close(self) -> None:
        self._renderer.close()

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
