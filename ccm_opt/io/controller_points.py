"""Which samples of a plan a controller is given, so that what it makes of them keeps every limit, and their texts.

A message with positions and velocities is joined by cubics, whose accelerations need not be those of the plan: where
these jump between two points, a cubic passes them. So points are chosen one after the other, each as far from the last
as the cubic between them keeps the limits and stays near the plan. Where not even neighbouring samples do, time is made
a little longer. A plan of limited jerk has accelerations that do not jump: it is joined by quintics.
"""

import itertools
import json
import logging
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.io.robot_models import FEED
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.coordinates import Coordinates
from ccm_opt.robot.points import MovingPoint, point_of
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.interpolated_message import Message, check_message_deviation, check_message_limits
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.selfcollision import check_self_collision
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.verification.wall_clearance import check_walls

logger = logging.getLogger(__name__)

_USED = 0.999
"""Share of the limits that curves may use at the samples; the rest is for the time between them. Taste."""
_DEVIATION = 1e-5
"""Greatest deviation from the plan, about, as a share of the arm's length. Taste: less than what drives repeat."""
_FARTHEST = 50
"""Samples from a point to the next at most. Taste: files are small then, and choosing takes as long as verifying."""
_STILL = 1e-9
"""What a coordinate that rests in the plan may be off its place, as in a guide tube or a pause [rad, m]."""
_SLOWER = 1.002
"""By how much time is made longer beyond what the samples need. Taste."""
_FACTOR_STEPS = 1e4
"""Factors on time are multiples of a ten-thousandth, so that a reader finds them exactly."""
_ATTEMPTS = 12
"""Choices of points, each nearer to the plan or slower than the one before, until the checks hold. Taste."""


@dataclass(frozen=True)
class ControllerPoints:
    """The points for a controller.

    Attributes:
        samples: numbers of the samples of the plan that are points, shape (P,).
        factor: by which time is longer than in the plan.
        trajectory: the points, their times whole nanoseconds.
        joints: the same for all drives.
        smooth: whether accelerations belong to the message, so that points are joined by quintics.
    """

    samples: IntArray
    factor: float
    trajectory: JointTrajectory
    joints: JointStates
    smooth: bool

    @property
    def message(self) -> Message:
        """What a controller is given."""
        motion = self.trajectory
        accelerations = motion.accelerations if self.smooth else None
        return Message(motion.time, motion.positions, motion.velocities, accelerations, motion.coordinates)


def spared(problem: Problem, checks: Iterable[Check]) -> float:
    """Return how far any point of the arm may be from a plan before a gap can be missing [m].

    Args:
        problem: what was asked.
        checks: of the plan; what is reported as its least gap may be a resolution above it.
    """
    share = {"wall clearance": 1.0, "self-collision": 0.5}  # of two links both may be off
    resolution = DEFAULT_VERIFICATION.for_problem(problem).report_resolution
    spare = [share[check.name] * (check.worst - check.limit - resolution) for check in checks if check.name in share]
    return max(min((value for value in spare if not np.isnan(value)), default=np.inf), problem.contact_tolerance)


def slowed(
    problem: Problem, plan: JointTrajectory, joints: JointStates, factor: float
) -> tuple[JointTrajectory, JointStates]:
    """Return a plan that takes longer by a factor; efforts are reckoned anew."""
    if factor == 1.0:
        return plan, joints
    velocities, accelerations = plan.velocities / factor, plan.accelerations / factor**2
    slower = replace(plan, time=factor * plan.time, velocities=velocities, accelerations=accelerations)
    states = (plan.positions, velocities, accelerations)
    torques, force = drive_efforts(problem.arm, problem.simulation.gravity, *states)
    return slower, replace(
        joints,
        velocities=joints.velocities / factor,
        accelerations=joints.accelerations / factor**2,
        torques=torques,
        base_forces=np.repeat(force[:, None], joints.base_forces.shape[1], axis=1),
    )


def message_checks(
    problem: Problem, plan: JointTrajectory, message: Message, samples: IntArray, factor: float, spare: float
) -> tuple[Check, Check]:
    """Check that a controller that joins points of a plan keeps its limits, and stays near it.

    Args:
        problem: what was asked.
        plan: the motion in the arrays.
        message: the points.
        samples: their numbers among the samples of the plan.
        factor: by which the message takes longer.
        spare: how far it may be from the plan [m].
    """
    settings = DEFAULT_VERIFICATION.for_problem(problem)
    stops = np.searchsorted(samples, plan.stops).tolist()
    limits = check_message_limits(problem, message, stops, settings)
    gaps = partial(_check_link_gaps, problem, plan)
    return limits, check_message_deviation(problem.arm, plan, message, factor, spare, gaps)


def _check_link_gaps(problem: Problem, plan: JointTrajectory, deviation: FloatArray) -> list[Check]:
    """Check that links that are off a plan, shape (T − 1, links) [m], keep its gaps to twice the contact tolerance."""
    settings = DEFAULT_VERIFICATION.for_problem(problem)
    # A plan may lack one tolerance of a gap, and a message may be one tolerance off it.
    settings = replace(settings, contact_tolerance=2.0 * settings.contact_tolerance)
    motion = ChainMotion(problem.arm, plan.time, plan.positions, deviation)
    to_walls = check_walls(motion, problem.workspace, settings)
    return [to_walls, check_self_collision(motion, settings)] if problem.arm.self_collision else [to_walls]


def controller_points(
    problem: Problem, plan: JointTrajectory, joints: JointStates, checks: Iterable[Check]
) -> ControllerPoints:
    """Choose the samples of a plan that a controller is given.

    Args:
        problem: what was asked.
        plan: the motion.
        joints: the same for all drives.
        checks: of the plan, which know the least gaps.
    """
    spare = spared(problem, checks)
    tolerance = _DEVIATION * problem.arm.length
    smooth = problem.limits.jerk is not None or problem.limits.feed_jerk is not None
    factor = 1.0
    for _ in range(_ATTEMPTS):
        slower, states = slowed(problem, plan, joints, factor)
        choice = _Choice(problem, slower, tolerance, smooth=smooth)
        samples = choice.samples()
        needed = max(choice.used(i, j) for i, j in itertools.pairwise(samples.tolist()))
        found = points_at(slower, states, samples, factor, smooth=smooth)
        if needed <= 1.0:
            limits, deviation = message_checks(problem, plan, found.message, samples, factor, spare)
            if limits.passed and deviation.passed:
                return found
            tolerance *= 1.0 if deviation.passed else 0.25
            needed = 1.0 if limits.passed else _SLOWER
        factor = np.ceil(_FACTOR_STEPS * factor * (needed * _SLOWER if needed > 1.0 else 1.0)) / _FACTOR_STEPS
    logger.warning(
        "the points of the message were not brought within limits and gaps as a controller interpolates them: "
        "'ccm-opt check' says by how much"
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
    """Make points of some samples of a plan that takes longer by a factor.

    ``time`` is when they are [s], shape (P,); at the nearest whole nanoseconds unless it is given.
    """
    time = np.round(slower.time[samples], 9) if time is None else time
    # Where the arm is at the whole nanosecond, so that short steps have no false accelerations.
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
    """Points of a plan, one after the other.

    Attributes:
        problem: what was asked.
        plan: the motion.
        tolerance: how far a curve may be from the way of the plan, about [m].
        smooth: whether curves are quintics.
    """

    problem: Problem
    plan: JointTrajectory
    tolerance: float
    smooth: bool

    def samples(self) -> IntArray:
        """Return the numbers of the samples that are points; neighbours where no curve fits."""
        chosen = [0]
        for end in self._corners[1:]:
            while chosen[-1] < end:
                chosen.append(self._farthest(chosen[-1], int(end)))
        return np.array(chosen, dtype=np.intp)

    def _farthest(self, first: int, end: int) -> int:
        """Return the about the farthest sample that a curve fits to, and the next one at least."""
        good = first + 1
        bad = tried = min(first + _FARTHEST, end)
        if self.used(first, tried) <= 1.0:
            return tried
        while bad - good > 1:
            tried = (good + bad) // 2
            good, bad = (tried, bad) if self.used(first, tried) <= 1.0 else (good, tried)
        return good

    @cached_property
    def _corners(self) -> IntArray:
        """Samples that are points in any case: ends, stops, and where the arm comes to rest and leaves."""
        still = np.all(self._rests, axis=1)
        changes = 1 + np.flatnonzero(still[1:] != still[:-1])
        return np.unique(np.concatenate(([0, len(self.plan.time) - 1], self.plan.stops, changes))).astype(np.intp)

    @cached_property
    def _rests(self) -> FloatArray:
        """Which coordinates rest from sample to sample, shape (T − 1, c)."""
        return np.asarray(np.abs(np.diff(self.plan.positions, axis=0)) <= 1e-3 * _STILL)

    @cached_property
    def _limited_points(self) -> list[tuple[MovingPoint, float, float]]:
        arm = self.problem.arm
        return [(point_of(arm, limit.at), limit.velocity, limit.acceleration) for limit in self.problem.limits.points]

    def used(self, first: int, last: int) -> float:
        """The greatest share of limits and tolerance that the curve between two samples takes at those between them.

        Shares of accelerations and the like are such that a time longer by them is what is needed.
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

        limits = self.problem.limits.of_coordinates(plan.coordinates)
        shares = [np.max(np.abs(v) / limits.velocity), np.sqrt(np.max(np.abs(a) / limits.acceleration))]
        if self.smooth:
            shares.append(np.cbrt(np.max(np.abs(curve[3]) / limits.jerk)))
        for point, velocity, acceleration in self._limited_points:
            shares.append(np.max(np.linalg.norm(point.velocity(q, v), axis=1)) / velocity)
            shares.append(np.sqrt(np.max(np.linalg.norm(point.acceleration(q, v, a), axis=1)) / acceleration))
        off = q - plan.positions[span]
        if np.any(np.abs(off[:-1][self._rests[first:last]]) > _STILL):
            return np.inf
        # What is off along the way is another time on it.
        rates = plan.velocities[span]
        square = np.einsum("tc,tc->t", rates, rates)
        along = np.einsum("tc,tc->t", rates, off) / np.where(square > 0.0, square, 1.0)
        across = plan.coordinates.travel(off - along[:, None] * rates, self.problem.arm.link_length)
        used = float(max(max(shares) / _USED, np.max(across) / self.tolerance))
        return used if used > 1.0 else max(used, *self._efforts_used(q, v, a))

    def _efforts_used(self, *states: FloatArray) -> tuple[float, float]:
        limits = self.problem.limits
        if limits.torque is None and limits.feed_force is None:
            return 0.0, 0.0
        torques, force = drive_efforts(self.problem.arm, self.problem.simulation.gravity, *states)
        torque = 0.0 if limits.torque is None else float(np.max(np.abs(torques) / limits.torque))
        return torque / _USED, float(np.max(np.abs(force))) / (limits.feed_force or np.inf) / _USED


def _unit_curve(orders: int) -> FloatArray:
    """What makes power coefficients on [0, 1] of values and derivatives at 0, and then at 1, shape (2 n, 2 n)."""
    rows = np.eye(2 * orders)
    for order in range(orders):
        rows[order, order] = math.factorial(order)
        rows[orders + order] = [math.perm(power, order) for power in range(2 * orders)]
    return np.asarray(np.linalg.inv(rows))


_UNIT_CURVES = {orders: _unit_curve(orders) for orders in (2, 3)}
"""For cubics and quintics."""


QUANTITIES = ("angle", "velocity", "acceleration", "torque")
_FEED_QUANTITIES = ("position", "velocity", "acceleration", "force")
ROS_FIELDS = ("positions", "velocities", "accelerations", "effort")
_WHOLE = re.compile(r" (-?\d+)(?![\d.])")
"""A number without a point, or the digits in front of its exponent, behind a space."""


def trajectory_texts(points: ControllerPoints, *, bends_only: bool = False, effort: bool = False) -> tuple[str, str]:
    """Write the points for a controller as CSV and as YAML; SI units, radians.

    Both have the same numbers, of twelve digits. Every number has a point, whole ones too: the fields of ROS messages
    take floats alone, and YAML takes ``1e-05`` for a text.

    Args:
        points: of the plan.
        bends_only: whether the revolutes that turn out of the plane, or about the link, are left out.
        effort: whether the message has efforts, which controllers from ROS 2 Humble on refuse.

    Returns:
        The text of ``trajectory.csv``: ``time`` and a column ``<joint>_<quantity>`` for every joint and quantity; and
        of ``trajectory.yaml``: ``joint_names`` and ``points`` as in ROS 2 ``trajectory_msgs/JointTrajectory``, with
        accelerations where jerk is limited. A feed axis is the first joint, ``feed``, with the columns
        ``feed_position``, …, ``feed_force`` [m, N].
    """
    motion = points.trajectory
    joints = bending_joints(points.joints, motion.coordinates) if bends_only else points.joints
    names, tables = trajectory_tables(motion, joints)
    rows = [number_rows(table) for table in tables]
    written = {"positions", "velocities", *(["accelerations"] * points.smooth), *(["effort"] * effort)}
    return "\n".join(_csv(motion.time, names, rows)), "\n".join(_yaml(motion.time, names, rows, written))


def number_rows(table: FloatArray) -> list[str]:
    """Write every row of a table, its numbers of twelve digits as ``%.12g`` has them, joined by commas, with a point.

    Whole numbers have a point too. Of columns of zeros alone no sign is written.

    Args:
        table: shape (rows, n).
    """
    # Revolutes that a plane motion leaves alone are most of the table, and need no formatting.
    moving = np.any(table != 0.0, axis=0)
    row = ",".join(" %.12g " if moves else "0.0" for moves in moving)
    whole = "\n".join([row % tuple(values) for values in table[:, moving].tolist()])
    # Most numbers without a point are zeros, of links that lie still, and a search for a text takes next to nothing.
    whole = whole.replace(" 0 ", "0.0").replace(" -0 ", "-0.0")
    return _WHOLE.sub(r"\1.0", whole).replace(" ", "").split("\n")


def trajectory_tables(trajectory: JointTrajectory, joints: JointStates) -> tuple[tuple[str, ...], list[FloatArray]]:
    """Return the names of the joints, and their positions, velocities, accelerations and efforts.

    The feed axis is the first.
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
    """The revolutes that bend the arm alone: the second of every ball in the plane, the first and second in space."""
    bending = coordinates.drive_numbers[coordinates.bends]
    return replace(
        joints,
        names=tuple(joints.names[drive] for drive in bending),
        angles=joints.angles[:, bending],
        velocities=joints.velocities[:, bending],
        accelerations=joints.accelerations[:, bending],
        torques=joints.torques[:, bending],
    )


def _csv(time: FloatArray, names: tuple[str, ...], columns: list[list[str]]) -> Iterator[str]:
    quantities = zip(QUANTITIES, _FEED_QUANTITIES, strict=True)
    headings = [f"{name}_{feed if name == FEED else joint}" for joint, feed in quantities for name in names]
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
