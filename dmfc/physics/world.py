"""A hand, objects and perhaps a table in one MuJoCo model, compiled once and reset by state.

The palm hangs on a free joint that a mocap body drags along by a stiff weld: that is the arm.
Nothing ties an object to anything: gravity, contacts and friction are all that act on it. (`hold`
pins one object in the air while labels are planned; execution never calls it.)
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from dmfc.config.physics import PhysicsConfig
from dmfc.hand.description import HandDescription
from dmfc.hand.mjcf import PREFIX, actuator_scale, dof_actuators, hand_spec
from dmfc.objects.model import ObjectModel

TABLE = "table"
_WELD_DATA = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]
"""Anchor and relative pose at the origin, torques weighed as forces."""
_HAND_BIT, _OBJECT_BIT, _TABLE_BIT = 1, 2, 4


@dataclass(frozen=True)
class Indices:
    """Where things stand in the arrays of the compiled model."""

    palm_qpos: int
    """First of the palm's 7 entries of qpos: x y z qw qx qy qz."""
    palm_qvel: int
    dof_qpos: np.ndarray
    """[D] entry of qpos of each degree of freedom."""
    follower_qpos: np.ndarray
    """[C] entry of qpos of each coupled joint."""
    follower_of: np.ndarray
    """[C] degree of freedom that drives it."""
    follower_ratio: np.ndarray
    actuator: np.ndarray
    """[D] actuator of each degree of freedom."""
    object_qpos: np.ndarray
    """[K] first of 7 entries of qpos per object."""
    object_qvel: np.ndarray
    """[K] first of 6 entries of qvel per object."""
    object_body: np.ndarray
    """[K] body of each object."""
    hold_equality: np.ndarray
    """[K] equality that pins each object; empty where `hold` was not asked for."""
    geom_owner: np.ndarray
    """[ngeom] -2: hand, -1: table, else the object."""
    palm_body: int


class World:
    """The compiled model with its data and the few operations that planning and execution need.

    Frames: world; objects by T_world_object; the hand by T_world_palm. Joint angles are [D] rad in
    the order of the hand's degrees of freedom.
    """

    def __init__(
        self,
        hand: HandDescription,
        objects: list[ObjectModel],
        physics: PhysicsConfig,
        *,
        table_size: float | None = None,
        can_hold: bool = False,
        visual: bool = False,
    ) -> None:
        """Build and compile; `table_size` None leaves the table out, `visual` adds full meshes."""
        spec = hand_spec(hand)
        _set_options(spec, physics)
        _drive_palm(spec, hand, physics)
        if table_size is not None:
            _add_table(spec, table_size, physics)
        for index, model in enumerate(objects):
            _add_object(spec, index, model, physics, can_hold=can_hold, visual=visual)
        if visual:
            _light(spec)
        self.hand = hand
        self.objects = objects
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.index = _indices(self.model, spec, hand, len(objects), can_hold)
        self.actuator_scale = actuator_scale(spec, hand)
        self.dof_range = self.model.jnt_range[
            [self.model.joint(PREFIX + name).id for name in hand.dofs]
        ]

    # ── state ────────────────────────────────────────────────────────────────────────────────

    def reset(self) -> None:
        """Back to the model's own initial state; the hand waits far above."""
        mujoco.mj_resetData(self.model, self.data)

    def place_palm(self, T_world_palm: np.ndarray, joints: np.ndarray) -> None:
        """Put the hand at a pose [4, 4] with joint angles [D], at rest, and command it to stay."""
        data, index = self.data, self.index
        pose = pose_to_qpos(T_world_palm)
        data.qpos[index.palm_qpos : index.palm_qpos + 7] = pose
        data.qpos[index.dof_qpos] = joints
        data.qpos[index.follower_qpos] = joints[index.follower_of] * index.follower_ratio
        data.qvel[: self.model.nv] = 0.0
        self.drive_palm(pose)
        self.drive_joints(joints)

    def place_object(self, which: int, T_world_object: np.ndarray) -> None:
        """Put an object at a pose [4, 4], at rest."""
        first = self.index.object_qpos[which]
        self.data.qpos[first : first + 7] = pose_to_qpos(T_world_object)
        first = self.index.object_qvel[which]
        self.data.qvel[first : first + 6] = 0.0

    def drive_palm(self, pose: np.ndarray) -> None:
        """Command the palm's pose, [7] x y z qw qx qy qz."""
        self.data.mocap_pos[0] = pose[:3]
        self.data.mocap_quat[0] = pose[3:]

    def drive_joints(self, joints: np.ndarray) -> None:
        """Command joint angles [D]; the actuators' own ranges and torque limits apply."""
        self.data.ctrl[self.index.actuator] = joints * self.actuator_scale

    def hold(self, which: int, active: bool) -> None:
        """Pin an object where it is (labels only), or let it go."""
        equality = self.index.hold_equality[which]
        if active:
            T, centre = self.object_pose(which), self.objects[which].com
            # At the centre of mass: a weld at the end of a lever is soft against turning.
            eq_data = self.model.eq_data[equality]
            eq_data[:3] = T[:3, :3] @ centre + T[:3, 3]
            eq_data[3:6] = centre
            mujoco.mju_negQuat(eq_data[6:10], pose_to_qpos(T)[3:])
        self.data.eq_active[equality] = int(active)

    # ── what is seen ─────────────────────────────────────────────────────────────────────────

    def palm_pose(self) -> np.ndarray:
        """T_world_palm [4, 4], as the last step left it."""
        first = self.index.palm_qpos
        return qpos_to_pose(self.data.qpos[first : first + 7])

    def object_pose(self, which: int) -> np.ndarray:
        """T_world_object [4, 4]."""
        first = self.index.object_qpos[which]
        return qpos_to_pose(self.data.qpos[first : first + 7])

    def joints(self) -> np.ndarray:
        """Joint angles [D] rad."""
        return self.data.qpos[self.index.dof_qpos].copy()

    def contacts(self) -> tuple[np.ndarray, np.ndarray]:
        """Owners [C, 2] (see `Indices.geom_owner`) and gaps [C] (metres, negative inside)."""
        contact = self.data.contact
        return self.index.geom_owner[contact.geom], contact.dist

    def diverged(self) -> bool:
        """Whether the state is no longer finite, or MuJoCo has had to reset it."""
        warnings = self.data.warning
        bad = mujoco.mjtWarning
        return bool(
            warnings[bad.mjWARN_BADQPOS].number
            or warnings[bad.mjWARN_BADQVEL].number
            or warnings[bad.mjWARN_BADQACC].number
            or not np.isfinite(self.data.qpos).all()
        )


def pose_to_qpos(T: np.ndarray) -> np.ndarray:
    """[4, 4] -> [7] x y z qw qx qy qz."""
    out = np.empty(7)
    out[:3] = T[:3, 3]
    mujoco.mju_mat2Quat(out[3:], np.ascontiguousarray(T[:3, :3], dtype=np.float64).ravel())
    return out


def qpos_to_pose(qpos: np.ndarray) -> np.ndarray:
    """[7] x y z qw qx qy qz -> [4, 4]."""
    T = np.eye(4)
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, np.ascontiguousarray(qpos[3:]))
    T[:3, :3] = flat.reshape(3, 3)
    T[:3, 3] = qpos[:3]
    return T


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
        actuator.gainprm[0] *= physics.gain_scale
        actuator.biasprm[1] *= physics.gain_scale


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


def _add_object(
    spec: mujoco.MjSpec,
    index: int,
    model: ObjectModel,
    physics: PhysicsConfig,
    *,
    can_hold: bool,
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
    if can_hold:
        pin = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, name1=body.name, name2="world")
        pin.objtype = mujoco.mjtObj.mjOBJ_BODY
        pin.name = f"object{index}_hold"
        pin.active = False
        pin.data[:11] = _WELD_DATA


def _indices(
    model: mujoco.MjModel, spec: mujoco.MjSpec, hand: HandDescription, count: int, can_hold: bool
) -> Indices:
    def qpos(name: str) -> int:
        return int(model.joint(name).qposadr[0])

    names = list(hand.dofs)
    owner = np.full(model.ngeom, -2)
    for geom in range(model.ngeom):
        root = model.body(model.body_rootid[model.geom_bodyid[geom]]).name
        if root.startswith("object"):
            owner[geom] = int(root.removeprefix("object"))
        elif model.geom(geom).name == TABLE:
            owner[geom] = -1
    numbers = range(count)
    return Indices(
        palm_qpos=qpos("palm_free"),
        palm_qvel=int(model.joint("palm_free").dofadr[0]),
        dof_qpos=np.array([qpos(PREFIX + name) for name in names]),
        follower_qpos=np.array([qpos(PREFIX + name) for name in hand.couplings], dtype=int),
        follower_of=np.array([names.index(c.driver) for c in hand.couplings.values()], dtype=int),
        follower_ratio=np.array([c.ratio for c in hand.couplings.values()]),
        actuator=np.array([model.actuator(name).id for name in dof_actuators(spec, hand)]),
        object_qpos=np.array([qpos(f"object{k}_free") for k in numbers], dtype=int),
        object_qvel=np.array(
            [model.joint(f"object{k}_free").dofadr[0] for k in numbers], dtype=int
        ),
        object_body=np.array([model.body(f"object{k}").id for k in numbers], dtype=int),
        hold_equality=np.array(
            [model.equality(f"object{k}_hold").id for k in numbers if can_hold], dtype=int
        ),
        geom_owner=owner,
        palm_body=model.body(PREFIX + hand.palm).id,
    )
