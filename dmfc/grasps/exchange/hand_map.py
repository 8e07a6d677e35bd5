"""How the hand of another project maps to ours: its root's frame, and its joints.

Such a map is data, a YAML file of `dmfc/grasps/exchange/data` or of the user.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

import numpy as np
from omegaconf import MISSING, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from scipy.spatial.transform import Rotation
from yaml import YAMLError

from dmfc.config.interpolation import refuse_interpolation
from dmfc.errors import DmfcError, first_line, one_line, unknown_name
from dmfc.geometry.transforms import transform
from dmfc.grasps.exchange.foreign import numbers, pose
from dmfc.hand.description import HandDescription


@dataclass(frozen=True)
class JointMap:
    """A joint of their hand: our angle = sign * theirs."""

    joint: str = MISSING
    """Joint of our MJCF: one that drives a degree of freedom, or is coupled to one."""
    sign: float = 1.0


@dataclass(frozen=True)
class HandMap:
    """Their hand in terms of ours."""

    hand: str = MISSING
    """Name of our hand."""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Origin of our palm frame in the frame of their root, metres."""
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """R_root_palm as a quaternion w x y z."""
    joints: dict[str, JointMap] = field(default_factory=dict)
    """Their joints by name, in the order in which they stand in a file."""

    @property
    def T_root_palm(self) -> np.ndarray:
        """[4, 4]."""
        rotation = Rotation.from_quat(np.array(self.rotation), scalar_first=True).as_matrix()
        return transform(rotation, np.array(self.position))

    def matrix(self, description: HandDescription) -> np.ndarray:
        """[J, D]: their angles [J] = matrix @ degrees of freedom [D] of our hand.

        Raises DmfcError if this is a map of another hand, or leaves a degree of freedom out.
        """
        if self.hand != description.name:
            raise DmfcError(
                f"this format has grasps of the hand '{self.hand}', not of '{description.name}' "
                "(setting hand.name, option --hand-map)"
            )
        names = description.dof_names
        matrix = np.zeros((len(self.joints), len(names)))
        for row, (theirs, entry) in enumerate(self.joints.items()):
            coupling = description.couplings.get(entry.joint)
            driver, ratio = (coupling.driver, coupling.ratio) if coupling else (entry.joint, 1.0)
            if driver not in names:
                raise unknown_name(f"joint of joints.{theirs}", entry.joint, names)
            matrix[row, names.index(driver)] = ratio * entry.sign
        missing = np.flatnonzero(~np.abs(matrix).max(axis=0, initial=0.0).astype(bool))
        if len(missing):
            raise DmfcError(
                f"hand map of '{self.hand}': no joint turns {names[missing[0]]} (key joints)"
            )
        return matrix


def load_hand_map(name: str) -> HandMap:
    """Read a map: the name of a format, or the path of a YAML file. Raises DmfcError."""
    folder = Path(str(resources.files("dmfc.grasps.exchange") / "data"))
    path = Path(name).expanduser() if name.endswith((".yaml", ".yml")) else folder / f"{name}.yaml"
    if not path.is_file():
        if path.parent == folder:
            raise unknown_name("format", name, [p.stem for p in folder.glob("*.yaml")])
        raise DmfcError(f"hand map '{name}' is not a file (option --hand-map)")
    try:
        given = OmegaConf.load(io.StringIO(path.read_text(encoding="utf-8")))
        refuse_interpolation(given, f"hand map {path}")
        found = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(HandMap), given))
    except OmegaConfBaseException as error:
        where = f" (key {error.full_key})" if error.full_key else ""
        raise DmfcError(f"hand map {path}: {first_line(error)}{where}") from error
    except (
        *(YAMLError, TypeError, ValueError, OSError, RecursionError),
        *(AttributeError, AssertionError),
    ) as error:
        raise DmfcError(f"hand map {path}: {one_line(error)}") from error
    assert isinstance(found, HandMap)
    numbers(found.position, 3, f"hand map {path}", "position")
    rotation = numbers(found.rotation, 4, f"hand map {path}", "rotation")
    pose(np.zeros(3), rotation, f"hand map {path}", "rotation")
    for name, entry in found.joints.items():
        if entry.sign == 0 or not math.isfinite(entry.sign):
            raise DmfcError(f"hand map {path}: joints.{name}.sign is {entry.sign}")
    return found
