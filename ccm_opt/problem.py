"""A motion-planning problem: frozen data, SI units, radians. ``problem_file`` makes one from TOML."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Literal, TypeAlias, get_args

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.errors import ProblemError
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm, Axes, MappingName
from ccm_opt.jointed.coordinates import Coordinates
from ccm_opt.jointed.drive_limits import DriveLimits, Limits, PointLimit

__all__ = [
    "ControllerName",
    "CurvePose",
    "Disturbances",
    "DriveLimits",
    "Goal",
    "JointPose",
    "Limits",
    "MethodName",
    "OptimiserName",
    "PlannerOptions",
    "PointLimit",
    "Problem",
    "RetimingName",
    "SimulationOptions",
    "Start",
    "Stop",
    "TipGoal",
    "Tolerances",
    "VerificationOptions",
    "Weights",
]

CONTACT_SHARE_OF_LENGTH = 1e-6
"""Contact tolerance unless the problem says otherwise, as a share of the arm's length: far below what machines are made
to, and above what the certificate and the chords between samples leave to rounding."""
WANTED_SHARE_OF_LENGTH = 0.015
"""Room that plans keep unless the problem says otherwise, as a share of the arm's length."""
WANTED_SHARE_OF_RADIUS = 0.5
"""The same as a share of its radius; the lesser room counts."""

MethodName = Literal["nlp", "hill-climbing"]
OptimiserName = Literal["sequential-convex", "interior-point", "none"]
RetimingName = Literal["toppra", "paul"]
ControllerName = Literal["computed-torque", "pd"]


@dataclass(frozen=True)
class JointPose:
    """A whole-arm pose given by its joints.

    Attributes:
        bends: shape (links,) [rad].
        feed: position of the base on its feed axis [m]; 0 without one.
    """

    bends: FloatArray
    feed: float = 0.0

    @classmethod
    def from_configuration(cls, q: FloatArray, coordinates: Coordinates) -> "JointPose":
        """The pose of a configuration, shape (c,) [rad, m]."""
        return cls(q[coordinates.bends], float(coordinates.advance(q)))

    def configuration(self, arm: Arm) -> FloatArray:
        """The pose as a configuration of an arm, shape (c,) [rad, m]."""
        return arm.configuration(self.bends, self.feed)


@dataclass(frozen=True)
class CurvePose:
    """A whole-arm pose given as a curve; the arm takes its mapping.

    Attributes:
        configuration: the curve as it lies when the feed axis is at 0.
        feed: position of the base on its feed axis [m]; 0 without one.
    """

    configuration: Configuration
    feed: float = 0.0


@dataclass(frozen=True)
class TipGoal:
    """A goal for the tip alone.

    Attributes:
        position: shape (2,) [m].
        heading: [rad], or None when any heading will do.
    """

    position: FloatArray
    heading: float | None = None


_Array: TypeAlias = tuple[str, FloatArray, tuple[int, ...]]  # name, value, shape
Start: TypeAlias = JointPose | CurvePose
Goal: TypeAlias = TipGoal | JointPose | CurvePose


@dataclass(frozen=True)
class Tolerances:
    """How near the goal the motion must end: position [m] and heading [rad]."""

    position: float = 1e-3
    heading: float = float(np.deg2rad(1.0))


@dataclass(frozen=True)
class Stop:
    """A goal on the way, at which the motion comes to rest.

    Attributes:
        goal: where the arm stops.
        tolerances: how near the goal counts.
        pause: how long it rests there [s].
    """

    goal: Goal
    tolerances: Tolerances
    pause: float = 0.0


@dataclass(frozen=True)
class Weights:
    """How much each thing counts that planning makes small: 1 as usual, 0 not at all, 10 ten times as much.

    They weigh the optimisation of motions; bending and clearance weigh the goal configuration too.

    Attributes:
        path_length: turns of the joints along the motion.
        smoothness: changes of these turns.
        bending: the arm's curvature.
        clearance: nearness to walls; by default only the clearance of the workspace is kept, and no more is asked for.
        duration: a stand-in for the duration: turns, and changes of turns, of every joint against its own limits.
    """

    path_length: float = 1.0
    smoothness: float = 1.0
    bending: float = 1.0
    clearance: float = 0.0
    duration: float = 0.0


@dataclass(frozen=True)
class PlannerOptions:
    """Which planner, how long, and with what.

    Attributes:
        method: planner's name.
        mapping: how a curve becomes joints.
        time_limit: CPU time of this process after which the search stops [s]; three times as much wall time ends it
            too.
        routes: corridors tried, shortest first.
        seed: of the order in which candidates are tried and of every random choice; 0 tries the most promising first.
        tries: plans that are made, with this seed and those after it; the best is taken.
        optimiser: how the motion that is found is optimised over all its keyframes; by "none" it stays long.
        retiming: how the path is timed: as fast as its limits allow, or by Paul's transitions between keyframes.
        weights: what counts how much when configurations and motions are optimised.
        wanted_gap: room beyond radius and clearance that the goal pose and the motion keep where there is so much [m];
            0 asks for none, None for ``Problem.default_gap``.
        effort_share: share of every drive's limits on velocity, acceleration, jerk and effort that plans use, above 0
            and at most 1, so that feedback has something left; where gravity alone takes nearly so much, more.
    """

    method: MethodName = "nlp"
    mapping: MappingName = "least-squares"
    time_limit: float = 60.0
    routes: int = 5
    seed: int = 0
    tries: int = 1
    optimiser: OptimiserName = "sequential-convex"
    retiming: RetimingName = "toppra"
    weights: Weights = field(default_factory=Weights)
    wanted_gap: float | None = None
    effort_share: float = 0.9


@dataclass(frozen=True)
class Disturbances:
    """What the simulated arm does otherwise than its controller believes.

    Attributes:
        mass_error: share by which the links are heavier, above -1.
        payload: mass of a point at the tip that the controller does not know of [kg].
        friction: viscous friction of every revolute that it does not know of [N m s/rad].
        angle_noise: standard deviation of measured angles [rad]; of the bends alone while the arm stays in its plane.
        velocity_noise: the same of measured joint speeds [rad/s].
        start_delay: time for which brakes still hold the arm when the motion begins [s].
        seed: of the noise.
    """

    mass_error: float = 0.0
    payload: float = 0.0
    friction: float = 0.0
    angle_noise: float = 0.0
    velocity_noise: float = 0.0
    start_delay: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class SimulationOptions:
    """How the timed motion is simulated.

    Attributes:
        gravity: shape (3,) [m/s²]; the plane of motion is x-z.
        step: integration step [s].
        controller: the tracking law.
        bandwidth: natural frequency ωn of the computed-torque error dynamics [1/s].
        proportional_gain: of the PD law [N m/rad].
        derivative_gain: of the PD law [N m s/rad].
        disturbances: what the controller does not know of.
    """

    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    step: float = 1e-3
    controller: ControllerName = "computed-torque"
    bandwidth: float = 50.0
    proportional_gain: float = 2.0
    derivative_gain: float = 0.002
    disturbances: Disturbances = field(default_factory=Disturbances)


@dataclass(frozen=True)
class VerificationOptions:
    """How strictly plans are judged.

    Attributes:
        contact_tolerance: gap that may be missing before a motion is refused [m]; None for a millionth of the arm.
    """

    contact_tolerance: float | None = None


@dataclass(frozen=True)
class Problem:
    """One planning problem.

    Attributes:
        name: also names the output folder.
        description: one line for people.
        workspace: room, obstacles, clearance.
        arm: the jointed arm.
        limits: bounds on joint speed, acceleration and torque.
        start: where the motion begins.
        goal: where it ends.
        tolerances: how near the goal counts.
        stops: goals on the way to the last, in order.
        planner: planner options.
        simulation: simulation options.
        joint_error: of every joint at any time, with which the motion has to touch nothing [rad]; 0 asks for none.
        verification: how strictly plans are judged.
        source: the text of the problem file, kept for the record; empty when built in Python.
    """

    name: str
    workspace: Workspace
    arm: Arm
    limits: Limits
    start: Start
    goal: Goal
    description: str = ""
    tolerances: Tolerances = field(default_factory=Tolerances)
    stops: tuple[Stop, ...] = ()
    planner: PlannerOptions = field(default_factory=PlannerOptions)
    simulation: SimulationOptions = field(default_factory=SimulationOptions)
    joint_error: float = 0.0
    verification: VerificationOptions = field(default_factory=VerificationOptions)
    source: str = ""

    @property
    def contact_tolerance(self) -> float:
        """Gap that may be missing before a motion is refused, rounding as a rule [m]."""
        asked = self.verification.contact_tolerance
        return CONTACT_SHARE_OF_LENGTH * self.arm.length if asked is None else asked

    @property
    def wanted_gap(self) -> float:
        """Room beyond radius and clearance that planning keeps where there is so much [m].

        The planner of a feed axis and the paper's planner know no wanted gap, and so keep none.
        """
        if self.arm.base_axes or self.planner.method != "nlp":
            return 0.0
        return self.default_gap if self.planner.wanted_gap is None else self.planner.wanted_gap

    @property
    def default_gap(self) -> float:
        """The wanted gap where the options name none, 1.5 % of the arm's length or half its radius [m].

        The lesser of the two, as much as one would leave beside a hose of that size. An arm without a radius gets the
        former.
        """
        share = WANTED_SHARE_OF_LENGTH * self.arm.length
        return share if self.arm.radius == 0.0 else min(share, WANTED_SHARE_OF_RADIUS * self.arm.radius)

    def __post_init__(self) -> None:
        defects = tuple(_defects(self))
        if defects:
            raise ProblemError(f"problem '{self.name}' cannot be used:\n" + "\n".join(f"  {line}" for line in defects))


def _defects(problem: Problem) -> Iterator[str]:
    """What is wrong with the data of a problem, whoever made it; files are checked more closely by ``problem_file``."""
    arm = problem.arm
    if arm.links < 2 or arm.links % 2:
        yield f"arm.links must be even and at least 2, got {arm.links}"
    if not (arm.link_length > 0.0 and arm.radius >= 0.0):
        yield f"arm.link_length must be positive and arm.radius not negative, got {arm.link_length} and {arm.radius}"
    for name, value, shape in _positive_arrays(problem):
        yield from _array_defects(name, value, shape, positive=True)
    for name, value, shape in _plain_arrays(problem):
        yield from _array_defects(name, value, shape, positive=False)
    yield from _name_defects(problem)
    if not 0.0 <= problem.joint_error < np.pi:
        yield f"joint_error must be from 0 to below π rad, got {problem.joint_error}"
    if not 0.0 < problem.contact_tolerance < np.inf:
        yield f"verification.contact_tolerance must be positive and finite, got {problem.contact_tolerance}"
    yield from _weight_defects(problem.planner.weights)
    yield from _feed_defects(problem)
    yield from _point_defects(problem)
    if not 0.0 < problem.planner.effort_share <= 1.0:
        yield f"planner.effort_share must be above 0 and at most 1, got {problem.planner.effort_share}"
    if problem.planner.retiming == "paul" and (problem.limits.jerk is not None or problem.limits.feed_jerk is not None):
        yield 'limits.jerk and limits.feed_jerk need planner.retiming = "toppra", got "paul"'


def _weight_defects(weights: Weights) -> Iterator[str]:
    for name, value in asdict(weights).items():
        if not 0.0 <= value < np.inf:
            yield f"planner.weights.{name} must be finite and not negative, got {value}"


def _point_defects(problem: Problem) -> Iterator[str]:
    """Limits on points: on the arm, positive, and one for each."""
    points = problem.limits.points
    length = problem.arm.length
    for k, point in enumerate(points):
        name = f"limits.points[{k}]"
        if point.at is not None and not 0.0 <= point.at <= length * (1.0 + 1e-9):
            yield f"{name}.at must be from 0 to the arm's length, {length:g} m, got {point.at}"
        for key in ("velocity", "acceleration"):
            if not getattr(point, key) > 0.0:
                yield f"{name}.{key} must be positive, or left out when it is not limited, got {getattr(point, key)}"
        if np.isinf(point.velocity) and np.isinf(point.acceleration):
            yield f"{name} limits neither velocity nor acceleration"
        if point.at in [other.at for other in points[:k]]:
            yield f"{name} limits the {point.name} a second time"


def _feed_defects(problem: Problem) -> Iterator[str]:
    limits = problem.limits
    poses = [("start", problem.start), ("goal", problem.goal)]
    poses += [(f"stop {k}", stop.goal) for k, stop in enumerate(problem.stops, start=1)]
    placed = [(name, pose.feed) for name, pose in poses if not isinstance(pose, TipGoal)]
    if not problem.arm.base_axes:
        yield from (f"{name}.feed is {value} m, but the arm has no feed axis" for name, value in placed if value)
    for axis in problem.arm.base_axes:
        if not axis.low < axis.high:
            yield f"arm.feed must have low < high, got {axis.low} and {axis.high}"
        for key in ("feed_velocity", "feed_acceleration"):
            if getattr(limits, key) is None or not getattr(limits, key) > 0.0:
                yield f"limits.{key} must be positive when the arm has a feed axis, got {getattr(limits, key)}"
        for key in ("feed_force", "feed_jerk"):
            if getattr(limits, key) is not None and not getattr(limits, key) > 0.0:
                yield f"limits.{key} must be positive, or left out when it is not limited, got {getattr(limits, key)}"
        for name, value in placed:
            if not axis.low <= value <= axis.high:
                yield f"{name}.feed must be within the range of the axis, {axis.low} to {axis.high} m, got {value}"


def _positive_arrays(problem: Problem) -> Iterator[_Array]:
    arm = problem.arm
    limits = problem.limits
    for name in ("masses", "inertia_axial", "inertia_transverse"):
        yield f"arm.{name}", getattr(arm, name), (arm.links,)
    for name in ("velocity", "acceleration", "torque", "jerk"):
        if getattr(limits, name) is not None:
            yield f"limits.{name}", getattr(limits, name), (3 * arm.links,)


def _plain_arrays(problem: Problem) -> Iterator[_Array]:
    yield "arm.base", problem.arm.base, (2,)
    yield "simulation.gravity", problem.simulation.gravity, (3,)
    for end, pose in (("start", problem.start), ("goal", problem.goal)):
        if isinstance(pose, JointPose):
            yield f"{end}.bends", pose.bends, (problem.arm.links,)
        elif isinstance(pose, TipGoal):
            yield f"{end}.position", pose.position, (2,)


def _array_defects(name: str, value: FloatArray, shape: tuple[int, ...], *, positive: bool) -> Iterator[str]:
    if not hasattr(value, "shape"):
        yield f"{name} must be an array of shape {shape}, got a {type(value).__name__}"
    elif value.shape != shape:
        yield f"{name} must have shape {shape}, got {value.shape}"
    elif not np.all(np.isfinite(value)):
        yield f"{name} must be finite, got {value[~np.isfinite(value)][0]}"
    elif positive and not np.all(value > 0.0):
        yield f"{name} must be positive, got {value[value <= 0.0][0]}"


def _name_defects(problem: Problem) -> Iterator[str]:
    planner = problem.planner
    for key, value, names in (
        ("arm.axes", problem.arm.axes, get_args(Axes)),
        ("planner.method", planner.method, get_args(MethodName)),
        ("planner.mapping", planner.mapping, get_args(MappingName)),
        ("planner.optimiser", planner.optimiser, get_args(OptimiserName)),
        ("planner.retiming", planner.retiming, get_args(RetimingName)),
        ("simulation.controller", problem.simulation.controller, get_args(ControllerName)),
    ):
        if value not in names:
            yield f"{key} must be one of {', '.join(names)}, got {value!r}"
