"""Planner, simulation and verification options of a problem."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import MappingName

CONTACT_SHARE_OF_LENGTH = 1e-6
"""Default contact tolerance, as a fraction of the arm's length: far below manufacturing tolerances, but above the
errors of the certificate and of linear interpolation between samples."""
MOST_CONTACT_SHARE_OF_LENGTH = 1e-3
"""Maximum contact tolerance, as a fraction of the arm's length; with more, a plan could pass through obstacles."""

MethodName = Literal["nlp", "hill-climbing"]
OptimiserName = Literal["sequential-convex", "none"]
RetimingName = Literal["toppra", "paul"]
ControllerName = Literal["computed-torque", "pd"]
OrderName = Literal["given", "free"]
TourEnd = Literal["free", "last", "start"]


@dataclass(frozen=True)
class Weights:
    """Weights of the planner's costs, relative to their usual weight of 1; 0 drops a cost.

    All weights apply to the optimisation of motions; bending and clearance also apply to that of the goal pose.

    Attributes:
        path_length: weight of joint travel along the motion.
        smoothness: weight of changes of the joint steps from one keyframe to the next.
        bending: weight of the arm's curvature.
        clearance: weight of proximity to obstacles; with 0 motions only respect the required clearance.
        duration: weight of a surrogate for the duration, namely each joint's steps, and their changes, relative to the
            joint's limits.
    """

    path_length: float = 1.0
    smoothness: float = 1.0
    bending: float = 1.0
    clearance: float = 0.0
    duration: float = 0.0


@dataclass(frozen=True)
class PlannerOptions:
    """Choice of the planner and its settings.

    Attributes:
        method: name of the planner.
        mapping: name of the method that fits the joints to a backbone curve.
        time_limit: CPU time of this process after which the search stops [s]; three times as much wall time also stops
            the search.
        routes: number of homotopy classes (corridors) that are tried, shortest first; for planar arms only.
        seed: seed of all random choices and of the order of candidates; 0 tries the most promising candidate first.
        tries: number of plans made, with ``seed`` and the seeds after it; the best plan is kept.
        optimiser: method that optimises the motion over all keyframes; "none" keeps the motion as found.
        retiming: method that times the path: "toppra", as fast as the limits allow, or "paul", by Paul's transitions
            between keyframes.
        weights: weights of the costs in the optimisation of goal pose and motion.
        wanted_gap: preferred clearance of goal pose and motion beyond the required clearance, kept if the scene
            allows it [m]; 0 for no preference, None for ``Problem.default_gap``.
        effort_share: fraction of the drives' limits of velocity, acceleration, jerk and effort that plans may use,
            above 0 and at most 1; the rest is a reserve for feedback. Raised if gravity alone takes nearly that
            fraction.
        follow_within: maximum deviation of an arm on a feed axis from the tip path [m], kept by every plan; None for no
            limit.
        order: order in which several goals are visited: "given", or "free", the one that takes least time.
        end: where a motion to goals in free order ends: at any goal ("free"), at the last goal of the problem
            ("last"), or back at the start ("start").
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
    follow_within: float | None = None
    order: OrderName = "given"
    end: TourEnd = "free"


_OF_THE_PAPER = "is the paper's method, for the plane only; leave it out in space"
_WITHOUT_EFFECT: tuple[tuple[str, object, Collection[str], str], ...] = (
    ("method", "hill-climbing", ("in space",), f'"hill-climbing" {_OF_THE_PAPER}'),
    ("mapping", "even-joints", ("in space",), f'"even-joints" {_OF_THE_PAPER}'),
    ("routes", None, ("in space",), "corridors are searched for planar arms of single joints only; leave it out"),
    (
        "tries",
        None,
        ("hill-climbing",),
        '"hill-climbing" samples nothing, so all tries would give the same plan; use 1',
    ),
    ("seed", None, ("hill-climbing",), '"hill-climbing" samples nothing; leave it out'),
    *(
        (name, None, ("hill-climbing",), '"hill-climbing" does not use it; leave it out')
        for name in ("optimiser", "weights", "wanted_gap", "follow_within")
    ),
    *(
        (name, None, ("along paths",), "goal.path fixes the motion; leave it out")
        for name in ("optimiser", "weights", "wanted_gap", "seed", "tries")
    ),
)
"""Planner options without effect: (option, value without effect, kinds of problem, reason). None as the value stands
for every value other than the default."""


def options_without_effect(options: PlannerOptions, *, in_space: bool, along_paths: bool) -> Iterator[tuple[str, str]]:
    """Yield the planner options that were set although they have no effect.

    Args:
        options: options of the problem; a default value counts as not set.
        in_space: whether the arm moves in three dimensions, or is planned as if it did.
        along_paths: whether every goal is a path of the tip.

    Yields:
        Name of the option, and the reason why it has no effect.
    """
    kinds = {options.method, *(["in space"] * in_space), *(["along paths"] * along_paths)}
    for name, idle, where, why in _WITHOUT_EFFECT:
        value = getattr(options, name)
        given = value != getattr(PlannerOptions(), name) if idle is None else value == idle
        if given and not kinds.isdisjoint(where):
            yield name, why


@dataclass(frozen=True)
class Disturbances:
    """Differences between the simulated arm and the model that its controller uses, and noise of the sensors.

    Attributes:
        mass_error: fraction by which the links are heavier than modelled, above -1.
        payload: unmodelled point mass at the tip [kg].
        friction: unmodelled viscous friction of every revolute joint [N m s/rad].
        angle_noise: standard deviation of measured joint angles [rad]; for planar arms, of the bend angles only.
        velocity_noise: standard deviation of measured joint velocities [rad/s]; for planar arms, of the bend
            velocities only.
        start_delay: time for which brakes still hold the arm after the planned motion has begun [s].
        seed: seed of the noise.
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
    """Settings for the closed-loop simulation of a timed motion.

    Attributes:
        gravity: gravitational acceleration, shape (3,) [m/s²]; planar arms move in the x-z plane.
        step: integration step [s].
        controller: control law, computed torque or PD.
        bandwidth: natural frequency ωn for which both control laws are tuned [1/s].
        proportional_gain: proportional gain of the PD law for every joint [N m/rad]; None for a gain tuned to arm and
            bandwidth.
        derivative_gain: derivative gain of the PD law for every joint [N m s/rad]; None for a gain tuned to arm and
            bandwidth.
        disturbances: differences between the simulated arm and the controller's model, and sensor noise.
    """

    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    step: float = 1e-3
    controller: ControllerName = "computed-torque"
    bandwidth: float = 50.0
    proportional_gain: float | None = None
    derivative_gain: float | None = None
    disturbances: Disturbances = field(default_factory=Disturbances)


@dataclass(frozen=True)
class VerificationOptions:
    """Settings that determine how strictly plans are verified.

    Attributes:
        contact_tolerance: maximum shortfall of the required clearance with which a motion is accepted [m]; None for a
            millionth of the arm's length.
    """

    contact_tolerance: float | None = None
