"""What a problem says of planning, simulating and judging: which method, how long, how strictly."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import MappingName

CONTACT_SHARE_OF_LENGTH = 1e-6
"""Contact tolerance unless the problem says otherwise, as a share of the arm's length: far below what machines are made
to, and above what the certificate and the chords between samples leave to rounding."""
MOST_CONTACT_SHARE_OF_LENGTH = 1e-3
"""Greatest contact tolerance, as such a share: with more of it a plan may go through what it has to keep clear of."""

MethodName = Literal["nlp", "hill-climbing"]
OptimiserName = Literal["sequential-convex", "none"]
RetimingName = Literal["toppra", "paul"]
ControllerName = Literal["computed-torque", "pd"]


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


_OF_THE_PAPER = "is the paper's and knows the plane alone; leave it out in space"
_WITHOUT_EFFECT: tuple[tuple[str, object, Collection[str], str], ...] = (
    ("method", "hill-climbing", ("in space",), f'"hill-climbing" {_OF_THE_PAPER}'),
    ("mapping", "even-joints", ("in space",), f'"even-joints" {_OF_THE_PAPER}'),
    ("routes", None, ("in space",), "corridors are sought in the plane alone; leave it out in space"),
    ("tries", None, ("hill-climbing",), '"hill-climbing" draws nothing, so that all tries would be the same; use 1'),
    ("seed", None, ("hill-climbing",), '"hill-climbing" draws nothing; leave it out'),
    *(
        (name, None, ("hill-climbing",), '"hill-climbing" does not know it; leave it out')
        for name in ("optimiser", "weights", "wanted_gap")
    ),
)
"""Options that do nothing for a kind of problem: their names, the value that does nothing, or None for any but the
default, where it does nothing, and why."""


def options_without_effect(options: PlannerOptions, *, in_space: bool) -> Iterator[tuple[str, str]]:
    """Yield the planner options that were given and do nothing for a kind of problem.

    Args:
        options: of the problem; what has its default counts as not given.
        in_space: whether the arm leaves the plane.

    Yields:
        The name of an option, and why it does nothing.
    """
    kinds = {options.method, *(("in space",) if in_space else ())}
    for name, idle, where, why in _WITHOUT_EFFECT:
        value = getattr(options, name)
        given = value != getattr(PlannerOptions(), name) if idle is None else value == idle
        if given and not kinds.isdisjoint(where):
            yield name, why


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
        bandwidth: natural frequency ωn that both laws are tuned for [1/s].
        proportional_gain: of the PD law for every joint [N m/rad]; None for what suits the arm at this bandwidth.
        derivative_gain: of the PD law for every joint [N m s/rad]; likewise.
        disturbances: what the controller does not know of.
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
        contact_tolerance: gap that may be missing before a motion is refused [m]; None for a millionth of the arm.
    """

    contact_tolerance: float | None = None
