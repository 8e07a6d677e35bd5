"""A hand, objects and perhaps a table in one MuJoCo model, compiled once and reset by state.

The palm hangs on a free joint that a mocap body drags along by a stiff weld: that is the arm.
Nothing ties an object to anything: gravity, contacts and friction are all that act on it. (`hold`
makes one object inert in the air while labels are planned; execution never calls it.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from dmfc.config.physics import PhysicsConfig
from dmfc.hand.description import HandDescription
from dmfc.hand.mjcf import PREFIX, actuator_scale, dof_actuators
from dmfc.objects.model import ObjectModel
from dmfc.physics.spec import NEAREST, STRONGEST, TABLE, scene_spec, weighed

_STATE = mujoco.mjtState
_PHYSICS = int(_STATE.mjSTATE_FULLPHYSICS)
_COMMANDS = int(_STATE.mjSTATE_CTRL | _STATE.mjSTATE_MOCAP_POS | _STATE.mjSTATE_MOCAP_QUAT)


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
    geom_owner: np.ndarray
    """[ngeom] -2: hand, -1: table, else the object."""
    palm_body: int
    nearest: int
    """Entry of sensordata with the gap of the deepest contact."""
    strongest: slice
    """Entries of sensordata with the force of the strongest contact, in its own frame."""


@dataclass(frozen=True)
class Peaks:
    """What comes and goes between two looks: the worst of all contacts of all steps in between."""

    penetration: float
    """Deepest, metres."""
    force: float
    """Largest, N, friction included."""


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
        visual: bool = False,
    ) -> None:
        """Build and compile; `table_size` None leaves the table out, `visual` adds full meshes."""
        objects = [weighed(model, physics) for model in objects]
        spec = scene_spec(hand, objects, physics, table_size=table_size, visual=visual)
        self.hand = hand
        self.objects = objects
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        # Views of memory that stays where it is: asking for them at every step takes longer.
        self._palm_target = self.data.mocap_pos[0], self.data.mocap_quat[0]
        self._command = self.data.ctrl
        # The thread that calls is the one that steps.
        self._rollout = Rollout(nthread=0)
        self._state_size = mujoco.mj_stateSize(self.model, _PHYSICS)
        self.index = _indices(self.model, spec, hand, len(objects))
        self.actuator_scale = actuator_scale(spec, hand)
        limited = self.model.actuator_forcelimited[self.index.actuator].astype(bool)
        limits = self.model.actuator_forcerange[self.index.actuator]
        self.torque_range = np.where(limited[:, None], limits, [-np.inf, np.inf]).T
        """Least and largest torque [2, D] of the actuators, N m."""
        self.dof_range = self.model.jnt_range[
            [self.model.joint(PREFIX + name).id for name in hand.dofs]
        ]

    # ── state ────────────────────────────────────────────────────────────────────────────────

    def reset(self) -> None:
        """Back to the model's own initial state; the hand waits far above, nothing is held."""
        mujoco.mj_resetData(self.model, self.data)
        for which in range(len(self.objects)):
            self.hold(which, 0.0)

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
        position, quaternion = self._palm_target
        position[:], quaternion[:] = pose[:3], pose[3:]

    def drive_joints(self, joints: np.ndarray) -> None:
        """Command joint angles [D]; the actuators' own ranges and torque limits apply."""
        self._command[self.index.actuator] = joints * self.actuator_scale

    def hold(self, which: int, inertia: float) -> None:
        """Make an object too inert to be moved by fingers (labels only); 0 lets it go, at rest.

        `inertia`, kg and kg m^2, is added to its own. It has no weight.
        """
        first = self.index.object_qvel[which]
        self.model.dof_armature[first : first + 6] = inertia
        self.data.qvel[first : first + 6] = 0.0

    def commands(self, poses: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """[n, C] for `play`, of palm poses [n, 7] (x y z qw qx qy qz) and joint angles [n, D]."""
        commands = np.zeros((len(poses), self.model.nu + 7))
        commands[:, self.index.actuator] = joints * self.actuator_scale
        commands[:, self.model.nu :] = poses
        return commands

    def play(self, commands: np.ndarray) -> Peaks:
        """A step per row of `commands` [n, C].

        The same as `drive_palm`, `drive_joints` and `mj_step` n times, but in MuJoCo's own loop
        in place of Python's, and it stops at the first warning (see `diverged`).
        """
        model, data = self.model, self.data
        state = np.empty((1, self._state_size))
        mujoco.mj_getState(model, data, state[0], _PHYSICS)
        sensed = np.empty((1, len(commands), model.nsensordata))
        self._rollout.rollout(
            [model],
            [data],
            state,
            commands[None],
            control_spec=_COMMANDS,
            skip_checks=True,
            nstep=len(commands),
            initial_warmstart=data.qacc_warmstart[None].copy(),
            sensordata=sensed,
        )
        force = sensed[0, :, self.index.strongest]
        return Peaks(
            penetration=max(0.0, -float(sensed[0, :, self.index.nearest].min())),
            force=math.sqrt(np.square(force).sum(axis=1).max()),
        )

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
        """Whether the state is no longer finite, or MuJoCo has had to reset it or to leave
        contacts out."""
        return bool(self.data.warning.number.any()) or not math.isfinite(self.data.qpos.sum())


def pose_to_qpos(T: np.ndarray) -> np.ndarray:
    """[4, 4] -> [7] x y z qw qx qy qz."""
    out = np.empty(7)
    out[:3] = T[:3, 3]
    mujoco.mju_mat2Quat(out[3:], np.ascontiguousarray(T[:3, :3], dtype=np.float64).ravel())
    return out


def qpos_to_pose(qpos: np.ndarray) -> np.ndarray:
    """[7] x y z qw qx qy qz -> [4, 4]."""
    T = np.zeros((4, 4))
    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, qpos[3:])
    T[:3, :3] = flat.reshape(3, 3)
    T[:3, 3] = qpos[:3]
    T[3, 3] = 1.0
    return T


def _indices(
    model: mujoco.MjModel, spec: mujoco.MjSpec, hand: HandDescription, count: int
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
    strongest = int(model.sensor(STRONGEST).adr[0])
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
        geom_owner=owner,
        palm_body=model.body(PREFIX + hand.palm).id,
        nearest=int(model.sensor(NEAREST).adr[0]),
        strongest=slice(strongest, strongest + 3),
    )
