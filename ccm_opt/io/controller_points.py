"""Trajectory points for a joint trajectory controller, chosen from the samples of a plan.

A controller interpolates points that have positions and velocities by cubics, whose accelerations may exceed those of
the plan where the plan's accelerations jump. Points are therefore chosen one after the other, each as far from the
previous one as possible while the cubic between the two respects all limits and stays near the plan. Where not even
neighbouring samples allow this, the motion is slowed down slightly. A plan of limited jerk has continuous
accelerations, so its points also have accelerations and are interpolated by quintics.
"""

import json
import logging
import math
import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates, DriveLimits
from ccm_opt.robot.frames import drive_torque_limits, drive_torques
from ccm_opt.robot.points import MovingPoint, point_at_arc_length
from ccm_opt.verification.interpolated_message import Message, check_message_deviation, check_message_limits
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.selfcollision import check_self_collision
from ccm_opt.verification.tool_chain import arm_reaching_bodies, motion_of
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.verification.wall_clearance import check_walls

logger = logging.getLogger(__name__)

_USED = 0.999
"""Fraction of the limits that interpolating polynomials may use at samples; the rest is a reserve for the times between
samples. Heuristic."""
_DEVIATION = 1e-5
"""Approximate maximum deviation from the plan, as a fraction of the arm's length. Heuristic: below the repeatability of
drives."""
_FARTHEST = 50
"""Maximum number of samples from one point to the next. Heuristic: files are small, and choosing takes as long as
verifying."""
_STILL = 1e-9
"""Allowed deviation of a coordinate that rests in the plan, as in a guide tube or during a pause [rad, m]."""
_SLOWER = 1.002
"""Safety factor on the factor by which the motion is slowed down so that its samples respect all limits. Heuristic."""
_FACTOR_STEPS = 1e4
"""Reciprocal of the step to which time factors are rounded up, so that a reader of the file recovers them exactly."""
_ATTEMPTS = 12
"""Maximum number of attempts to choose points, each closer to the plan or slower, until the checks pass. Heuristic."""


@dataclass(frozen=True)
class ControllerPoints:
    """The P samples of a plan that are sent to a controller as trajectory points.

    Attributes:
        samples: indices of the points among the samples of the plan, shape (P,).
        factor: ratio, at least 1, of the duration of the points to that of the plan.
        trajectory: the points in the arm's coordinates, at times of whole nanoseconds.
        joints: the points as states of all revolute joints, with efforts.
        smooth: whether points have accelerations, so that a controller interpolates them by quintics.
    """

    samples: IntArray
    factor: float
    trajectory: JointTrajectory
    joints: JointStates
    smooth: bool

    @property
    def message(self) -> Message:
        """Times, positions, velocities and, with quintics, accelerations that the controller receives."""
        motion = self.trajectory
        accelerations = motion.accelerations if self.smooth else None
        return Message(motion.time, motion.positions, motion.velocities, accelerations, motion.coordinates)


def spared(problem: Problem, checks: Iterable[Check]) -> float:
    """Return how far any point of the arm may deviate from a plan without violating a required clearance [m].

    For clearance between links this is half the spare distance, since both links may deviate. The result is at least
    the contact tolerance.

    Args:
        problem: the problem.
        checks: verifier's checks of the plan; their minimum clearances may be too large by the report resolution.
    """
    share = {"wall clearance": 1.0, "self-collision": 0.5}  # two links may both deviate
    resolution = DEFAULT_VERIFICATION.for_problem(problem).report_resolution
    spare = [share[check.name] * (check.worst - check.limit - resolution) for check in checks if check.name in share]
    return max(min((value for value in spare if not np.isnan(value)), default=np.inf), problem.contact_tolerance)


def slowed(
    problem: Problem, plan: JointTrajectory, joints: JointStates, factor: float
) -> tuple[JointTrajectory, JointStates]:
    """Return a plan slowed down by a constant factor, with joint torques and feed force computed again.

    Args:
        problem: the problem, which gives arm and gravity.
        plan: the planned motion.
        joints: states of all revolute joints over the motion.
        factor: ratio of the new to the old duration, at least 1.
    """
    if factor == 1.0:
        return plan, joints
    velocities, accelerations = plan.velocities / factor, plan.accelerations / factor**2
    slower = replace(plan, time=factor * plan.time, velocities=velocities, accelerations=accelerations)
    states = (plan.positions, velocities, accelerations)
    torques, forces = drive_efforts(problem.arm, problem.simulation.gravity, *states)
    return slower, replace(
        joints,
        velocities=joints.velocities / factor,
        accelerations=joints.accelerations / factor**2,
        torques=torques,
        base_forces=forces,
    )


def message_checks(
    problem: Problem, plan: JointTrajectory, message: Message, samples: IntArray, factor: float, spare: float
) -> tuple[Check, Check]:
    """Return two checks of a controller's interpolation of points: that it respects all limits and stays near the plan.

    Args:
        problem: the problem.
        plan: the planned motion.
        message: the P trajectory points.
        samples: indices of the points among the samples of the plan, shape (P,).
        factor: factor by which the motion of the points is slower than the plan.
        spare: allowed deviation of any point of the arm from the plan [m].
    """
    settings = DEFAULT_VERIFICATION.for_problem(problem)
    stops = np.searchsorted(samples, plan.stops).tolist()
    limits = check_message_limits(problem, message, stops, settings)
    gaps = partial(_check_link_gaps, problem, plan)
    return limits, check_message_deviation(arm_reaching_bodies(problem.arm), plan, message, factor, spare, gaps)


def _check_link_gaps(problem: Problem, plan: JointTrajectory, deviation: FloatArray) -> list[Check]:
    """Return the checks that links which deviate from a plan still keep the required clearances, up to a tolerance.

    It is twice the contact tolerance: one for the plan, one for the deviation. Self-collision is checked only if the
    problem requires it.

    Args:
        problem: the problem.
        plan: the planned motion of n links, with T samples.
        deviation: upper bound on the deviation of each link between two samples, shape (T − 1, n) [m].
    """
    settings = DEFAULT_VERIFICATION.for_problem(problem)
    # The plan may fall short of a gap by one tolerance, and the message may deviate by another.
    settings = replace(settings, contact_tolerance=2.0 * settings.contact_tolerance)
    motion = motion_of(problem.arm, plan.time, plan.positions, deviation)
    to_walls = check_walls(motion, problem.workspace, settings)
    return [to_walls, check_self_collision(motion, settings)] if problem.arm.self_collision else [to_walls]


def controller_points(
    problem: Problem, plan: JointTrajectory, joints: JointStates, checks: Iterable[Check]
) -> ControllerPoints:
    """Return trajectory points for a controller, chosen from a plan's samples; warn if no choice passes the checks.

    Args:
        problem: the problem.
        plan: the planned motion.
        joints: states of all revolute joints over the motion.
        checks: verifier's checks of the plan, which hold its minimum clearances.
    """
    spare = spared(problem, checks)
    tolerance = _DEVIATION * problem.arm.length
    smooth = problem.limits.jerk is not None or problem.limits.feed_jerk is not None
    factor = 1.0
    for _ in range(_ATTEMPTS):
        slower, states = slowed(problem, plan, joints, factor)
        choice = _Choice(problem, slower, tolerance, smooth=smooth)
        samples, needed = choice.samples()
        found = points_at(slower, states, samples, factor, smooth=smooth)
        if needed <= 1.0:
            limits, deviation = message_checks(problem, plan, found.message, samples, factor, spare)
            if limits.passed and deviation.passed:
                return found
            tolerance *= 1.0 if deviation.passed else 0.25
            needed = 1.0 if limits.passed else _SLOWER
        factor = np.ceil(_FACTOR_STEPS * factor * (needed * _SLOWER if needed > 1.0 else 1.0)) / _FACTOR_STEPS
    logger.warning(
        "the points of the message, as a controller interpolates them, still exceed a limit or the "
        "clearance; 'ccm-opt check' tells by how much"
    )
    return found


def points_at(
    slower: JointTrajectory,
    joints: JointStates,
    samples: IntArray,
    factor: float,
    *,
    smooth: bool,
    time: FloatArray | None = None,
) -> ControllerPoints:
    """Return trajectory points at given samples of a plan that is already slowed down.

    Args:
        slower: the slowed plan.
        joints: states of all revolute joints over the slowed plan.
        samples: indices of the P samples, shape (P,).
        factor: factor by which the plan is slowed down.
        smooth: whether the points have accelerations.
        time: times of the points, shape (P,) [s]; None for the times of the samples, rounded to whole nanoseconds.
    """
    time = np.round(slower.time[samples], 9) if time is None else time
    # Positions are extrapolated to the rounded times, so that short steps get no spurious accelerations.
    late = (time - slower.time[samples])[:, None]
    motion = JointTrajectory(
        time,
        slower.positions[samples] + late * slower.velocities[samples],
        slower.velocities[samples],
        slower.accelerations[samples],
        slower.coordinates,
    )
    states = replace(
        joints,
        angles=joints.angles[samples] + late * joints.velocities[samples],
        velocities=joints.velocities[samples],
        accelerations=joints.accelerations[samples],
        torques=joints.torques[samples],
        base_forces=joints.base_forces[samples],
    )
    return ControllerPoints(samples, factor, motion, states, smooth)


@dataclass(frozen=True)
class _Choice:
    """Greedy choice of trajectory points from the T samples of a plan.

    Attributes:
        problem: the problem.
        plan: the planned motion, possibly slowed down.
        tolerance: allowed deviation of interpolating polynomials from the path of the plan, approximate [m].
        smooth: whether the interpolating polynomials are quintics instead of cubics.
    """

    problem: Problem
    plan: JointTrajectory
    tolerance: float
    smooth: bool

    def samples(self) -> tuple[IntArray, float]:
        """Return the indices of the chosen samples, shape (P,), and the maximum used between two of them.

        Where no polynomial over several samples respects limits and tolerance, neighbouring samples are chosen.
        """
        chosen, most = [0], 0.0
        for end in self._corners[1:]:
            while chosen[-1] < end:
                farthest, used = self._farthest(chosen[-1], int(end))
                chosen.append(farthest)
                most = max(most, used)
        return np.array(chosen, dtype=np.intp), most

    def _farthest(self, first: int, end: int) -> tuple[int, float]:
        """Return the index of a sample to which a polynomial from sample ``first`` respects limits and tolerance.

        It is found by bisection up to sample ``end``, so approximately the farthest. If there is none, the result is
        ``first + 1``. The second value is what the polynomial uses.
        """
        good, bad, tried = first + 1, min(first + _FARTHEST, end), min(first + _FARTHEST, end)
        used = {}
        while tried not in used:
            used[tried] = self.used(first, tried)
            good, bad = (tried, bad) if used[tried] <= 1.0 else (good, tried)
            tried = max((good + bad) // 2, first + 1)
        return good, used[good]

    @cached_property
    def _corners(self) -> IntArray:
        """Indices of the samples that must be points: start, goal, stops, and where the arm halts or sets off."""
        still = np.all(self._rests, axis=1)
        changes = 1 + np.flatnonzero(still[1:] != still[:-1])
        return np.unique(np.concatenate(([0, len(self.plan.time) - 1], self.plan.stops, changes))).astype(np.intp)

    @cached_property
    def _rests(self) -> FloatArray:
        """Mask of coordinates that rest from a sample to the next, for each of c coordinates, shape (T − 1, c)."""
        return np.asarray(np.abs(np.diff(self.plan.positions, axis=0)) <= 1e-3 * _STILL)

    @cached_property
    def _ranges(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest value that each of c coordinates may take between points, each of shape (c,) [rad, m].

        They are the limits with half of the verifier's tolerances, unless the plan's own values are farther apart.
        """
        arm, plan = self.problem.arm, self.plan
        settings = DEFAULT_VERIFICATION.for_problem(self.problem)
        slack = np.full(len(arm.upper_limits), settings.range_tolerance)
        of_bends = settings.limit_tolerance * arm.upper_limits[plan.coordinates.bends]
        slack[plan.coordinates.bends] = np.maximum(of_bends, settings.bend_tolerance)
        low, high = arm.lower_limits - 0.5 * slack, arm.upper_limits + 0.5 * slack
        return np.minimum(low, np.min(plan.positions, axis=0)), np.maximum(high, np.max(plan.positions, axis=0))

    @cached_property
    def _limits(self) -> DriveLimits:
        return self.problem.limits.of_coordinates(self.plan.coordinates)

    @cached_property
    def _effort_limits(self) -> FloatArray:
        return self.problem.limits.of_drives(self.problem.arm.coordinates).effort

    @cached_property
    def _limited_points(self) -> list[tuple[MovingPoint, float, float]]:
        arm = self.problem.arm
        return [
            (point_at_arc_length(arm, limit.at), limit.velocity, limit.acceleration)
            for limit in self.problem.limits.points
        ]

    def used(self, first: int, last: int) -> float:
        """Return the maximum fraction of any limit, or of the tolerance, that the polynomial between two samples uses.

        The polynomial is evaluated at all samples from ``first`` to ``last``. Of accelerations the square root of the
        fraction counts, of jerks the cube root, so that all limits hold once the motion is slowed down by the result.
        The result is inf if a coordinate moves that rests in the plan, or leaves its range.
        """
        plan, span = self.plan, slice(first, last + 1)
        h = plan.time[last] - plan.time[first]
        orders = 3 if self.smooth else 2
        given = (plan.positions, plan.velocities, plan.accelerations)[:orders]
        ends = np.array([[values[k] * h**order for order, values in enumerate(given)] for k in (first, last)])
        controls = _UNIT_CURVES[orders] @ ends.reshape(2 * orders, -1)
        powers = np.vander((plan.time[span] - plan.time[first]) / h, 2 * orders, increasing=True)
        curve = []
        for order in range(orders + 1):
            curve.append(powers[:, : 2 * orders - order] @ controls / h**order)
            controls = np.arange(1, len(controls))[:, None] * controls[1:]
        q, v, a = curve[:3]

        limits = self._limits
        shares = [np.max(np.abs(v) / limits.velocity), np.sqrt(np.max(np.abs(a) / limits.acceleration))]
        if self.smooth:
            shares.append(np.cbrt(np.max(np.abs(curve[3]) / limits.jerk)))
        for point, velocity, acceleration in self._limited_points:
            shares.append(np.max(np.linalg.norm(point.velocity(q, v), axis=1)) / velocity)
            shares.append(np.sqrt(np.max(np.linalg.norm(point.acceleration(q, v, a), axis=1)) / acceleration))
        off = q - plan.positions[span]
        if np.any(np.abs(off[:-1][self._rests[first:last]]) > _STILL):
            return np.inf
        low, high = self._ranges
        if np.any((q[1:-1] < low) | (q[1:-1] > high)):
            return np.inf
        # Deviation along the path is only a shift in time, so it is removed.
        rates = plan.velocities[span]
        square = np.einsum("tc,tc->t", rates, rates)
        along = np.einsum("tc,tc->t", rates, off) / np.where(square > 0.0, square, 1.0)
        across = plan.coordinates.travel(off - along[:, None] * rates, self.problem.arm.lengths)
        used = float(max(max(shares) / _USED, np.max(across) / self.tolerance))
        return used if used > 1.0 else max(used, *self._efforts_used(q, v, a))

    def _efforts_used(self, *states: FloatArray) -> tuple[float, float]:
        problem, limits = self.problem, self._effort_limits
        if not np.any(np.isfinite(limits)):
            return 0.0, 0.0
        torques, on_axes = drive_efforts(problem.arm, problem.simulation.gravity, *states)
        revolutes = problem.arm.coordinates.revolutes
        of_arm = drive_torque_limits(problem.arm, limits[:revolutes])
        bending = np.max(np.abs(drive_torques(problem.arm, torques)) / of_arm) / _USED
        return float(bending), float(np.max(np.abs(on_axes) / limits[revolutes:], initial=0.0)) / _USED


def _unit_curve(orders: int) -> FloatArray:
    """Return the matrix that maps end conditions to the coefficients of a polynomial on [0, 1], shape (2 n, 2 n).

    The end conditions are value and derivatives at 0, then at 1, with n = ``orders`` conditions at each end. The
    coefficients are in order of increasing power.
    """
    rows = np.eye(2 * orders)
    for order in range(orders):
        rows[order, order] = math.factorial(order)
        rows[orders + order] = [math.perm(power, order) for power in range(2 * orders)]
    return np.asarray(np.linalg.inv(rows))


_UNIT_CURVES = {orders: _unit_curve(orders) for orders in (2, 3)}
"""Matrices that map end conditions to polynomial coefficients, by number of conditions at each end: 2 for cubics, 3 for
quintics; see ``_unit_curve``."""


QUANTITIES = ("angle", "velocity", "acceleration", "torque")
_FEED_QUANTITIES = ("position", "velocity", "acceleration", "force")
ROS_FIELDS = ("positions", "velocities", "accelerations", "effort")
_WHOLE = re.compile(r" (-?\d+)(?![\d.])")
"""An integer without decimal point after a blank; an exponent may follow."""


def trajectory_texts(
    points: ControllerPoints, arm: Arm | None = None, *, bends_only: bool = False, effort: bool = False
) -> tuple[str, str]:
    """Return trajectory points for a controller as CSV text and as a ROS message in YAML; SI units, radians.

    Both contain equal numbers of twelve digits. Every number has a decimal point: fields of ROS messages accept floats
    only, and YAML reads ``1e-05`` as a text.

    Args:
        points: the points.
        arm: the arm, whose drives get columns of their own where they move several joints together.
        bends_only: whether revolute joints that never bend the arm are left out.
        effort: whether the message includes efforts, which controllers from ROS 2 Humble on refuse.

    Returns:
        The text of ``trajectory.csv``: ``time`` and a column ``<joint>_<quantity>`` for every joint and quantity; and
        of ``trajectory.yaml``: ``joint_names`` and ``points`` as in ROS 2 ``trajectory_msgs/JointTrajectory``, with
        accelerations if jerk is limited. A feed axis is the first joint, ``feed``, with the columns
        ``feed_position``, …, ``feed_force`` [m, N].
        The columns of ``drive_columns`` are the last of the CSV text.
    """
    motion = points.trajectory
    joints = bending_joints(points.joints, motion.coordinates) if bends_only else points.joints
    names, tables = trajectory_tables(motion, joints)
    rows = [number_rows(table) for table in tables]
    coordinates = motion.coordinates
    slides = [name for name, unit in zip(coordinates.base_names, coordinates.base_units, strict=True) if unit == "m"]
    written = {"positions", "velocities", *(["accelerations"] * points.smooth), *(["effort"] * effort)}
    drives = {} if arm is None else drive_columns(arm, motion, points.joints.torques)
    table = _csv(motion.time, names, rows, slides)
    if drives:
        beside = [",".join(drives), *number_rows(np.column_stack(list(drives.values()))), ""]
        table = (line and f"{line},{more}" for line, more in zip(table, beside, strict=True))
    return "\n".join(table), "\n".join(_yaml(motion.time, names, rows, written))


def drive_columns(arm: Arm, motion: JointTrajectory, torques: FloatArray) -> dict[str, FloatArray]:
    """Return what the drives of an arm do where they move several joints together, by names of columns; else nothing.

    For each drive its value, velocity, acceleration and torque; for sections that bend evenly curvature [1/m] and
    azimuth [rad], and for their tendons length [m] and tension [N].

    Args:
        arm: the arm.
        motion: the motion, of T samples.
        torques: torques of all revolutes, shape (T, 3 links) [N m].

    Returns:
        Columns of shape (T,).
    """
    coupled, sections = arm.drives, arm.sections
    if coupled is None:
        return {}
    values, efforts = coupled.drives(motion.bend_angles), drive_torques(arm, torques)
    rates = (coupled.drives(each) for each in (motion.bend_velocities, motion.bend_accelerations))
    columns: dict[str, FloatArray] = {}
    for what, table in zip(QUANTITIES, (values, *rates, efforts), strict=True):
        columns |= {f"{name}_{what}": column for name, column in zip(coupled.drive_names, table.T, strict=True)}
    if sections is None:
        return columns
    names = [f"section{k}" for k in range(1, len(sections.counts) + 1)]
    for what, table in (("curvature", sections.curvatures(values)), ("azimuth", sections.azimuths(values))):
        columns |= {f"{name}_{what}": column for name, column in zip(names, table.T, strict=True)}
    for what, table in (
        ("length", sections.tendon_lengths(values)),
        ("tension", sections.tendon_tensions(efforts)),
    ):
        # Tensions have no columns unless every section has tendons.
        columns |= {f"{name}_{what}": column for name, column in zip(sections.tendon_names, table.T, strict=False)}
    return columns


def number_rows(table: FloatArray) -> list[str]:
    """Return the text of each row of a table of numbers, in the format ``%.12g`` and joined by commas.

    Every number has a decimal point. In columns that contain only zeros, no zero has a sign.

    Args:
        table: numbers, shape (rows, columns).
    """
    # Most columns are revolutes that a planar motion does not move; they need no formatting.
    moving = np.any(table != 0.0, axis=0)
    row = ",".join(" %.12g " if moves else "0.0" for moves in moving)
    whole = "\n".join([row % tuple(values) for values in table[:, moving].tolist()])
    # Most numbers without a point are zeros, which plain replacement handles much faster than the regular expression.
    whole = whole.replace(" 0 ", "0.0").replace(" -0 ", "-0.0")
    return _WHOLE.sub(r"\1.0", whole).replace(" ", "").split("\n")


def trajectory_tables(trajectory: JointTrajectory, joints: JointStates) -> tuple[tuple[str, ...], list[FloatArray]]:
    """Return the names of the m joints, and tables of their positions, velocities, accelerations and efforts.

    Each table has shape (T, m) for T samples [rad, m, s, N]; a feed axis is the first joint.
    """
    tables = [joints.angles, joints.velocities, joints.accelerations, joints.torques]
    base = [
        trajectory.base_positions,
        trajectory.base_velocities,
        trajectory.base_accelerations,
        joints.base_forces,
    ]
    names = (*trajectory.coordinates.base_names, *joints.names)
    return names, [np.column_stack(pair) for pair in zip(base, tables, strict=True)]


def bending_joints(joints: JointStates, coordinates: Coordinates) -> JointStates:
    """Return the states of only those revolute joints that bend the arm.

    In the plane these are the second revolute of every ball joint, in space the first and the second.
    """
    bending = coordinates.drive_numbers[coordinates.bends]
    return replace(
        joints,
        names=tuple(joints.names[drive] for drive in bending),
        angles=joints.angles[:, bending],
        velocities=joints.velocities[:, bending],
        accelerations=joints.accelerations[:, bending],
        torques=joints.torques[:, bending],
    )


def _csv(time: FloatArray, names: tuple[str, ...], columns: list[list[str]], slides: Collection[str]) -> Iterator[str]:
    quantities = zip(QUANTITIES, _FEED_QUANTITIES, strict=True)
    headings = [f"{name}_{feed if name in slides else joint}" for joint, feed in quantities for name in names]
    yield ",".join(["time", *headings])
    for now, *rows in zip(time.tolist(), *columns, strict=True):
        yield ",".join([f"{now:.12g}", *rows])
    yield ""


def _yaml(time: FloatArray, names: tuple[str, ...], columns: list[list[str]], written: set[str]) -> Iterator[str]:
    yield f"joint_names: {json.dumps(list(names))}"
    yield "points:"
    for now, *rows in zip(time.tolist(), *columns, strict=True):
        seconds, nanoseconds = divmod(round(now * 1e9), 1_000_000_000)
        yield f"- time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}"
        fields = zip(ROS_FIELDS, rows, strict=True)
        yield from (f"  {field}: [{row}]" for field, row in fields if field in written)
    yield ""
