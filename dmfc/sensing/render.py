"""Depth images with object ids, by one of two renderers behind one function.

`embree` casts rays at the meshes and needs no graphics; `mujoco` draws them with OpenGL. `auto`
takes Embree wherever it can be imported: it is as fast, gives the same bytes on every machine,
knows the triangle of every pixel, and cannot hang as concurrent EGL contexts can. So MuJoCo's
renderer is the fallback, and the independent check of the other one.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dmfc.errors import DmfcError, unknown_name
from dmfc.objects.model import ObjectModel
from dmfc.sensing.cameras import Camera

TABLE, NOTHING = -1, -2
"""Values of `CameraView.object_index` where there is no object."""


@dataclass(frozen=True)
class CameraView:
    """What one camera sees."""

    depth: np.ndarray
    """[H, W] float32 along the camera's z axis, metres; 0 where there is nothing."""
    object_index: np.ndarray
    """[H, W] int16: index of the object in the scene, or TABLE, or NOTHING."""
    face: np.ndarray | None
    """[H, W] int32: triangle of the object that was hit (-1: none); None if it is not known."""


class Renderer(Protocol):
    """Renders scenes; keeps what can be kept from one scene to the next."""

    name: str

    def render(
        self,
        cameras: Sequence[Camera],
        objects: Sequence[ObjectModel],
        T_world_object: np.ndarray,
        table_size: float,
    ) -> list[CameraView]:
        """One view per camera of objects at T_world_object [k, 4, 4] on a square table, z = 0."""

    def close(self) -> None:
        """Release graphics resources."""


_MODULES = {"embree": "dmfc.sensing.embree", "mujoco": "dmfc.sensing.opengl"}


def available_renderers() -> dict[str, str]:
    """Renderer -> why it does not work here (empty: it works), in the order that 'auto' tries."""
    return {name: _probe(name) for name in _MODULES}


def open_renderer(name: str = "auto") -> Renderer:
    """A renderer by name ('embree', 'mujoco'), or the first that works ('auto').

    Raises DmfcError for an unknown name and if it does not work on this machine.
    """
    if name not in ("auto", *_MODULES):
        raise unknown_name("renderer", name, ["auto", *_MODULES])
    reasons = {}
    for choice in _MODULES if name == "auto" else [name]:
        reasons[choice] = _probe(choice)
        if not reasons[choice]:
            return importlib.import_module(_MODULES[choice]).create()
    causes = "; ".join(f"{choice}: {reason}" for choice, reason in reasons.items())
    raise DmfcError(f"no depth renderer works here: {causes} (setting scenes.cameras.renderer)")


def table_view(camera: Camera, table_size: float) -> CameraView:
    """The empty square table as a camera sees it, in closed form."""
    rows, columns = np.indices((camera.height, camera.width)).reshape(2, -1)
    rays = camera.rays(rows, columns)
    depth = -camera.position[2] / np.minimum(rays[:, 2], -1e-9)
    places = camera.position[:2] + depth[:, None] * rays[:, :2]
    is_table = (np.abs(places) <= table_size / 2).all(1) & (rays[:, 2] < 0)
    shape = (camera.height, camera.width)
    return CameraView(
        np.where(is_table, depth, 0).reshape(shape).astype(np.float32),
        np.where(is_table, TABLE, NOTHING).reshape(shape).astype(np.int16),
        None,
    )


def _probe(name: str) -> str:
    """Why a renderer does not work, in one line; empty if it does."""
    try:
        return importlib.import_module(_MODULES[name]).probe()
    except (ImportError, OSError) as error:
        return f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"
