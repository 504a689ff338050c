"""Checks of the motion that a controller interpolates from the points of a trajectory message.

ROS's ``joint_trajectory_controller`` joins two points by a cubic if both have velocities, and by a quintic if both also
have accelerations. Such a curve is checked in short steps. In a step of length h, a function f lies within h² / 8 ·
max|f''| of its chord, so |f| is at most its value at the ends plus this amount, or without this amount if f' keeps its
sign. Bounds on the derivatives of a polynomial follow from those on higher derivatives, of which the last is constant
or linear (``docs/guarantees.md``, theorem 10).

In the verified motion, coordinates are linear between samples. A deviation of the curve *along* a linear piece only
changes the timing on the same path; the deviation across the piece is bounded here (theorem 10, too).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.verification.attached_masses import PointMasses, all_masses
from ccm_opt.verification.base_axes import check_base_axes
from ccm_opt.verification.base_motion import axis_levers, base_reach
from ccm_opt.verification.drives import (
    axis_limits,
    bend_revolutes,
    bends_a_ball,
    describe_bend_joints,
    largest_bends,
    of_drives,
    torque_limits,
)
from ccm_opt.verification.limits import UNIT, check_points
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.start_and_goal import check_pauses
from ccm_opt.verification.verification_settings import VerificationSettings

LONGEST_STEP = 1e-3
"""Longest step in which interpolated curves are checked [s]. Heuristic: adds about 1e-5 of a limit between step
ends."""
MOST_STEPS = 50_000
"""Largest number of steps, unless the message has more points; longer steps only loosen the bounds. Heuristic."""
MOST_PIECES = 32
"""Number of equal parts into which a step of the verified motion is divided to bound the deviation. Heuristic."""
_SAMPLE_PIECES = 3
"""Number of parts into which a step is divided to bound the deviation if every sample is a point of the message.

Measured: 8 parts tighten the bound by up to a tenth and take three times as long.
"""


@dataclass(frozen=True)
class Message:
    """P trajectory points between which a controller interpolates.

    Attributes:
        time: times increasing from 0, shape (P,) [s].
        positions: coordinates of the arm, shape (P, c) [rad, m].
        velocities: velocities of the coordinates, shape (P, c) [rad/s, m/s].
        accelerations: accelerations of the coordinates, shape (P, c) [rad/s², m/s²]; None if the message has none.
        coordinates: layout of the c columns.
    """

    time: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray | None
    coordinates: Coordinates

    @cached_property
    def coefficients(self) -> FloatArray:
        """Polynomial coefficients per segment, by power of the time since its start, shape (4 or 6, P − 1, c)."""
        h = np.diff(self.time)[:, None]
        v, w = self.velocities[:-1], self.velocities[1:]
        # Mean velocity over the step, with the initial velocity subtracted.
        rest = np.diff(self.positions, axis=0) / h - v
        if self.accelerations is None:
            parts = [self.positions[:-1], v, (3.0 * rest - (w - v)) / h, (w - v - 2.0 * rest) / h**2]
            return np.array(parts)
        a, b = self.accelerations[:-1], self.accelerations[1:]
        rest, gain, growth = rest / h - 0.5 * a, (w - v) / h - a, b - a
        parts = [
            self.positions[:-1],
            v,
            0.5 * a,
            (10.0 * rest - 4.0 * gain + 0.5 * growth) / h,
            (-15.0 * rest + 7.0 * gain - growth) / h**2,
            (6.0 * rest - 3.0 * gain + 0.5 * growth) / h**3,
        ]
        return np.array(parts)

    def at(self, segments: IntArray, since: FloatArray, order: int = 0) -> FloatArray:
        """Return a derivative of the interpolated coordinates at times within segments, shape (N, c).

        Args:
            segments: indices of the segments between consecutive points, shape (N,).
            since: times since the first point of each segment, shape (N,) [s].
            order: order of the derivative; 0 for the coordinates themselves.
        """
        found = np.zeros((len(since), self.positions.shape[1]))
        for power in range(len(self.coefficients) - 1, order - 1, -1):
            factor = np.prod(np.arange(power - order + 1, power + 1), dtype=np.float64)
            found = found * since[:, None] + factor * self.coefficients[power][segments]
        return found

    def at_times(self, times: FloatArray, order: int = 0) -> FloatArray:
        """Return the derivative of a given order of the interpolated coordinates at N times, shape (N, c)."""
        segments = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(self.time) - 2)
        return self.at(segments, times - self.time[segments], order)


@dataclass(frozen=True)
class _Steps:
    """An interpolated motion, divided into n short time steps.

    Attributes:
        message: the trajectory points.
        segments: index of the segment between points in which each step lies, shape (n,).
        since: time from the first point of the segment to the start of each step, shape (n,) [s].
        length: durations of the steps, shape (n,) [s].
    """

    message: Message
    segments: IntArray
    since: FloatArray
    length: FloatArray

    @classmethod
    def from_message(cls, message: Message) -> "_Steps":
        long = np.diff(message.time)
        pieces = np.ceil(long / max(LONGEST_STEP, float(message.time[-1]) / MOST_STEPS)).astype(np.intp)
        segments = np.repeat(np.arange(len(long)), pieces)
        number = np.arange(len(segments)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        length = (long / pieces)[segments]
        return cls(message, segments, number * length, length)

    @cached_property
    def ends(self) -> tuple[FloatArray, ...]:
        """Derivatives of the coordinates at both ends of all steps, for every order from 0, each of shape (2, n, c)."""
        both = (self.since, self.since + self.length)
        orders = range(len(self.message.coefficients))
        return tuple(np.array([self.message.at(self.segments, time, order) for time in both]) for order in orders)

    def greatest(self, order: int) -> FloatArray:
        """Return upper bounds on the time derivatives of c coordinates within each of n steps, shape (n, c)."""
        if order >= len(self.ends):
            return np.zeros(self.ends[0].shape[1:])
        at_ends = np.asarray(np.max(np.abs(self.ends[order]), axis=0))
        if order + 2 >= len(self.ends):
            return at_ends
        beyond = self.length[:, None] ** 2 / 8.0 * self.greatest(order + 2)
        return np.asarray(at_ends + np.where(self._keeps_sign(order + 1), 0.0, beyond))

    def _keeps_sign(self, order: int) -> BoolArray:
        """Return a mask of the steps in which the derivative f of a given order keeps its sign, shape (n, c).

        With b = h² max|f''| over a step of length h, f is at least (1 − s) f₀ + s f₁ − ½ s (1 − s) b.
        """
        first, last = self.ends[order]
        remainder = 0.5 * self.length[:, None] ** 2 * self.greatest(order + 2)
        return np.asarray((first * last >= 0.0) & (np.maximum(np.abs(first), np.abs(last)) >= remainder))

    def trajectory(self, stops: Sequence[int]) -> JointTrajectory:
        """Return the states at the ends of all steps as a trajectory that rests at given indices of message points."""
        q, v, a = (np.concatenate((self.ends[order][0], self.ends[order][1, -1:])) for order in range(3))
        time = np.append(self.message.time[self.segments] + self.since, self.message.time[-1])
        first = np.searchsorted(self.segments, np.asarray(stops, dtype=np.intp))
        return JointTrajectory(time, q, v, a, self.message.coordinates, tuple(int(k) for k in first))


def check_message_limits(
    problem: Problem,
    message: Message,
    stops: Sequence[int],
    settings: VerificationSettings,
) -> Check:
    """Check that the motion interpolated from a trajectory message keeps every limit at all times.

    Args:
        problem: the problem that the motion is to solve.
        message: the trajectory points.
        stops: indices of the points at which the arm rests at its intermediate goals.
        settings: tolerances, with lengths in metres.

    Returns:
        A check whose worst value is the greatest used fraction of a limit on bends, their rates, or efforts. The check
        also fails if the motion violates a point limit, a requirement of the base axes, or a pause. Between points,
        axes may leave their ranges by the fraction by which bends may exceed their limits.
    """
    steps = _Steps.from_message(message)
    found = _rate_shares(problem, steps, settings.bend_tolerance) + _effort_shares(problem, steps)
    dense = steps.trajectory(stops)
    states = (dense.positions, dense.velocities, dense.accelerations)
    needed = (np.zeros((len(dense.time), 0)), np.zeros((len(dense.time), 0)))
    if problem.arm.base_axes:
        needed = drive_efforts(problem.arm, problem.simulation.gravity, *states)
    drives = JointStates((), *states, *needed)
    widths = [axis.high - axis.low for axis in problem.arm.base_axes]
    past = max(settings.range_tolerance, settings.limit_tolerance * min(widths, default=0.0))
    others = [
        *check_points(problem.arm, problem.limits, dense, settings),
        *check_base_axes(problem, dense, drives, needed, replace(settings, range_tolerance=past)),
        *check_pauses(problem, dense, settings),
    ]
    worst, where = max(found)
    broken = [f"{check.name} {check.worst:.6g} {check.unit}, {check.where}" for check in others if not check.passed]
    passed = worst <= 1.0 + settings.limit_tolerance and not broken
    return Check("message limits", worst, 1.0, UNIT, broken[0] if broken else where, passed=passed)


def _rate_shares(problem: Problem, steps: _Steps, tolerance: float) -> list[tuple[float, str]]:
    """Return the greatest used fractions of bend, velocity, acceleration and jerk limits, each with its location.

    The fraction of a jerk limit is infinite for cubics, whose acceleration jumps at the points.

    Args:
        problem: the problem with the limits.
        steps: the interpolated motion, piece by piece.
        tolerance: bend of a locked joint that counts as rounding [rad].
    """
    layout = steps.message.coordinates
    limits = problem.limits
    bends = bend_revolutes(layout)
    axes = axis_limits(problem)

    def both(of_joints: FloatArray | None, of_axes: FloatArray) -> FloatArray:
        return np.append(np.full(len(bends), np.inf) if of_joints is None else of_joints[bends], of_axes)

    bounds = {
        # A locked joint may deviate by rounding.
        "bend": np.append(np.maximum(largest_bends(problem.arm), tolerance), np.full(len(axes.velocity), np.inf)),
        "velocity": both(limits.velocity, axes.velocity),
        "acceleration": both(limits.acceleration, axes.acceleration),
        "jerk": both(limits.jerk, axes.jerk),
    }
    found = []
    names = (*describe_bend_joints(layout), *layout.base_names)
    for order, (kind, bound) in enumerate(bounds.items()):
        share = steps.greatest(order) / bound
        # Cubics have jumps of acceleration at the points, so the jerk is unbounded.
        if kind == "jerk" and steps.message.accelerations is None:
            share = np.where(np.isfinite(bound) & (share > 0.0), np.inf, share)
        k, j = np.unravel_index(np.argmax(share), share.shape)
        found.append((float(share[k, j]), f"{names[j]} {kind} at {_time(steps, int(k))}"))
    return found


def _time(steps: _Steps, k: int) -> str:
    return f"t = {steps.message.time[steps.segments[k]] + steps.since[k]:.4f} s"


def _effort_shares(problem: Problem, steps: _Steps) -> list[tuple[float, str]]:
    """Return the greatest used fractions of the torque limits and of the base-force limit, each with its time.

    The fractions include the largest possible increase of an effort between the ends of a step, unless drives
    move several joints. The list is empty if no effort is limited.
    """
    limits = problem.limits
    on_axes = axis_limits(problem).effort
    bounds = [np.inf if limits.torque is None else torque_limits(problem.arm, limits.torque), on_axes]
    if limits.torque is None and not np.any(np.isfinite(on_axes)):
        return []
    gravity = problem.simulation.gravity
    at_ends = [drive_efforts(problem.arm, gravity, *(steps.ends[order][end] for order in range(3))) for end in (0, 1)]
    found = []
    of_base = "feed force" if problem.arm.feed is not None else "effort of a base axis"
    torques, on_base = zip(*at_ends, strict=True)
    efforts = (tuple(of_drives(problem.arm, each) for each in torques), on_base)
    for name, bound, values in zip(("torque", of_base), bounds, efforts, strict=True):
        if values[0].shape[-1] == 0:
            continue
        # How the efforts of arcs, and of drives that move several joints, vary within a step is not bounded.
        bow = np.zeros(len(values[0])) if problem.arm.drives is not None else _effort_bow(problem, steps)
        beyond = steps.length**2 / 8.0 * bow
        greatest = np.max(np.abs(values), axis=0)
        share = np.max((greatest.T + beyond).T.reshape(len(beyond), -1) / bound, axis=1)
        k = int(np.argmax(share))
        found.append((float(share[k]), f"{name} at {_time(steps, k)}"))
    return found


def _effort_bow(problem: Problem, steps: _Steps) -> FloatArray:
    """Return bounds on the second time derivative of every torque and of the base force, shape (n,) [N m/s², N/s²].

    No link turns faster than the sum of the magnitudes of all bend rates, and likewise for higher derivatives. A vector
    of constant length that turns at ω has derivatives of at most ω, ω' + ω², ω'' + 3 ω ω' + ω³, and so on, times its
    length; this includes the joint axes. A link is replaced by a point mass that lies its radius of gyration beyond its
    distal end.
    """
    arm = problem.arm
    joints = steps.message.coordinates.joints
    # Revolute base axes turn as joints do, at the end of the reach of the arm's own base; prismatic ones move along.
    turns = np.append(np.ones(joints), [float(axis.unit == "rad") for axis in arm.base_axes])
    w, w1, w2, w3 = (steps.greatest(order) @ turns for order in range(1, 5))
    # a: angular acceleration and its derivatives, including the rotation of the joint axes; e: those of unit vectors.
    a1 = w1 + w * w
    e1, e2 = w, a1 + w * w
    a2 = w2 + 2.0 * e1 * w1 + e2 * w
    e3 = a2 + 3.0 * w * a1 + w**3
    a3 = w3 + 3.0 * e1 * w2 + 3.0 * e2 * w1 + e3 * w
    e4 = a3 + 4.0 * w * a2 + 3.0 * a1**2 + 6.0 * a1 * w**2 + w**4
    q1, q2, q3, q4 = (steps.greatest(order) @ (1.0 - turns) for order in range(1, 5))
    base_derivatives = [q2, q3, q4]
    if arm.carrier:
        # A prismatic axis may turn, and so the way along it, of a length q that changes.
        base_derivatives[0] = q2 + 2.0 * e1 * q1
        base_derivatives[1] = q3 + 3.0 * e2 * q1 + 3.0 * e1 * q2
        base_derivatives[2] = q4 + 4.0 * e3 * q1 + 6.0 * e2 * q2 + 4.0 * e1 * q3
    fixed = PointMasses.of(arm)
    masses = all_masses(arm)
    gyration = np.sqrt(np.append(np.maximum(arm.inertia_transverse, arm.inertia_axial) / arm.masses, 0.0))
    places = np.append(arm.joint_places[1:], arm.length)
    reach = np.concatenate((places + gyration, places[fixed.link] + fixed.reach)) + base_reach(arm)
    gravity = float(np.linalg.norm(problem.simulation.gravity))
    remainder = np.zeros(len(w))
    for mass, lever in zip(masses, reach, strict=True):
        pull, pull1, pull2 = (
            lever * e2 + base_derivatives[0] + gravity,
            lever * e3 + base_derivatives[1],
            lever * e4 + base_derivatives[2],
        )
        # A moment r × m (a − g) about a rotating axis has three factors, differentiated twice; a force has no lever.
        moment = lever * pull
        moment1 = lever * (e1 * pull + pull1)
        moment2 = lever * (e2 * pull + 2.0 * e1 * pull1 + pull2)
        if arm.carrier:
            # The lever about an axis of the base changes in length as well.
            moment1 = moment1 + q1 * pull
            moment2 = moment2 + (2.0 * e1 * q1 + q2) * pull + 2.0 * q1 * pull1
        remainder += mass * np.maximum(moment2 + 2.0 * e1 * moment1 + e2 * moment, pull2)
    of_axes = max((axis.inertia for axis in arm.base_axes), default=0.0)
    rotor, friction = (float(np.max(values)) for values in (arm.rotor_inertia, arm.friction))
    rotor = max(rotor, of_axes)
    each = [np.max(steps.greatest(order), axis=1) for order in (3, 4)]
    return np.asarray(remainder + friction * each[0] + rotor * each[1])


def check_message_deviation(
    arm: Arm,
    proved: JointTrajectory,
    message: Message,
    factor: float,
    spare: float,
    gaps: Callable[[FloatArray], Sequence[Check]],
) -> Check:
    """Check that the motion interpolated from a message is close enough to the verified motion to avoid contact.

    Args:
        arm: the arm.
        proved: the verified motion, whose coordinates are linear between its T samples.
        message: the trajectory points.
        factor: duration of the message as a multiple of that of the verified motion.
        spare: allowed distance of any point of the arm from the verified motion at any time [m].
        gaps: checks the gaps of links that deviate from the verified motion by given distances in each step, shape (T −
            1, links) [m]; called only if the deviation exceeds `spare`.

    Returns:
        A check whose worst value is a bound on the distance of any point of the arm from where it is at a nearby time
        of the verified motion [m].
    """
    found = _deviation(arm, proved, message, factor, 1)
    if np.max(found) > 0.5 * spare:
        found = np.minimum(found, _deviation(arm, proved, message, factor, MOST_PIECES))
    worst = float(np.max(found))
    when = f"t = {factor * proved.time[int(np.argmax(found[:, -1]))]:.4f} s"
    if worst <= spare:
        return Check("message deviation", worst, spare, "m", when, passed=True)
    missed = [f"{check.name}: {check.where}" for check in gaps(found) if not check.passed]
    if missed:
        return Check("message deviation", worst, spare, "m", "; ".join(missed), passed=False)
    return Check("message deviation", worst, worst, "m", f"within the gap of each link, {when}", passed=True)


def _deviation(arm: Arm, proved: JointTrajectory, message: Message, factor: float, pieces: int) -> FloatArray:
    """Return bounds on the deviation of each link in every step of the verified motion, shape (T − 1, links) [m].

    Each point of the linear motion between two poses is compared with the interpolated curve at the corresponding
    fraction of the time between the two moments at which the curve is nearest to these poses. The deviation of the
    curve from its chord between these moments is bounded by its acceleration.
    """
    numbers = np.arange(pieces * (len(proved.time) - 1) + 1) / pieces
    samples = np.arange(len(proved.time))
    straight = np.column_stack([np.interp(numbers, samples, column) for column in proved.positions.T])
    times = factor * np.interp(numbers, samples, proved.time)
    # Nearness is measured with each coordinate weighted by how far it moves the tip.
    joints = message.coordinates.joints
    beyond = arm.places_from_tip[np.arange(joints) // bends_a_ball(message.coordinates)]
    weights = np.append(beyond, np.ones(len(arm.base_axes))) ** 2
    nearest = times
    for _ in range(3):
        rates = message.at_times(nearest, 1)
        square = rates**2 @ weights
        late = (rates * (message.at_times(nearest) - straight)) @ weights / np.where(square > 0.0, square, 1.0)
        nearest = np.clip(nearest - late, times[0], times[-1])
    nearest[[0, -1]] = times[[0, -1]]
    away = _travel(arm, message.coordinates, message.at_times(nearest) - straight)
    # The acceleration is a convex combination of its Bernstein coefficients, so one of them has the greatest travel.
    growth = np.max([_travel(arm, message.coordinates, each) for each in _controls(message)], axis=0)
    growth = np.concatenate((growth, np.zeros((1, arm.links))))
    early, late = np.minimum(nearest[:-1], nearest[1:]), np.maximum(nearest[:-1], nearest[1:])
    first = np.clip(np.searchsorted(message.time, early, side="left") - 1, 0, len(growth) - 2)
    last = np.clip(np.searchsorted(message.time, late, side="right"), first + 1, len(growth) - 1)
    most = np.maximum.reduceat(growth, np.stack((first, last), axis=1).ravel())[::2]
    bounds = np.maximum(away[:-1], away[1:]) + np.diff(nearest)[:, None] ** 2 / 8.0 * most
    return np.asarray(np.max(bounds.reshape(-1, pieces, arm.links), axis=1))


def _controls(message: Message) -> list[FloatArray]:
    """Return the Bernstein coefficients of the acceleration between consecutive points, each of shape (P − 1, c)."""
    h = np.diff(message.time)[:, None]
    powers = [k * (k - 1) * part * h ** (k - 2) for k, part in enumerate(message.coefficients) if k > 1]
    if len(powers) == 2:
        return [powers[0], powers[0] + powers[1]]
    a, b, c, d = powers
    return [a, a + b / 3.0, a + (2.0 * b + c) / 3.0, a + b + c + d]


def _travel(arm: Arm, layout: Coordinates, change: FloatArray) -> FloatArray:
    """Return bounds on the distances by which changes of coordinates (N, c) move the links, shape (N, links) [m]."""
    bends = change[:, : layout.joints]
    if bends_a_ball(layout) > 1:
        bends = np.linalg.norm(bends.reshape(len(bends), arm.links, -1), axis=2)
    moved = np.cumsum(arm.lengths * np.abs(np.cumsum(bends, axis=1)), axis=1)
    on_axes = np.abs(change[:, layout.joints :])
    if arm.carrier:
        on_axes = on_axes * axis_levers(arm)
    return np.asarray(moved + np.sum(on_axes, axis=1, keepdims=True))


def interpolation_deviation(arm: Arm, trajectory: JointTrajectory) -> float:
    """Return a bound on the deviation of a controller that interpolates all samples of the verified motion [m].

    The controller joins samples by cubics or quintics. No point of the arm is then farther than the bound from where it
    is at a nearby time of the verified motion.

    Args:
        arm: the arm.
        trajectory: the verified motion, with at least two samples.
    """
    points = (trajectory.time, trajectory.positions, trajectory.velocities)
    messages = [Message(*points, gains, trajectory.coordinates) for gains in (None, trajectory.accelerations)]
    return max(float(np.max(_deviation(arm, trajectory, message, 1.0, _SAMPLE_PIECES))) for message in messages)
