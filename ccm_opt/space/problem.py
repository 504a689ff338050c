"""One planning problem of an arm that leaves the plane: what is known before a motion is sought."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_units import LengthUnit
from ccm_opt.jointed.drive_limits import Limits
from ccm_opt.jointed.link_chain import Feed
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.problem import PlannerOptions, Problem, SimulationOptions, Tolerances, VerificationOptions
from ccm_opt.problem.field_types import COMMON_NUMBERS, COMMON_PARTS, PartTypes, wrong_types
from ccm_opt.problem.options import Weights
from ccm_opt.problem.planning_problem import PlanningProblem
from ccm_opt.space.scene.scene import SpaceObstacle, SpaceWorkspace
from ccm_opt.space.space_defects import space_defects


@dataclass(frozen=True)
class SpaceJointPose:
    """A pose of the whole arm in space, given by its joints.

    Attributes:
        bends: of each joint about its local z, then about the new y, shape (links, 2) [rad].
        feed: position of the base on its feed axis [m]; 0 without one.
    """

    bends: FloatArray
    feed: float = 0.0

    @classmethod
    def from_configuration(cls, q: FloatArray, links: int) -> "SpaceJointPose":
        """The pose of a configuration, shape (c,) [rad, m]."""
        return cls(q[: 2 * links].reshape(links, 2).copy(), float(q[2 * links :].sum()))

    def configuration(self, arm: SpaceArm) -> FloatArray:
        """The pose as a configuration of an arm, shape (c,) [rad, m]."""
        return arm.configuration(self.bends, self.feed)


@dataclass(frozen=True)
class SpaceTipGoal:
    """A goal for the tip alone.

    Attributes:
        position: shape (3,) [m].
        direction: where the last link points, a unit vector of shape (3,), or None when any direction will do.
        via: places that the tip passes in this order on its way, each of shape (3,) [m].
    """

    position: FloatArray
    direction: FloatArray | None = None
    via: tuple[FloatArray, ...] = ()


SpaceGoal: TypeAlias = SpaceTipGoal | SpaceJointPose


@dataclass(frozen=True)
class SpaceStop:
    """A goal on the way, at which the motion comes to rest.

    Attributes:
        goal: where the arm stops.
        tolerances: how near the goal counts.
        pause: how long it rests there [s].
    """

    goal: SpaceGoal
    tolerances: Tolerances
    pause: float = 0.0


IN_SPACE = PartTypes(
    parts={
        **COMMON_PARTS,
        "workspace": (SpaceWorkspace,),
        "arm": (SpaceArm,),
        "start": (SpaceJointPose,),
        "goal": (SpaceTipGoal, SpaceJointPose),
        "workspace.obstacles": (tuple,),
        "arm.feed": (Feed, type(None)),
        "planner.weights": (Weights,),
    },
    numbers=COMMON_NUMBERS,
    entries={"stops": SpaceStop, "workspace.obstacles": SpaceObstacle},
)
"""What the parts of a ``SpaceProblem`` are."""


@dataclass(frozen=True, repr=False)
class SpaceProblem(PlanningProblem):
    """One planning problem of an arm in space; its attributes are called as those of ``Problem``.

    Attributes:
        name: also names the output folder.
        workspace: room, obstacles, clearance.
        arm: the jointed arm.
        limits: bounds on joint speed, acceleration and torque.
        start: where the motion begins.
        goal: where it ends.
        description: one line for people.
        tolerances: how near the goal counts; its heading is an angle between directions.
        stops: goals on the way to the last, in order.
        planner: planner options.
        simulation: simulation options.
        joint_error: of every joint at any time, with which the motion has to touch nothing [rad]; 0 asks for none.
        verification: how strictly plans are judged.
        source: the text of the problem file, kept for the record; empty when built in Python.
        length_unit: in which people are told lengths, that of the problem file: ``m``, ``mm`` or ``in``. All values
            are in metres whatever it is.

    Raises:
        ProblemError: something in it is of another type or shape than it has to be, or out of bounds; all is named.
    """

    name: str
    workspace: SpaceWorkspace
    arm: SpaceArm
    limits: Limits
    start: SpaceJointPose
    goal: SpaceGoal
    description: str = ""
    tolerances: Tolerances = field(default_factory=Tolerances)
    stops: tuple[SpaceStop, ...] = ()
    planner: PlannerOptions = field(default_factory=PlannerOptions)
    simulation: SimulationOptions = field(default_factory=SimulationOptions)
    joint_error: float = 0.0
    verification: VerificationOptions = field(default_factory=VerificationOptions)
    source: str = ""
    length_unit: LengthUnit = "m"

    @property
    def via_reach(self) -> float:
        """How near the tip has to come to a place of ``goal.via`` to pass it [m]: it names a bore or a gap."""
        return max(self.tolerances.position, self.arm.link_length)

    def __post_init__(self) -> None:
        # What has the wrong type would only fail in some check of its values.
        found = tuple(wrong_types(self, IN_SPACE)) or tuple(space_defects(self))
        if found:
            raise ProblemError(f"problem '{self.name}' cannot be used:\n" + "\n".join(f"  {line}" for line in found))

    @property
    def goals(self) -> Sequence[SpaceStop]:
        """All goals in order, the last one with no pause."""
        return (*self.stops, SpaceStop(self.goal, self.tolerances))


AnyProblem: TypeAlias = Problem | SpaceProblem
"""A problem in the plane or in space."""
