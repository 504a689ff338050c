"""The planning problem as immutable data, and the checks that every problem must pass.

Rules of the arm are in ``arm_rules``, of start and goals in ``goal_rules``, of tools and bodies in ``tool_rules``.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, get_args

import numpy as np

from ccm_opt.core.arguments import expect, is_number
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import LengthUnit, long_length, words_in
from ccm_opt.problem.arm_rules import arm_defects, coupling_defects, drive_defects, section_defects
from ccm_opt.problem.field_types import ImportedArm, ImportedDrawing, wrong_types
from ccm_opt.problem.goal_rules import coverage_defects, pose_defects
from ccm_opt.problem.options import (
    CONTACT_SHARE_OF_LENGTH,
    MOST_CONTACT_SHARE_OF_LENGTH,
    PlannerOptions,
    SimulationOptions,
    VerificationOptions,
)
from ccm_opt.problem.poses import Coverage, Goal, JointPose, Stop, Tolerances
from ccm_opt.problem.tool_rules import Key, tool_defects
from ccm_opt.problem.value_rules import array_defects, broken, name_defects
from ccm_opt.robot.arm import Arm, MappingName
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.bodies import Body
from ccm_opt.scene.workspace import PlaneShape, Workspace


def defects(problem: "Problem") -> Iterator[str]:
    """Yield a sentence for every invalid value of a problem, whether read from a file or made in Python.

    All attributes must already have the right types, see ``wrong_types``. Problem files undergo further checks when
    they are read, see ``ccm_opt.io``.
    """
    d = problem.workspace.dimension
    if d == 3 and problem.workspace.bounds is None and np.shape(problem.arm.base) == (2,):
        yield "workspace.boundary must be a non-empty polygon for an arm in the plane"
        return
    yield from arm_defects(problem.arm, d)
    yield from _workspace_defects(problem.workspace)
    yield from name_defects("planner.mapping", problem.planner.mapping, get_args(MappingName))
    yield from drive_defects(problem.arm, problem.limits, problem.planner, problem.simulation)
    yield from array_defects("simulation.gravity", problem.simulation.gravity, (3,), positive=False)
    error, contact = problem.joint_error, problem.contact_tolerance
    yield from broken(
        (0.0 <= error < np.pi, f"tolerance.joint_error must be at least 0 and below π rad, got {error}"),
        (
            0.0 < contact <= MOST_CONTACT_SHARE_OF_LENGTH * problem.arm.length,
            f"verification.contact_tolerance must be positive and at most {_MOST_CONTACT_WORDS}, got {contact}",
        ),
    )
    yield from pose_defects(problem, d)
    given: dict[Key, Any] = {
        ("arm", "payload"): problem.arm.payload,
        ("limits", "points"): problem.limits.points,
        ("tolerance", "joint_error_deg"): error,
        ("planner", "follow_within"): problem.planner.follow_within,
        ("planner", "method"): problem.planner.method,
    }
    yield from (f"{'.'.join(map(str, key))}: {defect}" for key, defect in tool_defects(problem.arm, given))
    if problem.arm.drives is not None:
        yield from coupling_defects(problem, problem.arm.drives)
    if problem.arm.sections is not None:
        yield from section_defects(problem, problem.arm.sections)
    yield from _tour_defects(problem)
    if problem.coverage is not None:
        yield from coverage_defects(problem, problem.coverage)


def _tour_defects(problem: "Problem") -> Iterator[str]:
    """Yield a sentence for everything that goals in free order, or in the given one, do not support."""
    planner = problem.planner
    if not problem.pause >= 0.0:
        yield f"goal.pause must not be negative, got {problem.pause}"
    if planner.order != "free":
        if planner.end != "free":
            yield f'planner.end = "{planner.end}" needs planner.order = "free"; a motion in given order ends as given'
        return
    goals = [stop.goal for stop in problem.goals]
    yield from broken(
        (all(goal.path is None for goal in goals), 'goal.path is not supported with planner.order = "free"'),
        (
            not any(goal.via for goal in goals),
            'goal.via is not supported with planner.order = "free"; give each place as a goal, in a table [[goal]]',
        ),
        (planner.follow_within is None, 'planner.follow_within is not supported with planner.order = "free"'),
        (planner.tries == 1, 'planner.tries must be 1 with planner.order = "free"'),
        (planner.method == "nlp", f'planner.order = "free" needs planner.method = "nlp", got "{planner.method}"'),
        (
            planner.retiming == "toppra",
            f'planner.order = "free" needs planner.retiming = "toppra", got "{planner.retiming}"',
        ),
        (problem.joint_error == 0.0, 'tolerance.joint_error is not supported with planner.order = "free"'),
    )


_MOST_CONTACT_WORDS = "a thousandth of the arm's length"


def _workspace_defects(workspace: Workspace) -> Iterator[str]:
    if not workspace.clearance >= 0.0:
        yield f"workspace.clearance must not be negative, got {workspace.clearance}"
    if workspace.bounds is not None:
        found = tuple(array_defects("workspace.bounds", workspace.bounds, (2, 3), positive=False))
        yield from found
        if not found and not np.all(workspace.bounds[0] < workspace.bounds[1]):
            yield "workspace.bounds must have a lower corner below the upper one"
    in_space = workspace.dimension == 3
    for obstacle in workspace.obstacles:
        if isinstance(obstacle.shape, PlaneShape) == in_space:
            expected = "a solid in space" if in_space else "a PlaneShape"
            yield f"obstacle '{obstacle.name}': expected {expected}, got a {type(obstacle.shape).__name__}"
        elif in_space:
            yield from (f"obstacle '{obstacle.name}': {defect}" for defect in _body_defects(obstacle.body))


def _body_defects(body: Body) -> Iterator[str]:
    if body.kind == "mesh":
        if not (body.faces.ndim == 2 and body.faces.shape[1] == 3 and len(body.faces)):
            yield f"faces must be rows of three vertices, got shape {body.faces.shape}"
        elif body.faces.min() < 0 or body.faces.max() >= len(body.vertices):
            yield "faces refer to a vertex that does not exist"
        yield from array_defects("vertices", body.vertices, (len(body.vertices), 3), positive=False)
        return
    for name in body.places:
        yield from array_defects(name, getattr(body, name), (3,), positive=False)
    if body.kind == "box":
        if not np.all(np.asarray(body.low) < np.asarray(body.high)):
            yield "low must be below high"
        return
    if not (is_number(body.radius) and body.radius > 0.0):
        yield f"radius must be a positive number, got {body.radius}"
    if body.kind != "sphere" and np.array_equal(body.start, body.end):
        yield "start and end must differ"


WANTED_SHARE_OF_LENGTH = 0.015
"""Default preferred clearance, as a fraction of the arm's length."""
WANTED_SHARE_OF_RADIUS = 0.5
"""Default preferred clearance, as a fraction of the arm's radius; applies if smaller than the default by length."""


@dataclass(frozen=True, repr=False)
class Problem:
    """A motion-planning problem for a planar arm or an arm in space, in SI units and radians.

    Attributes:
        name: name of the problem and of its output folder.
        description: one line for human readers.
        workspace: boundary, obstacles and required clearance.
        arm: the jointed arm.
        limits: limits of joint velocity, acceleration, torque and jerk, of the feed axis, and of points of the arm.
        start: pose in which the motion begins.
        goal: goal at which the motion ends.
        tolerances: maximum deviation from the goal at the end of the motion.
        stops: intermediate goals, in order.
        pause: time for which the arm rests at ``goal`` if others follow it, which takes a free order [s].
        planner: planner options.
        simulation: simulation options.
        joint_error: deviation of any joint, at any time, under which the motion must remain collision-free [rad]; 0 for
            no such requirement.
        verification: verification options.
        source: text of the problem file, kept for the record; empty for problems built in Python or with a drawing.
        length_unit: unit of lengths in messages, taken from the problem file: ``m``, ``mm`` or ``in``; values are
            always in metres.
        drawing: report on the drawing from which obstacles were imported; None without a drawing.
        imported_arm: report on the URDF file from which the arm was read; None without one.
        coverage: surfaces that have to be seen from the goals; None for none. With goals in free order, goals are found
            for it, and ``goal`` is ``TipGoal.seeing(coverage, workspace)``.

    Raises:
        ProblemError: an attribute has a wrong type or shape, or an invalid value; the message lists all of them.
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
    drawing: ImportedDrawing | None = None
    imported_arm: ImportedArm | None = None
    pause: float = 0.0
    coverage: Coverage | None = None

    @property
    def dimension(self) -> int:
        """Dimension of the arm's motion, 2 for a planar arm and 3 for an arm in space."""
        return self.arm.dimension

    @property
    def via_reach(self) -> float:
        """Maximum distance at which the tip must pass each via point of the goal [m]."""
        return max(self.tolerances.position, self.arm.own_link_length)

    @property
    def contact_tolerance(self) -> float:
        """Maximum shortfall of the required clearance that the verifier accepts, meant for rounding [m]."""
        requested = self.verification.contact_tolerance
        return CONTACT_SHARE_OF_LENGTH * self.arm.length if requested is None else requested

    @property
    def wanted_gap(self) -> float:
        """Preferred clearance beyond the required clearance, kept by plans if the scene allows it [m].

        0 for the hill-climbing planner of the paper, which ignores this preference.
        """
        if self.planner.method != "nlp":
            return 0.0
        return self.default_gap if self.planner.wanted_gap is None else self.planner.wanted_gap

    @property
    def default_gap(self) -> float:
        """Default preferred clearance, the lesser of 1.5 % of the arm's length and half its radius [m].

        This is about the distance that one would keep around a hose of the arm's size. For an arm of zero radius the
        value is 1.5 % of its length.
        """
        share = WANTED_SHARE_OF_LENGTH * self.arm.length
        return share if self.arm.radius == 0.0 else min(share, WANTED_SHARE_OF_RADIUS * self.arm.radius)

    def __repr__(self) -> str:
        arm = self.arm
        goals = f", {len(self.stops) + 1} goals" if self.stops else ""
        obstacle_words = f"{len(self.workspace.obstacles)} obstacles"
        with words_in(self.length_unit):
            length = long_length(arm.length)
        return f"<{type(self).__name__} '{self.name}': {arm.links} links, {length} long, {obstacle_words}{goals}>"

    @property
    def goals(self) -> Sequence[Stop]:
        """All goals in order, the intermediate ones first; the final goal has no pause."""
        return (*self.stops, Stop(self.goal, self.tolerances))

    @property
    def numbered_goals(self) -> Sequence[Stop]:
        """All goals in the order of the problem, each with its pause."""
        return (*self.stops, Stop(self.goal, self.tolerances, self.pause))

    @staticmethod
    def expected(value: object) -> None:
        """Raise an error if a value is not a ``Problem``.

        Raises:
            ProblemError: the value is not a ``Problem``; the message states its type and how to load a problem.
        """
        expect(value, Problem, "a ccm_opt.Problem", "ccm_opt.load_problem reads one from a file")

    def __post_init__(self) -> None:
        # Types first: a field of the wrong type would make the checks of values fail with an obscure error.
        found = tuple(wrong_types(self)) or tuple(defects(self))
        if found:
            raise ProblemError(f"problem '{self.name}' cannot be used:\n" + "\n".join(f"  {line}" for line in found))
