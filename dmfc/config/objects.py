"""Settings of the objects and of their preparation."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class PrepareConfig:
    """What is computed once per object, from its mesh."""

    sdf_spacing: float = setting(
        0.0014, "voxel size of the signed-distance grid, metres; trilinear error is up to 0.7 of it"
    )
    sdf_margin: float = setting(0.021, "how far the grid reaches beyond the object, metres")
    sdf_max_voxels: int = setting(
        4_500_000, "voxels are enlarged until the grid has at most this many"
    )
    convex_threshold: float = setting(0.003, "CoACD concavity threshold, metres")
    convex_threshold_full: float = setting(
        0.006, "the same for objects that fill 80 % of their hull: rims and dents, no cavities"
    )
    convex_max_parts: int = setting(32, "most convex parts of one object")
    convex_single: float = setting(
        0.97, "a mesh that fills this share of its convex hull is one convex part"
    )
    convex_vertices: int = setting(96, "most vertices of one convex part")
    convex_iterations: int = setting(30, "CoACD tree search iterations per cut")
    convex_resolution: int = setting(800, "CoACD surface samples per part")
    surface_points: int = setting(4096, "points with normals sampled on the surface")
    stable_poses: int = setting(6, "most probable quasi-stable poses that are kept")
    density: float = setting(400.0, "kg/m^3 of the solid, where no mass is known")
    max_mass: float = setting(1.5, "kg; no object without a known mass is heavier than this")


@dataclass(frozen=True)
class ObjectsConfig:
    train: list[str] = setting(
        ["household", "random:485"],
        "training objects, as selectors 'source', 'source:count', 'source:name'",
    )
    test: list[str] = setting(["ycb:test"], "test objects, as selectors; never trained on")
    max_train: int = setting(0, "keep only the first so many training objects; 0 keeps all")
    prepare: PrepareConfig = setting(PrepareConfig, "preparation of each mesh")
