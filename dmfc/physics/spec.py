"""The parts of a scene as MuJoCo has them: hand on a driven palm, table, objects, sensors."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np

from dmfc.config.physics import PhysicsConfig
from dmfc.hand.description import HandDescription
from dmfc.hand.mjcf import PREFIX, hand_spec
from dmfc.objects.model import ObjectModel

TABLE = "table"
NEAREST, STRONGEST = "nearest contact", "strongest contact"
_WELD_DATA = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]
"""Anchor and relative pose at the origin, torques weighed as forces."""
_HAND_BIT, _OBJECT_BIT, _TABLE_BIT = 1, 2, 4


def scene_spec(
    hand: HandDescription,
    objects: list[ObjectModel],
    physics: PhysicsConfig,
    *,
    table_size: float | None,
    visual: bool,
) -> mujoco.MjSpec:
    """All of a scene, not compiled yet; `visual` adds full meshes and lamps."""
    spec = hand_spec(hand)
    _set_options(spec, physics)
    _drive_palm(spec, hand, physics)
    if table_size is not None:
        _add_table(spec, table_size, physics)
    for index, model in enumerate(objects):
        _add_object(spec, index, model, physics, visual=visual)
    if visual:
        _light(spec)
    _sense_contacts(spec)
    return spec


def _set_options(spec: mujoco.MjSpec, physics: PhysicsConfig) -> None:
    option = spec.option
    option.timestep = physics.timestep
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.impratio = physics.impratio
    option.noslip_iterations = physics.noslip_iterations
    # One contact per pair of convex parts instead of a patch: a quarter of the time per step, and
    # condim 4 gives the torque about the normal that a patch would.
    option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)


def _drive_palm(spec: mujoco.MjSpec, hand: HandDescription, physics: PhysicsConfig) -> None:
    """Free the palm, drag it by a mocap body, scale the finger gains."""
    for geom in spec.geoms:
        geom.friction = [physics.hand_friction, physics.torsional_friction, 0.0001]
        geom.condim = 4
        if geom.contype:
            geom.contype, geom.conaffinity = _HAND_BIT, _HAND_BIT | _OBJECT_BIT | _TABLE_BIT
    palm = spec.body(PREFIX + hand.palm)
    palm.add_freejoint(name="palm_free")
    palm.mass += physics.base_mass
    palm.pos = [0, 0, 2]
    target = spec.worldbody.add_body(name="palm_target", mocap=True, pos=[0, 0, 2])
    weld = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name1=target.name, name2=palm.name)
    weld.objtype = mujoco.mjtObj.mjOBJ_BODY
    weld.data[:11] = _WELD_DATA
    weld.solref[:] = [0.01, 1.0]
    weld.solimp[:3] = [0.95, 0.99, 0.001]
    for actuator in spec.actuators:
        gain = physics.actuator_gain or physics.gain_scale * actuator.gainprm[0]
        actuator.gainprm[0], actuator.biasprm[1] = gain, -gain
        if physics.actuator_limit:
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.forcerange = [-physics.actuator_limit, physics.actuator_limit]
    if not physics.hand_weight:
        for part in spec.bodies:
            part.gravcomp = float(part.name.startswith(PREFIX))


def _add_table(spec: mujoco.MjSpec, size: float, physics: PhysicsConfig) -> None:
    spec.worldbody.add_geom(
        name=TABLE,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[size / 2, size / 2, 0.05],
        friction=[
            physics.object_friction,
            physics.torsional_friction,
            physics.rolling_friction,
        ],
        condim=6,
        solref=[physics.contact_time, 1.0],
        contype=_TABLE_BIT,
        conaffinity=_HAND_BIT | _OBJECT_BIT,
        rgba=[0.75, 0.72, 0.68, 1],
    )


def _sense_contacts(spec: mujoco.MjSpec) -> None:
    """Two sensors over all contacts of the scene: gap of the deepest, force of the strongest."""
    kind, field = mujoco.mjtSensor.mjSENS_CONTACT, mujoco.mjtConDataField
    by_distance, by_force = 1, 2
    for name, reduce, seen in (
        (NEAREST, by_distance, field.mjCONDATA_DIST),
        (STRONGEST, by_force, field.mjCONDATA_FORCE),
    ):
        spec.add_sensor(name=name, type=kind, intprm=[1 << int(seen.value), reduce, 1])


def _light(spec: mujoco.MjSpec) -> None:
    """Lamps, a pale sky and a hand that is not black: for pictures only."""
    for position in ([0.8, -0.8, 1.6], [-1.0, 0.6, 1.4]):
        towards = -np.array(position) / np.linalg.norm(position)
        light = spec.worldbody.add_light(pos=position, dir=towards, diffuse=[0.5, 0.5, 0.5])
        light.castshadow = position[0] > 0
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[1.0, 1.0, 1.0],
        rgb2=[0.85, 0.9, 0.95],
        width=64,
        height=384,
    )
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    for material in spec.materials:
        material.rgba = [0.35, 0.38, 0.42, 1.0]


_COLOURS = [
    [0.85, 0.45, 0.2, 1],
    [0.25, 0.55, 0.8, 1],
    [0.4, 0.7, 0.35, 1],
    [0.75, 0.35, 0.6, 1],
    [0.85, 0.75, 0.3, 1],
]


def weighed(model: ObjectModel, physics: PhysicsConfig) -> ObjectModel:
    """The object with the mass that the settings give to every object, if they give one."""
    mass = physics.object_mass
    if not mass:
        return model
    return dataclasses.replace(model, mass=mass, inertia=model.inertia * mass / model.mass)


def _add_object(
    spec: mujoco.MjSpec,
    index: int,
    model: ObjectModel,
    physics: PhysicsConfig,
    *,
    visual: bool,
) -> None:
    body = spec.worldbody.add_body(name=f"object{index}", pos=[0, 0, -10 - index])
    body.add_freejoint(name=f"object{index}_free")
    body.mass = model.mass
    body.ipos = model.com
    body.fullinertia = model.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    body.explicitinertial = True
    for part, vertices in enumerate(model.convex_parts):
        mesh = spec.add_mesh(name=f"object{index}_part{part}", uservert=vertices.ravel())
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh.name,
            friction=[physics.object_friction, physics.torsional_friction, 0.0001],
            condim=4,
            contype=_OBJECT_BIT,
            conaffinity=_HAND_BIT | _OBJECT_BIT | _TABLE_BIT,
            solref=[physics.contact_time, 1.0],
            group=3,
        )
    if visual:
        mesh = spec.add_mesh(
            name=f"object{index}_visual",
            uservert=model.vertices.ravel(),
            userface=model.faces.ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh.name,
            contype=0,
            conaffinity=0,
            group=2,
            rgba=_COLOURS[index % len(_COLOURS)],
        )
