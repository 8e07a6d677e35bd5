"""What is recorded of a trial, and the closed vocabulary of why it failed."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

REASONS = (
    "no candidate",
    "plan: table",
    "plan: object",
    "knocked away",
    "no lift",
    "dropped in lift",
    "dropped in hold",
    "diverged",
)
"""Why a trial failed; a trial that held has the empty reason."""

PHASES = ("raise", "descend", "approach", "close", "squeeze", "lift", "hold")


@dataclass
class Outcome:
    """One trial; lengths in metres, angles in rad, forces in N, times in simulated seconds.

    Peaks marked (step) are taken after every step, the others at every look (0.1 s).
    """

    planned: bool = False
    held: bool = False
    reason: str = "no candidate"
    phase: str = ""
    """Phase in which the trial ended."""
    plan_depth: float = 0.0
    """Deepest penetration of the hand that the planning met, until it gave up."""
    touched_early: bool = False
    """The hand touched something before the approach, on the way that no plan checks."""
    pushed: float = 0.0
    """How far the object's centre moved in the world until the lift."""
    contacts: int = 0
    """Links of the hand that touched the object before the lift."""
    q1: float = 0.0
    """Upper bound of Q1 of the simulated contacts with the object before the lift."""
    lift_slip: float = 0.0
    """Farthest that the object's centre moved in the palm's frame during the lift."""
    lift_turn: float = 0.0
    """Farthest that the object turned in the palm's frame during the lift."""
    hold_slip: float = 0.0
    """As `lift_slip`, from the beginning of the hold."""
    hold_turn: float = 0.0
    """As `lift_turn`, from the beginning of the hold."""
    neighbour_moved: float = 0.0
    """Farthest that the centre of another object of the scene moved."""
    hand_penetration: float = 0.0
    """Deepest penetration of the hand and any object."""
    self_penetration: float = 0.0
    """Deepest penetration of the hand and itself."""
    contact_penetration: float = 0.0
    """Deepest penetration of any contact of the scene (step)."""
    contact_force: float = 0.0
    """Largest force of any contact of the scene, friction included (step)."""
    kinetic_speed: float = 0.0
    """Largest sqrt(2 E / m) of any object, E its kinetic energy, m/s."""
    saturation: float = 0.0
    """Share of actuators at their torque limit, mean over the looks from the closing on."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Phase -> time spent in it."""

    def row(self) -> dict[str, Any]:
        """The columns of a trial table; a column of seconds per phase."""
        columns = asdict(self)
        spent = columns.pop("seconds")
        return columns | {f"seconds_{phase}": spent.get(phase, 0.0) for phase in PHASES}
