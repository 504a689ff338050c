"""The problem in space: scene, arm, limits, start, goal and options."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arguments import is_number
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import LengthUnit
from ccm_opt.errors import ProblemError
from ccm_opt.problem import (
    Goal,
    JointPose,
    PlannerOptions,
    Problem,
    SimulationOptions,
    Stop,
    TipGoal,
    Tolerances,
    VerificationOptions,
)
from ccm_opt.problem.defects import array_defects, drive_defects, feed_defects
from ccm_opt.problem.field_types import COMMON_NUMBERS, COMMON_PARTS, PartTypes, wrong_types
from ccm_opt.problem.options import Weights
from ccm_opt.problem.planning_problem import MOST_CONTACT_SHARE_OF_LENGTH, PlanningProblem
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.bodies import Body, BoxBody, MeshBody, SphereBody
from ccm_opt.scene.workspace import Obstacle, Workspace

UNIT_ROUNDING = 1e-9
"""By which the length of a unit vector, or a right angle's cosine, may be off."""


def space_defects(problem: "SpaceProblem") -> Iterator[str]:
    """What is wrong with the data of a problem in space; files are checked more closely by ``problem_file``."""
    yield from _arm_defects(problem.arm)
    yield from _workspace_defects(problem.workspace)
    yield from drive_defects(problem.arm, problem.limits, problem.planner, problem.simulation)
    yield from array_defects("simulation.gravity", problem.simulation.gravity, (3,), positive=False)
    if not 0.0 <= problem.joint_error < np.pi:
        yield f"joint_error must be from 0 to below π rad, got {problem.joint_error}"
    if not 0.0 < problem.contact_tolerance <= MOST_CONTACT_SHARE_OF_LENGTH * problem.arm.length:
        yield (
            "verification.contact_tolerance must be positive and at most a thousandth of the arm's length, got "
            f"{problem.contact_tolerance}"
        )
    yield from _pose_defects(problem)


def _arm_defects(arm: Arm) -> Iterator[str]:
    if arm.links < 2 or arm.links % 2:
        yield f"arm.links must be even and at least 2, got {arm.links}"
    if not (arm.link_length > 0.0 and arm.radius >= 0.0):
        yield f"arm.link_length must be positive and arm.radius not negative, got {arm.link_length} and {arm.radius}"
    if not arm.mount_length >= 0.0:
        yield f"arm.mount_length must not be negative, got {arm.mount_length}"
    for name in ("joint_limit", "base_limit"):
        if not getattr(arm, name) > 0.0:
            yield f"arm.{name} must be positive, got {getattr(arm, name)}"
    if arm.axes != "zyx":
        yield f'arm.axes must be "zyx" in space, got {arm.axes!r}'
    yield from array_defects("arm.base", arm.base, (3,), positive=False)
    yield from _unit_defects("arm.direction", arm.direction)
    yield from _unit_defects("arm.up", arm.up)
    vectors = [np.asarray(vector) for vector in (arm.direction, arm.up)]
    if all(vector.shape == (3,) for vector in vectors) and abs(float(vectors[0] @ vectors[1])) > UNIT_ROUNDING:
        yield "arm.up must be at right angles to arm.direction"


def _unit_defects(name: str, vector: FloatArray) -> Iterator[str]:
    found = tuple(array_defects(name, vector, (3,), positive=False))
    yield from found
    if not found and abs(float(np.linalg.norm(vector)) - 1.0) > UNIT_ROUNDING:
        yield f"{name} must have the length 1, got {float(np.linalg.norm(vector)):g}"


def _workspace_defects(workspace: Workspace) -> Iterator[str]:
    if not workspace.clearance >= 0.0:
        yield f"workspace.clearance must not be negative, got {workspace.clearance}"
    if workspace.bounds is not None:
        found = tuple(array_defects("workspace.bounds", workspace.bounds, (2, 3), positive=False))
        yield from found
        if not found and not np.all(workspace.bounds[0] < workspace.bounds[1]):
            yield "workspace.bounds must have a lower corner below the upper one"
    for obstacle in workspace.obstacles:
        yield from (f"obstacle '{obstacle.name}': {defect}" for defect in _body_defects(obstacle.body))


def _body_defects(body: Body) -> Iterator[str]:
    if isinstance(body, MeshBody):
        if not (body.faces.ndim == 2 and body.faces.shape[1] == 3 and len(body.faces)):
            yield f"faces must be rows of three vertices, got shape {body.faces.shape}"
        elif body.faces.min() < 0 or body.faces.max() >= len(body.vertices):
            yield "faces name a vertex that is not there"
        yield from array_defects("vertices", body.vertices, (len(body.vertices), 3), positive=False)
        return
    if isinstance(body, BoxBody):
        for name, corner in (("low", body.low), ("high", body.high)):
            yield from array_defects(name, corner, (3,), positive=False)
        if not np.all(np.asarray(body.low) < np.asarray(body.high)):
            yield "low must be below high"
        return
    if not (is_number(body.radius) and body.radius > 0.0):
        yield f"radius must be a positive number, got {body.radius}"
    ends = ("center",) if isinstance(body, SphereBody) else ("start", "end")
    for name in ends:
        yield from array_defects(name, getattr(body, name), (3,), positive=False)
    if not isinstance(body, SphereBody) and np.array_equal(body.start, body.end):
        yield "start and end must differ"


def _pose_defects(problem: "SpaceProblem") -> Iterator[str]:
    poses = [("start", problem.start), ("goal", problem.goal)]
    poses += [(f"stop {k}", stop.goal) for k, stop in enumerate(problem.stops, start=1)]
    placed = []
    for name, pose in poses:
        if isinstance(pose, JointPose):
            placed.append((name, float(pose.feed)))
            yield from array_defects(f"{name}.bends", pose.bends, (problem.arm.links, 2), positive=False)
            continue
        yield from array_defects(f"{name}.position", pose.position, (3,), positive=False)
        if pose.direction is not None:
            yield from _unit_defects(f"{name}.direction", pose.direction)
        for number, via in enumerate(pose.via, start=1):
            yield from array_defects(f"{name}.via {number}", via, (3,), positive=False)
    yield from feed_defects(problem.arm, problem.limits, placed)


IN_SPACE = PartTypes(
    parts={
        **COMMON_PARTS,
        "workspace": (Workspace,),
        "arm": (Arm,),
        "start": (JointPose,),
        "goal": (TipGoal, JointPose),
        "workspace.obstacles": (tuple,),
        "arm.feed": (Feed, type(None)),
        "planner.weights": (Weights,),
    },
    numbers=COMMON_NUMBERS,
    entries={"stops": Stop, "workspace.obstacles": Obstacle},
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
    workspace: Workspace
    arm: Arm
    limits: Limits
    start: JointPose
    goal: Goal
    description: str = ""
    tolerances: Tolerances = field(default_factory=Tolerances)
    stops: tuple[Stop, ...] = ()
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
    def goals(self) -> Sequence[Stop]:
        """All goals in order, the last one with no pause."""
        return (*self.stops, Stop(self.goal, self.tolerances))


AnyProblem: TypeAlias = Problem | SpaceProblem
"""A problem in the plane or in space."""
