"""A hand as data: which MJCF, which body is the palm, which joints are degrees of freedom.

Everything that is particular to one hand stands in a YAML file of `dmfc/hand/data` (or of the
user's own); no other module knows a joint or a link by name.
"""

from __future__ import annotations

import hashlib
import io
import math
import re
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import MISSING, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from dmfc.config.interpolation import refuse_interpolation
from dmfc.errors import DmfcError, first_line, one_line, unknown_name


@dataclass(frozen=True)
class Coupling:
    """A joint that follows another: angle = ratio * angle of the driver."""

    driver: str = MISSING
    ratio: float = 1.0


@dataclass(frozen=True)
class HandDescription:
    """What the rest of the project must know about a hand. Palm frame: the MJCF palm body's."""

    name: str = MISSING
    pack: str = ""
    """Asset pack that holds the MJCF; empty: `mjcf` is a path, relative to this YAML file."""
    mjcf: str = MISSING
    palm: str = MISSING
    """Body of the MJCF that becomes the root; what it is mounted on is left out."""
    dofs: dict[str, float] = field(default_factory=dict)
    """Joint that drives each degree of freedom -> its angle when the hand is open, rad."""
    couplings: dict[str, Coupling] = field(default_factory=dict)
    """Joint without a degree of freedom -> the one that drives it."""
    flexion: dict[str, float] = field(default_factory=dict)
    """Joint that closes the hand -> sign of closing times its share of the closing motion."""
    max_torque: float = 0.0
    """N m of an actuator to which the MJCF sets no limit; 0: it has none."""
    palm_reference: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of the palm's inner surface, palm frame, metres."""
    palm_normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Direction out of the inside of the palm, palm frame, unit length."""
    preshape: dict[str, list[float]] = field(default_factory=dict)
    """Joint -> range from which the planner draws its angle before closing; others stay open."""
    inner_points: dict[str, Any] = field(default_factory=dict)
    """Per link: where the inner points lie (see `dmfc.hand.build`)."""
    directory: str = ""
    """Folder of the YAML file this was read from (filled in by `load_description`)."""

    @property
    def dof_names(self) -> list[str]:
        return list(self.dofs)

    @property
    def open_joints(self) -> np.ndarray:
        """Angles of the open hand, [D] rad."""
        return np.array(list(self.dofs.values()))

    @property
    def flexion_direction(self) -> np.ndarray:
        """Direction in joint space that closes the hand, [D]; zero where a joint only orients."""
        return np.array([self.flexion.get(name, 0.0) for name in self.dofs])

    @property
    def preshape_range(self) -> np.ndarray:
        """Ranges of the planner's pre-shapes, [D, 2] rad."""
        return np.array([self.preshape.get(name, [angle] * 2) for name, angle in self.dofs.items()])


def load_description(name: str) -> HandDescription:
    """Read a hand description: a name among `dmfc/hand/data/*.yaml`, or the path of a YAML file.

    Raises DmfcError if there is none, or if it has an unknown key, a value of a wrong type or the
    name of a joint that is no degree of freedom.
    """
    data = Path(str(resources.files("dmfc.hand") / "data"))
    path = Path(name).expanduser() if name.endswith((".yaml", ".yml")) else data / f"{name}.yaml"
    if not path.is_file():
        if path.parent == data:
            raise unknown_name("hand", name, [p.stem for p in data.glob("*.yaml")])
        raise DmfcError(f"hand description '{name}' is not a file (setting hand.name)")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DmfcError(f"hand description {path}: {error}") from error
    return _read(path, text)


def custom_hand_digest(name: str) -> str:
    """SHA-256 of a user's YAML file, its MJCF and the files that this names; '' for a shipped hand.

    Of a description that uses an asset pack, the YAML file alone: packs are pinned.
    """
    if not name.endswith((".yaml", ".yml")):
        return ""
    description = load_description(name)
    files = [Path(name).expanduser()]
    if not description.pack:
        files += _mjcf_files(Path(description.directory) / description.mjcf)
    digests = [hashlib.sha256(path.read_bytes()).digest() for path in files]
    return hashlib.sha256(b"".join(digests)).hexdigest()


def _mjcf_files(mjcf: Path) -> list[Path]:
    """An MJCF file and those that it includes or takes meshes from, as far as they are there."""
    found: list[Path] = []
    folders, waiting = {""}, [mjcf]
    while waiting:
        path = waiting.pop(0)
        if path in found or not path.is_file():
            continue
        found.append(path)
        if path.suffix == ".xml":
            text = path.read_text(encoding="utf-8", errors="replace")
            folders |= set(re.findall(r"""(?:mesh|asset)dir=["']([^"']*)""", text))
            names = re.findall(r"""\bfile=["']([^"']+)""", text)
            waiting += [mjcf.parent / folder / item for item in names for folder in sorted(folders)]
    return found


@lru_cache(maxsize=8)
def _read(path: Path, text: str) -> HandDescription:
    """Kept, since a worker asks for the same hand at every shard, and parsing costs more than
    compiling a scene."""
    try:
        schema = OmegaConf.structured(HandDescription)
        given = OmegaConf.load(io.StringIO(text))
        refuse_interpolation(given, f"hand description {path}")
        merged = OmegaConf.merge(schema, given, {"directory": str(path.parent)})
        description = OmegaConf.to_object(merged)
    except OmegaConfBaseException as error:
        where = f" (key {error.full_key})" if error.full_key else ""
        raise DmfcError(f"hand description {path}: {first_line(error)}{where}") from error
    except (YAMLError, TypeError, ValueError, OSError, RecursionError, AttributeError) as error:
        raise DmfcError(f"hand description {path}: {one_line(error)}") from error
    assert isinstance(description, HandDescription)
    _check(description, path)
    return description


def _check(description: HandDescription, path: Path) -> None:
    """What a schema cannot say. Raises DmfcError."""
    for key in ("name", "mjcf", "palm"):
        if not getattr(description, key):
            raise DmfcError(f"hand description {path}: {key} is missing")
    _require_finite(description, path)
    for key in ("flexion", "preshape"):
        for joint in getattr(description, key):
            if joint not in description.dofs:
                raise unknown_name(f"joint in {key} of {path}", joint, description.dofs)
    for joint, limits in description.preshape.items():
        if len(limits) != 2 or limits[0] > limits[1]:
            raise DmfcError(f"hand description {path}: preshape.{joint} is not a range: {limits}")
    for joint, coupling in description.couplings.items():
        if coupling.ratio == 0:
            raise DmfcError(f"hand description {path}: couplings.{joint}.ratio is 0")
    if description.max_torque < 0:
        raise DmfcError(f"hand description {path}: max_torque is {description.max_torque:g}")
    if not np.linalg.norm(description.palm_normal) > 0:
        raise DmfcError(f"hand description {path}: palm_normal has no direction")


def _require_finite(description: HandDescription, path: Path) -> None:
    numbers: list[tuple[str, object]] = [("max_torque", description.max_torque)]
    for key in ("palm_reference", "palm_normal"):
        numbers += [(key, value) for value in getattr(description, key)]
    for key in ("dofs", "flexion"):
        numbers += [(f"{key}.{name}", value) for name, value in getattr(description, key).items()]
    numbers += [
        (f"preshape.{name}", value) for name, ends in description.preshape.items() for value in ends
    ]
    numbers += [(f"couplings.{name}", c.ratio) for name, c in description.couplings.items()]
    for key, value in numbers:
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise DmfcError(f"hand description {path}: {key} is {value!r}, not a finite number")
