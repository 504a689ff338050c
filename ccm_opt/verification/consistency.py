"""Checks that a plan's arrays are well-formed and consistent, and that its keyframes and curves match its motion.

Rounding bounds follow running-error analysis: with u = 2⁻⁵³, a sum of n numbers in any order has an error of at most
1.01 n u times the sum of their magnitudes, as long as n u < 0.01 (Higham, Accuracy and Stability of Numerical
Algorithms, section 4.2). Samples count as exact, since the verified motion is defined as the one through the samples.
"""

from collections.abc import Callable, Sequence

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.verification.drives import (
    Efforts,
    as_revolutes,
    bend_revolutes,
    check_worst,
    describe_bend_joints,
    describe_revolute_joints,
    sample_words,
)
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def check_consistency(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    needed: Efforts,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check that angles, velocities, accelerations and torques of a plan are consistent with each other.

    Args:
        problem: the problem that the motion is to solve.
        trajectory: sampled motion in the arm's coordinates.
        joints: angles, rates and efforts of the drives at the same samples, as the plan reports them.
        needed: torques and base force from the verifier's own inverse dynamics.
        settings: tolerances.
    """
    # A bend has the limit of its revolute.
    limit = problem.limits.acceleration[bend_revolutes(trajectory.coordinates)]
    names = describe_bend_joints(trajectory.coordinates)
    motion = (trajectory.time, trajectory.bend_angles, trajectory.bend_velocities)
    gains = (trajectory.time, trajectory.bend_velocities, trajectory.bend_accelerations)
    return [
        check_rates("velocities against angles", "rad/s", motion, limit, names),
        check_gains("accelerations against velocities", "rad/s", gains, limit, settings, names),
        _revolutes(trajectory, joints, settings),
        check_efforts(
            "torques against dynamics",
            "N m",
            joints.torques - needed[0],
            needed[0],
            sample_words(trajectory.time, describe_revolute_joints(joints.names)),
            settings,
        ),
    ]


def check_rates(
    name: str,
    unit: str,
    motion: tuple[FloatArray, FloatArray, FloatArray],
    limit: FloatArray | float,
    names: Sequence[str] = (),
) -> Check:
    """Check that velocities match the differences of positions, as closely as an acceleration limit a implies.

    In a step of length h, |Δq/h − (v₀ + v₁)/2| ≤ h a/4 holds for any motion whose acceleration lies within ± a: the
    error bound of the trapezoidal rule for a velocity with slope at most a.

    Args:
        name: name of the check.
        unit: unit of the velocities.
        motion: times (T,), positions and velocities, both of shape (T, n) or (T,).
        limit: acceleration limit a of every column.
        names: names of the columns.
    """
    time, places, velocities = motion
    step = np.diff(time).reshape(-1, *[1] * (places.ndim - 1))
    gap = np.diff(places, axis=0) / step - 0.5 * (velocities[1:] + velocities[:-1])
    # Differences of positions of order 1 lose their last digits, and dividing by a short step magnifies that error.
    rounding = 16.0 * np.finfo(np.float64).eps * (1.0 + np.max(np.abs(places))) / step
    return check_worst(name, unit, gap, 0.25 * step * limit + rounding, sample_words(time, names))


def check_efforts(
    name: str,
    unit: str,
    error: FloatArray,
    expected: FloatArray,
    where: Callable[..., str],
    settings: VerificationSettings,
) -> Check:
    """Check that reported efforts agree with those of the verifier's own inverse dynamics.

    Args:
        name: name of the check.
        unit: unit of the efforts, N m or N.
        error: reported efforts minus expected efforts.
        expected: efforts from the verifier's own inverse dynamics, of the same shape.
        where: describes the location of a value, given its indices.
        settings: tolerances.
    """
    # Efforts are summed along the arm, so their rounding is proportional to the greatest effort.
    allowed = settings.effort_mismatch * float(np.max(np.abs(expected))) + settings.effort_floor
    return check_worst(name, unit, error, allowed, where)


def check_gains(
    name: str,
    unit: str,
    motion: tuple[FloatArray, FloatArray, FloatArray],
    limit: FloatArray | float,
    settings: VerificationSettings,
    names: Sequence[str] = ("",),
) -> Check:
    """Check that the changes of velocities match the accelerations, except for jumps between samples.

    The mean acceleration over a step lies between the values at its ends unless the acceleration jumps twice within the
    step. The unexplained change of velocity, summed over the motion, may be a small fraction of the total change.

    Args:
        name: name of the check.
        unit: unit of the velocities.
        motion: times (T,), velocities and accelerations, both of shape (T, n).
        limit: acceleration limit of every column.
        settings: tolerances.
        names: names of the columns.
    """
    time, speed, value = motion
    step = np.diff(time)[:, None]
    gained = np.diff(speed, axis=0)
    # Changes of velocity above the larger or below the smaller end acceleration are not explained by the samples.
    above = gained - step * np.maximum(value[1:], value[:-1])
    below = step * np.minimum(value[1:], value[:-1]) - gained
    outside = np.sum(np.maximum(np.maximum(above, below), 0.0), axis=0)

    # Rounding accumulates over the steps; the floor is for joints that hardly move.
    rounding = 16.0 * np.finfo(np.float64).eps * len(step) * (1.0 + np.max(np.abs(speed)))
    floor = settings.unseen_floor * time[-1] * limit
    allowed = settings.unseen_share * np.sum(np.abs(gained), axis=0) + floor + rounding
    return check_worst(name, unit, outside, allowed, lambda j: names[j])


def _revolutes(trajectory: JointTrajectory, joints: JointStates, settings: VerificationSettings) -> Check:
    """Check that the revolutes that bend each ball joint match its bends, and that all other revolutes are zero."""
    pairs = (
        (trajectory.bend_angles, joints.angles),
        (trajectory.bend_velocities, joints.velocities),
        (trajectory.bend_accelerations, joints.accelerations),
    )
    # Angles, velocities and accelerations share one tolerance, each in its own unit.
    errors = np.stack([as_revolutes(trajectory.coordinates, bends) - revolutes for bends, revolutes in pairs])
    where = sample_words(trajectory.time, describe_revolute_joints(joints.names))
    return check_worst("revolutes against bends", "rad", errors, settings.match, lambda _, k, j: where(k, j))


def check_form(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> Check:
    """Check array shapes, sample times, stop indices and finiteness, on which all other checks rely.

    The worst value is the largest time step [s].
    """
    # Fewer than two times have no step, but the check still needs a value to report.
    steps = np.array([np.inf])
    if np.ndim(trajectory.time) == 1 and len(trajectory.time) > 1:
        steps = np.diff(trajectory.time)

    # The order matters: each test relies on those before it.
    defect = (
        _shape_defect(problem.arm, trajectory, joints)
        or _number_defect(trajectory, joints)
        or _time_defect(trajectory, steps, settings.largest_step + settings.time_rounding)
        or _stop_defect(problem, trajectory)
    )
    where = defect or f"{len(trajectory.time)} samples"
    return Check("samples", float(np.max(steps)), settings.largest_step, "s", where, passed=not defect)


def _shape_defect(arm: Arm, trajectory: JointTrajectory, joints: JointStates) -> str:
    count = np.size(trajectory.time)
    if np.ndim(trajectory.time) != 1 or count < 2:
        return f"time has shape {np.shape(trajectory.time)}, expected at least two samples"
    # All later checks read columns by the arm's layout, so a different layout must be rejected here.
    layout = arm.coordinates
    if trajectory.coordinates != layout:
        return f"the motion is of {len(trajectory.coordinates)} coordinates, not of the arm's {len(layout)}"

    for name in ("positions", "velocities", "accelerations"):
        shape = np.shape(getattr(trajectory, name))
        if shape != (count, len(layout)):
            return f"{name} have shape {shape}, expected {(count, len(layout))}"
    for name in ("angles", "velocities", "accelerations", "torques"):
        shape = np.shape(getattr(joints, name))
        if shape != (count, layout.revolutes):
            return f"joint {name} have shape {shape}, expected {(count, layout.revolutes)}"

    wanted = (count, len(layout.base_names))
    if np.shape(joints.base_forces) != wanted:
        return f"forces on the base have shape {np.shape(joints.base_forces)}, expected {wanted}"
    return ""


def _stop_defect(problem: Problem, trajectory: JointTrajectory) -> str:
    stops = np.asarray(trajectory.stops, dtype=np.intp)
    if len(stops) != len(problem.stops):
        return f"{len(stops)} stops for {len(problem.stops)} goals on the way"
    # Stops lie strictly inside: the first sample is the start, and the last is the final goal.
    inside = np.concatenate(([-1], stops, [len(trajectory.time) - 1]))
    return "" if np.all(np.diff(inside) > 0) else f"stops {stops.tolist()} are not increasing samples of the motion"


def _number_defect(trajectory: JointTrajectory, joints: JointStates) -> str:
    fields = {
        "time": trajectory.time,
        "positions": trajectory.positions,
        "velocities": trajectory.velocities,
        "accelerations": trajectory.accelerations,
        "joint angles": joints.angles,
        "joint velocities": joints.velocities,
        "joint accelerations": joints.accelerations,
        "joint torques": joints.torques,
        "forces on the base": joints.base_forces,
    }

    for name, values in fields.items():
        # Comparisons with NaN are false, so a gap that is NaN would count as proved.
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            return f"{name} is not finite at sample {bad[0][0] + 1}"
    return ""


def _time_defect(trajectory: JointTrajectory, steps: np.ndarray, largest: float) -> str:
    if trajectory.time[0] != 0.0:
        return f"time starts at {trajectory.time[0]} s, expected 0"
    if np.min(steps) <= 0.0:
        return f"time does not increase at sample {int(np.argmin(steps)) + 2}"
    if np.max(steps) > largest:
        return f"samples {int(np.argmax(steps)) + 1} and {int(np.argmax(steps)) + 2} are too far apart"
    return ""


UNIT = 2.0**-53
"""Unit roundoff of double precision, 2⁻⁵³: half the distance from 1 to the next larger number."""
OF_DISTANCES = 64.0 * UNIT
"""Rounding error of the distance of two segments, as a fraction of their greatest coordinate."""


def point_rounding(arm: Arm, positions: FloatArray) -> float:
    """Return a bound on the rounding error of computed joint positions, at samples and between them [m].

    In the plane, a heading is a cumulative sum of up to ``links`` bends. In space, the frame of a link is that of the
    preceding link, rotated twice: about thirty operations with errors of one unit in the last place, which accumulate
    along the arm, as do those of the positions. The trigonometric functions and the feed of the base add a few units
    each. The bound is doubled to cover errors in half the difference of two positions.

    Args:
        arm: the arm.
        positions: coordinates at the T samples, shape (T, c) [rad, m].
    """
    sizes = np.abs(positions)
    turned = float(np.max(np.sum(sizes[:, arm.coordinates.bends], axis=1)))
    moved = float(np.max(np.sum(sizes[:, arm.coordinates.base], axis=1)))
    if arm.carrier:
        turned += moved
        moved += 2.0 * float(np.sum([np.linalg.norm(axis.point) for axis in arm.carrier]))
    reach = float(np.max(np.abs(arm.base)) + arm.length + moved)
    return (arm.links + 4 + 4 * len(arm.carrier)) * UNIT * (64.0 + 4.0 * turned) * reach


def distance_rounding(size: float) -> float:
    """Return a bound on the rounding error of the computed distance of two segments [m].

    Args:
        size: bound on the magnitude of all coordinates of the segments [m].
    """
    return OF_DISTANCES * size


_KEYFRAME_SHARE = 1.0 / 3.0
"""Allowed distance of a motion from a keyframe, as a fraction of the keyframes' second difference at that keyframe.

Derived: twice the sixth by which a uniform cubic B-spline misses its control points. Measured near clamped ends: 0.23.
"""
_CLAMPED_SHARE = 0.0225
"""Additional allowed distance from the second keyframe, as a fraction of the second difference at the third.

The last but one keyframe is treated alike. Derived: twice t³ / 6 at t = 0.407, where a clamped uniform cubic B-spline
with even steps passes its second control point.
"""
_CURVE_MATCH = 1e-6
"""Largest difference of a reported curve from one fitted anew to its keyframe, as a fraction of the maximum curvature.

Derived: a least-squares fit of about twenty numbers keeps about ten digits.
"""
_FOLLOWED_CURVE = 0.05
"""Allowed difference between the heading of a link and that of the curve from which the arm's motion was derived [rad].

Heuristic: the paper's planner samples headings; errors of 0.02 were measured in segments that have nearly vanished.
"""


_CLAMPED_THIRD_SHARE = 1e-4
"""Additional allowed distance from the third keyframe, as a fraction of the second difference at the fourth.

The last but two keyframe is treated alike. Derived: twice t³ / 6 at t = 0.066, where a clamped uniform cubic B-spline
with even steps passes its third control point, after the first knot.
"""


def check_keyframes(
    arm: Arm,
    trajectory: JointTrajectory,
    keyframes: FloatArray,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> Check:
    """Check that a motion passes near its keyframes in order and ends at the last of them.

    A uniform cubic B-spline with the keyframes as control points passes each at a distance of a sixth of the keyframes'
    second difference; near the ends, where knots are clamped, the distance is slightly larger, and likewise where two
    keyframes coincide. After halving of the spline's intervals, the distance is smaller.

    Args:
        arm: the arm.
        trajectory: the sampled motion.
        keyframes: K configurations, shape (K, c) [rad, m].
        settings: tolerances.
    """
    name = "keyframes against motion"
    if len(keyframes) == 0:
        return Check(name, np.inf, 0.0, "rad", "there are none", passed=False)
    # On the base axes, one link length is weighted like one radian.
    scale = np.where(np.arange(keyframes.shape[1]) < arm.coordinates.joints, 1.0, 1.0 / arm.link_length)
    wanted = keyframes * scale
    allowed = np.full(len(wanted), settings.start_tolerance)
    bent = np.linalg.norm(wanted[2:] - 2.0 * wanted[1:-1] + wanted[:-2], axis=1)
    allowed[1:-1] += _KEYFRAME_SHARE * bent
    # A motion comes to a point of its path where two keyframes coincide: the knots are clamped there as at the ends.
    again = np.flatnonzero(~np.any(np.diff(wanted, axis=0), axis=1))
    for first, last in zip((0, *(again + 1).tolist()), (*again.tolist(), len(wanted) - 1), strict=True):
        for end, inward in ((first, 1), (last, -1)):
            # Near a clamped end, the fourth control point, and with it the second difference at the third, has the
            # weight t³ / 6, and a path with even steps is nearest to the second control point at t = 0.42.
            for step, share in ((1, _CLAMPED_SHARE), (2, _CLAMPED_THIRD_SHARE)):
                beyond = end + inward * (step + 1)
                if first < beyond < last:
                    allowed[beyond - inward] += share * bent[beyond - 1]
    points = trajectory.positions * scale
    pieces = np.diff(points, axis=0)
    # A motion that was given a new goal under way has keyframes only from that stop on.
    rests = (0, *trajectory.stops)
    piece = min(rests, key=lambda rest: float(np.linalg.norm(points[rest] - wanted[0])))
    worst = (0.0, 1.0, "")
    for number, (keyframe, most) in enumerate(zip(wanted, allowed.tolist(), strict=True), start=1):
        first = piece if number < len(wanted) else len(pieces) - 1
        away = _distances_from_pieces(keyframe, points[first:-1], pieces[first:])
        near = np.flatnonzero(away <= most)
        # Taking the first piece that is near enough leaves as much of the motion as possible to later keyframes.
        found = int(near[0] if len(near) else np.argmin(away))
        least = float(away[found])
        piece = first + found if len(near) else piece
        worst = max(worst, (least, most, f"keyframe {number}"), key=lambda met: met[0] / met[1])
    return Check(name, worst[0], worst[1], "rad", worst[2], passed=worst[0] <= worst[1])


def _distances_from_pieces(point: FloatArray, starts: FloatArray, pieces: FloatArray) -> FloatArray:
    """Return the distances of a point from n segments, given by their starts and vectors (n, c), shape (n,)."""
    away = point - starts
    squares = np.maximum(np.einsum("tc,tc->t", pieces, pieces), np.finfo(np.float64).tiny)
    along = np.clip(np.einsum("tc,tc->t", away, pieces) / squares, 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - along[:, None] * pieces, axis=1))


def check_nearest_curves(curves: Sequence[Configuration], wanted: Sequence[Configuration]) -> Check:
    """Check that the reported curves are the best fits to the keyframes.

    Args:
        curves: reported curves, one per keyframe.
        wanted: curves fitted anew to the keyframes, one per keyframe.

    Returns:
        A check whose worst value is a fraction of the maximum curvature, or an angle [rad].
    """
    name = "curves against keyframes"
    if [len(curve.segments) for curve in curves] != [len(curve.segments) for curve in wanted]:
        return Check(name, np.inf, 0.0, "", f"{len(curves)} curves for {len(wanted)} keyframes", passed=False)
    steepest = max(float(np.max(np.abs(part.curvature))) for curve in wanted for part in curve.segments)
    # Straight curves have zero curvature; half a turn over the arm's length is the least reference.
    size = max(steepest, np.pi / wanted[0].length)
    errors = [_difference(ours, theirs, size) for ours, theirs in zip(curves, wanted, strict=True)]
    k = int(np.argmax(errors))
    passed = errors[k] <= _CURVE_MATCH
    return Check(name, errors[k], _CURVE_MATCH, "", f"curve {k + 1}", passed=passed)


def check_followed_curves(arm: Arm, curves: Sequence[Configuration], keyframes: FloatArray) -> Check:
    """Check that an arm follows the backbone curves from which its motion was derived.

    The heading of each link must be the mean heading of the curve over that link, plus an offset from the mapping of
    the start that is equal at all keyframes.

    Args:
        arm: a planar arm.
        curves: reported curves, one per keyframe.
        keyframes: K configurations, shape (K, c) [rad, m].
    """
    name = "curves against keyframes"
    if len(curves) != len(keyframes):
        return Check(name, np.inf, 0.0, "rad", f"{len(curves)} curves for {len(keyframes)} keyframes", passed=False)
    headings = arm.base_heading + np.cumsum(keyframes[:, arm.coordinates.bends], axis=1)
    added = headings - np.array([_mean_headings(arm, curve) for curve in curves])
    errors = np.max(np.abs(added - added[0]), axis=1)
    k = int(np.argmax(errors))
    worst = float(errors[k])
    return Check(name, worst, _FOLLOWED_CURVE, "rad", f"curve {k + 1}", passed=worst <= _FOLLOWED_CURVE)


def _mean_headings(arm: Arm, curve: Configuration) -> FloatArray:
    """Return the mean heading of a backbone curve over each of the arm's links, shape (links,) [rad]."""
    of_links = np.linspace(0.0, curve.length, arm.links + 1)
    if arm.proportions is not None:
        of_links = np.concatenate(([0.0], np.cumsum(arm.lengths))) * (curve.length / float(np.sum(arm.lengths)))
    ends = np.union1d(curve.breakpoints, of_links)
    # Between breakpoints headings are quartics, which three Gauss points integrate exactly.
    nodes, weights = np.polynomial.legendre.leggauss(3)
    half = 0.5 * np.diff(ends)
    middle = ends[:-1] + half
    headings = curve.heading_at((middle[:, None] + half[:, None] * nodes).ravel()).reshape(-1, 3)
    turned = np.concatenate(([0.0], np.cumsum(half * (headings @ weights))))
    return np.asarray(np.diff(np.interp(of_links, ends, turned)) / np.diff(of_links))


def _difference(ours: Configuration, theirs: Configuration, size: float) -> float:
    """Return the greatest difference of two curves with equally many segments.

    It is the greatest of the differences of base headings [rad], of curvatures as fractions of `size`, of segment
    lengths as fractions of theirs, and of knots.
    """
    found = [abs(ours.base_heading - theirs.base_heading)]
    for part, other in zip(ours.segments, theirs.segments, strict=True):
        found.append(float(np.max(np.abs(part.curvature - other.curvature))) / size)
        found.append(abs(part.length - other.length) / other.length)
        found.append(float(np.max(np.abs(np.subtract(part.knots, other.knots)))))
    return max(found)
