"""Settings of the objects and of their preparation."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class PrepareConfig:
    """What is computed once per object, from its mesh."""

    sdf_spacing: float = setting(0.002, "voxel size of the signed-distance grid, metres")
    sdf_margin: float = setting(0.03, "how far the grid reaches beyond the object, metres")
    sdf_max_voxels: int = setting(1_000_000, "voxels are enlarged until the grid has at most this many")
    convex_threshold: float = setting(0.05, "CoACD concavity threshold (relative)")
    convex_faces: int = setting(2000, "faces to which a mesh is decimated before its decomposition")
    surface_points: int = setting(4096, "points with normals sampled on the surface")
    stable_poses: int = setting(12, "most probable quasi-stable poses that are kept")
    density: float = setting(400.0, "kg/m^3 of the solid, where no mass is known")
    max_mass: float = setting(1.5, "kg; no object is heavier than this")


@dataclass(frozen=True)
class ObjectsConfig:
    train: list[str] = setting(
        ["household", "random:485"], "training objects, as selectors 'source', 'source:count' or 'source:name'"
    )
    test: list[str] = setting(["ycb:test"], "test objects, as selectors; never trained on")
    max_train: int = setting(0, "keep only the first so many training objects; 0 keeps all")
    prepare: PrepareConfig = setting(PrepareConfig, "preparation of each mesh")
