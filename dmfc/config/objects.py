"""Settings of the objects and of their preparation."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class PrepareConfig:
    """What is computed once per object, from its mesh."""

    sdf_spacing: float = setting(
        0.002,
        "Voxel size of the signed-distance grid. The error of trilinear interpolation is up to "
        "0.7 of it.",
        unit="m",
        least=2e-4,
        greatest=0.05,
    )
    sdf_margin: float = setting(
        0.021, "How far the grid reaches beyond the object.", unit="m", least=0.001, greatest=0.5
    )
    sdf_max_voxels: int = setting(
        4_500_000,
        "Most voxels of a grid. A larger grid gets larger voxels.",
        least=1000,
        greatest=500_000_000,
    )
    convex_threshold: float = setting(
        0.003,
        "Concavity at which CoACD stops to cut an object.",
        unit="m",
        least=1e-4,
        greatest=0.1,
    )
    convex_threshold_full: float = setting(
        0.006,
        "The same for an object that fills 80 % of its convex hull: it has rims and dents, but no "
        "cavity.",
        unit="m",
        least=1e-4,
        greatest=0.1,
    )
    convex_max_parts: int = setting(32, "Most convex parts of one object.", least=1, greatest=1000)
    convex_single: float = setting(
        0.97,
        "A mesh that fills this share of its convex hull becomes one convex part.",
        least=0,
        greatest=1,
    )
    convex_vertices: int = setting(
        96, "Most vertices of one convex part.", least=4, greatest=10_000
    )
    convex_iterations: int = setting(
        30, "Iterations of CoACD's tree search per cut.", least=1, greatest=1000
    )
    convex_resolution: int = setting(
        800, "Points that CoACD samples on each part.", least=50, greatest=100_000
    )
    surface_points: int = setting(
        4096, "Points with normals sampled on the surface.", least=128, greatest=1_000_000
    )
    stable_poses: int = setting(
        6, "Number of stable poses kept, the most probable ones.", least=1, greatest=100
    )
    density: float = setting(
        400.0,
        "Density of the solid of an object without a known mass.",
        unit="kg/m^3",
        least=1,
        greatest=25_000,
    )
    max_mass: float = setting(
        1.5,
        "Greatest mass of an object without a known mass.",
        unit="kg",
        least=0.001,
        greatest=100,
    )


@dataclass(frozen=True)
class ObjectsConfig:
    train: list[str] = setting(
        ["household", "random:485"],
        "Training objects, as selectors: 'source', 'source:count' or 'source:name'.",
    )
    test: list[str] = setting(
        ["ycb:test"], "Test objects, as selectors. A model is never trained on them."
    )
    max_train: int = setting(
        0, "Use only the first so many training objects; 0: all.", least=0, greatest=1_000_000
    )
    prepare: PrepareConfig = setting(PrepareConfig, "Preparation of each mesh.")
