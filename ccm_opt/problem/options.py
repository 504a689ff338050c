"""Options of a problem for planning, simulation and verification."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import MappingName

CONTACT_SHARE_OF_LENGTH = 1e-6
"""Default contact tolerance, as a share of the arm's length: far below manufacturing tolerances, and above the rounding
left by the certificate and by the chords between samples."""
MOST_CONTACT_SHARE_OF_LENGTH = 1e-3
"""Largest contact tolerance allowed, as a share of the arm's length: with more, a plan could pass through obstacles."""

MethodName = Literal["nlp", "hill-climbing"]
OptimiserName = Literal["sequential-convex", "none"]
RetimingName = Literal["toppra", "paul"]
ControllerName = Literal["computed-torque", "pd"]


@dataclass(frozen=True)
class Weights:
    """Weights of the planner's costs: 1 is the usual weight, 0 drops a cost, 10 makes it count ten times as much.

    All of them apply to the optimisation of motions; bending and clearance apply to that of the goal pose too.

    Attributes:
        path_length: joint rotation along the motion.
        smoothness: change of joint rotation from one step to the next.
        bending: curvature of the arm.
        clearance: closeness to obstacles; by default the motion only respects the workspace's required clearance.
        duration: surrogate for the duration: each joint's rotation, and change of rotation, relative to its limits.
    """

    path_length: float = 1.0
    smoothness: float = 1.0
    bending: float = 1.0
    clearance: float = 0.0
    duration: float = 0.0


@dataclass(frozen=True)
class PlannerOptions:
    """Choice of planner and its settings.

    Attributes:
        method: name of the planner.
        mapping: how joints are fitted to a curve.
        time_limit: CPU time of this process after which the search stops [s]; three times as much wall time stops it
            too.
        routes: number of corridors tried, shortest first.
        seed: seed of every random choice and of the order of candidates; 0 tries the most promising first.
        tries: number of plans made, with ``seed`` and the seeds after it; the best plan is kept.
        optimiser: how the motion found is optimised over all its keyframes; "none" keeps the motion with its detours.
        retiming: how the path is timed: as fast as its limits allow, or by Paul's transitions between keyframes.
        weights: weights of the costs when configurations and motions are optimised.
        wanted_gap: clearance beyond radius and required clearance that goal pose and motion aim for where the scene
            allows it [m]; 0 asks for none, None for ``Problem.default_gap``.
        effort_share: fraction of every drive's limits on velocity, acceleration, jerk and effort that plans may use,
            above 0 and at most 1, so that feedback has a reserve; raised where gravity alone takes nearly as much.
        follow_within: maximum deviation of an arm on a feed axis from the path of its tip [m], kept by every plan; None
            for no bound.
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


_OF_THE_PAPER = "is the paper's method, for the plane only; leave it out in space"
_WITHOUT_EFFECT: tuple[tuple[str, object, Collection[str], str], ...] = (
    ("method", "hill-climbing", ("in space",), f'"hill-climbing" {_OF_THE_PAPER}'),
    ("mapping", "even-joints", ("in space",), f'"even-joints" {_OF_THE_PAPER}'),
    ("routes", None, ("in space",), "corridors are searched in the plane only; leave it out in space"),
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
)
"""Options without effect for a kind of problem: (option, value without effect, kinds of problem, reason). None as the
value stands for any value but the default."""


def options_without_effect(options: PlannerOptions, *, in_space: bool) -> Iterator[tuple[str, str]]:
    """Yield the planner options that were set but have no effect, in the plane or in space.

    Args:
        options: options of the problem; those at their defaults count as not set.
        in_space: whether the arm moves in space rather than in the plane.

    Yields:
        The name of an option, and why it has no effect.
    """
    kinds = {options.method, *(("in space",) if in_space else ())}
    for name, idle, where, why in _WITHOUT_EFFECT:
        value = getattr(options, name)
        given = value != getattr(PlannerOptions(), name) if idle is None else value == idle
        if given and not kinds.isdisjoint(where):
            yield name, why


@dataclass(frozen=True)
class Disturbances:
    """How the simulated arm differs from the model that its controller uses.

    Attributes:
        mass_error: fraction by which the links are heavier than modelled, above -1.
        payload: unmodelled point mass at the tip [kg].
        friction: unmodelled viscous friction of every revolute [N m s/rad].
        angle_noise: standard deviation of measured angles [rad]; of the bends alone while the arm stays in its plane.
        velocity_noise: standard deviation of measured joint speeds [rad/s]; of the bends alone while the arm stays in
            its plane.
        start_delay: time for which brakes still hold the arm after the motion begins [s].
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
    """How the timed motion is simulated.

    Attributes:
        gravity: gravitational acceleration, shape (3,) [m/s²]; the plane of motion is x-z.
        step: integration step [s].
        controller: tracking law, computed torque or PD.
        bandwidth: natural frequency ωn for which both laws are tuned [1/s].
        proportional_gain: gain of the PD law for every joint [N m/rad]; None chooses a gain for this arm and bandwidth.
        derivative_gain: damping gain of the PD law for every joint [N m s/rad]; None chooses a gain as well.
        disturbances: differences between the simulated arm and the controller's model.
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
    """How strictly plans are judged.

    Attributes:
        contact_tolerance: shortfall in clearance accepted before a motion is refused [m]; None for a millionth of the
            arm's length.
    """

    contact_tolerance: float | None = None
