"""The hand in MuJoCo: its MJCF cut at the palm, with the couplings of the description.

Gravity, masses, actuator limits and contact geometry stay those of the file; `max_torque` of the
description limits actuators that it leaves without.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from dmfc.assets import pull
from dmfc.errors import DmfcError, one_line
from dmfc.hand.description import HandDescription, load_description

PREFIX = "hand/"
"""Every name of the hand in MuJoCo begins with this."""

__all__ = ["hand_path", "hand_spec", "load_description"]


def hand_path(description: HandDescription) -> Path:
    """The MJCF file of a hand; pulls its asset pack if it is not cached."""
    folder = pull(description.pack) if description.pack else Path(description.directory)
    path = folder / description.mjcf
    if not path.is_file():
        raise DmfcError(f"hand '{description.name}': no MJCF file {path} (key mjcf)")
    return path


def hand_spec(description: HandDescription) -> mujoco.MjSpec:
    """The hand alone: its palm body is the one child of the world, at the origin, without a joint.

    All names carry `PREFIX`. `dof_actuators` names the actuators in the order of the degrees of
    freedom; one that drives a coupled pair by a tendon is commanded the sum of both angles, that is
    `actuator_scale` times the angle of the driven joint.
    Raises DmfcError if the file is not MJCF or does not have what the description names.
    """
    path = hand_path(description)
    try:
        source = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise DmfcError(f"hand '{description.name}': {path}: {one_line(error)}") from error
    palm = source.body(description.palm)
    if palm is None:
        raise DmfcError(f"hand '{description.name}': no body '{description.palm}' (key palm)")
    for joint in list(palm.joints):
        source.delete(joint)
    for number, actuator in enumerate(source.actuators):
        actuator.name = actuator.name or f"actuator-{number}"  # they are looked up by name
    spec = mujoco.MjSpec()
    for option in ("impratio", "integrator", "cone"):  # MuJoCo warns where they differ
        setattr(spec.option, option, getattr(source.option, option))
    root = spec.worldbody.add_frame().attach_body(palm, PREFIX, "")
    root.pos, root.quat = [0, 0, 0], [1, 0, 0, 0]
    _couple(spec, description)
    for actuator in spec.actuators:
        if description.max_torque > 0 and not np.any(actuator.forcerange):
            actuator.forcerange = [-description.max_torque, description.max_torque]
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
    return spec


def hand_model(description: HandDescription) -> mujoco.MjModel:
    """The hand alone, compiled. Raises DmfcError as `hand_spec`, and if MuJoCo refuses it."""
    try:
        return hand_spec(description).compile()
    except ValueError as error:
        raise DmfcError(f"hand '{description.name}': {one_line(error)} (key mjcf)") from error


def actuator_scale(spec: mujoco.MjSpec, description: HandDescription) -> np.ndarray:
    """Command of a degree of freedom's actuator = scale * its angle, [D] (see `hand_spec`)."""
    scale = []
    for dof, name in zip(description.dofs, dof_actuators(spec, description), strict=True):
        ratios = {joint: c.ratio for joint, c in description.couplings.items() if c.driver == dof}
        shares = _driven(spec, spec.actuator(name))
        scale.append(sum(share * (ratios | {dof: 1.0})[j] for j, share in shares.items()))
    return np.array(scale)


def _couple(spec: mujoco.MjSpec, description: HandDescription) -> None:
    """Tie every joint without a degree of freedom to the one that drives it."""
    joints = {joint.name.removeprefix(PREFIX) for joint in spec.joints}
    known = {*description.dofs, *description.couplings}
    if joints != known:
        wrong = sorted(joints ^ known)[0]
        where = "not in the MJCF" if wrong in known else "neither in dofs nor in couplings"
        raise DmfcError(f"hand '{description.name}': joint '{wrong}' is {where}")
    for joint, coupling in description.couplings.items():
        if coupling.driver not in description.dofs:
            raise DmfcError(
                f"hand '{description.name}': '{coupling.driver}' has no DoF (couplings)"
            )
        equality = spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT, name1=PREFIX + joint, name2=PREFIX + coupling.driver
        )
        equality.objtype = mujoco.mjtObj.mjOBJ_JOINT
        equality.data[:5] = [0.0, coupling.ratio, 0.0, 0.0, 0.0]
        equality.solref[:] = [0.005, 1.0]


def dof_actuators(spec: mujoco.MjSpec, description: HandDescription) -> list[str]:
    """Names of the actuators that drive the degrees of freedom, in their order, [D].

    Raises DmfcError if one has none, or one that is commanded anything but an angle.
    """
    driven: dict[str, str] = {}
    for actuator in spec.actuators:
        driven |= dict.fromkeys(_driven(spec, actuator), actuator.name)
    missing = [name for name in description.dofs if name not in driven]
    if missing:
        raise DmfcError(f"hand '{description.name}': no actuator drives '{missing[0]}' (key dofs)")
    names = [driven[name] for name in description.dofs]
    for name in names:
        actuator = spec.actuator(name)
        if actuator.biasprm[1] != -actuator.gainprm[0]:
            raise DmfcError(f"hand '{description.name}': actuator '{name}' is not a position servo")
    return names


def _driven(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> dict[str, float]:
    """Joints that an actuator drives -> how much of their angle its length counts."""
    if actuator.trntype != mujoco.mjtTrn.mjTRN_TENDON:
        return {actuator.target.removeprefix(PREFIX): 1.0}
    path = spec.tendon(actuator.target).path
    return {wrap.target.name.removeprefix(PREFIX): float(wrap.coef) for wrap in path}
