"""Whether the arrays of a plan agree and have their form, and whether its keyframes and curves belong to its motion.

The bounds are those of running-error analysis: with u = 2⁻⁵³, a sum of n numbers in any order is off by at most
1.01 n u times the sum of their sizes, as long as n u < 0.01 (Higham, Accuracy and Stability of Numerical Algorithms,
section 4.2). Samples count as exact: they are what is proved.
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
    """Check that angles, rates and torques tell one story; ``needed`` are efforts by the verifier's own dynamics."""
    # A bend has the limit of its revolute.
    limit = problem.limits.acceleration[bend_revolutes(trajectory.coordinates)]
    names = describe_bend_joints(trajectory.coordinates)
    motion = (trajectory.time, trajectory.bend_angles, trajectory.bend_velocities)
    return [
        check_rates("velocities against angles", "rad/s", motion, limit, names),
        _accelerations(trajectory, limit, names, settings),
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
    """Check that |Δq/h − (v₀ + v₁)/2| ≤ h a/4, as for any acceleration within ± a.

    That is the error of the trapezoid rule on a velocity whose slope is bounded by a.

    Args:
        name: of the check.
        unit: of the velocities.
        motion: times (T,), places and velocities, both of shape (T, n) or (T,).
        limit: a, of every column.
        names: of the columns.
    """
    time, places, velocities = motion
    step = np.diff(time).reshape(-1, *[1] * (places.ndim - 1))
    gap = np.diff(places, axis=0) / step - 0.5 * (velocities[1:] + velocities[:-1])
    # Differences of places as large as 1 lose their last digits, and a short step makes much of them.
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
    """Check by how much reported efforts differ from the verifier's own inverse dynamics."""
    # Efforts are summed along the arm, so rounding is in proportion to the greatest, not to each by itself.
    allowed = settings.effort_mismatch * float(np.max(np.abs(expected))) + settings.effort_floor
    return check_worst(name, unit, error, allowed, where)


def _accelerations(
    trajectory: JointTrajectory, limit: FloatArray, names: Sequence[str], settings: VerificationSettings
) -> Check:
    """Return the velocity a joint gains is that of its accelerations, up to what the samples cannot show.

    The mean acceleration of a step lies between the values at its ends unless acceleration jumps twice within the
    step. Summed over the motion, what lies outside may be a small share of the velocity gained and lost.
    """
    step = np.diff(trajectory.time)[:, None]
    value = trajectory.bend_accelerations
    speed = trajectory.bend_velocities
    gained = np.diff(speed, axis=0)
    # What a step gains beyond its larger, or short of its smaller acceleration, its samples do not explain.
    above = gained - step * np.maximum(value[1:], value[:-1])
    below = step * np.minimum(value[1:], value[:-1]) - gained
    outside = np.sum(np.maximum(np.maximum(above, below), 0.0), axis=0)

    # Rounding adds up over the steps; the floor lets a joint that hardly moves pass.
    rounding = 16.0 * np.finfo(np.float64).eps * len(step) * (1.0 + np.max(np.abs(speed)))
    floor = settings.unseen_floor * trajectory.time[-1] * limit
    allowed = settings.unseen_share * np.sum(np.abs(gained), axis=0) + floor + rounding
    return check_worst("accelerations against velocities", "rad/s", outside, allowed, lambda j: names[j])


def _revolutes(trajectory: JointTrajectory, joints: JointStates, settings: VerificationSettings) -> Check:
    """Return the bends of a ball are revolutes of it, and its other revolutes stay at zero."""
    pairs = (
        (trajectory.bend_angles, joints.angles),
        (trajectory.bend_velocities, joints.velocities),
        (trajectory.bend_accelerations, joints.accelerations),
    )
    # Angles, rates and their derivatives are held to one tolerance, each in its own unit.
    errors = np.stack([as_revolutes(trajectory.coordinates, bends) - revolutes for bends, revolutes in pairs])
    where = sample_words(trajectory.time, describe_revolute_joints(joints.names))
    return check_worst("revolutes against bends", "rad", errors, settings.match, lambda _, k, j: where(k, j))


def check_form(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> Check:
    """Check everything the other checks take for granted; ``worst`` is the largest time step [s]."""
    # Times without a step at all still need a figure to report.
    steps = np.array([np.inf])
    if np.ndim(trajectory.time) == 1 and len(trajectory.time) > 1:
        steps = np.diff(trajectory.time)

    # The order matters: each test takes for granted what those before it have found in order.
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
    # Every further check reads columns by the arm's layout, so another layout ends the verification here.
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
    # Neither the first sample nor the last is a stop: the start is no goal, and the end is the last goal.
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
        # NaN makes every comparison false: a gap that is NaN would count as proved.
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
"""Half the distance from 1 to the next number."""
OF_DISTANCES = 64.0 * UNIT
"""Error of the distance of two segments, as a share of their greatest coordinate."""


def point_rounding(arm: Arm, positions: FloatArray) -> float:
    """Return by how much a joint's place may be off [m], for poses at samples and linear between them.

    In the plane a heading is a running sum of up to ``links`` bends; in space the frame of a link is that of the one
    before, turned twice: some thirty operations with errors of a unit in the last place, which add up along the arm, as
    do the places. The functions of the angles, and the way of the base, add a few units each. All of it is taken twice,
    so that half of a difference of two places may be off as well.

    Args:
        arm: the arm.
        positions: of all coordinates, shape (T, c) [rad, m].
    """
    sizes = np.abs(positions)
    turned = float(np.max(np.sum(sizes[:, arm.coordinates.bends], axis=1)))
    reach = float(np.max(np.abs(arm.base)) + arm.length + np.max(np.sum(sizes[:, arm.coordinates.base], axis=1)))
    return (arm.links + 4) * UNIT * (64.0 + 4.0 * turned) * reach


def distance_rounding(size: float) -> float:
    """Return by how much the distance of two segments may be off [m].

    Args:
        size: that no coordinate of the segments exceeds [m].
    """
    return OF_DISTANCES * size


_KEYFRAME_SHARE = 1.0 / 3.0
"""Share of the second difference of its keyframes by which a motion may pass one of them. Derived: twice the sixth of a
uniform cubic B-spline; 0.23 was seen beside clamped ends."""
_CLAMPED_SHARE = 0.0225
"""Share of the second difference of the third keyframe by which a motion may pass the second one besides, and likewise
at the end. Derived: twice t³ / 6 at t = 0.407, where a clamped uniform cubic B-spline of even steps passes its second
control point."""
_CURVE_MATCH = 1e-6
"""Difference of a reported curve from that of its keyframe, as a share of the greatest curvature, that is rounding.
Derived: a least-squares fit of some twenty numbers keeps some ten digits."""
_FOLLOWED_CURVE = 0.05
"""Difference of a link's heading from that of a curve that was planned first [rad]. Taste: the paper's planner samples
headings, and was seen to miss 0.02 in segments that it has nearly shrunk away."""


def check_keyframes(
    arm: Arm,
    trajectory: JointTrajectory,
    keyframes: FloatArray,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> Check:
    """Check that a motion passes its keyframes in order, and ends at the last of them.

    A uniform cubic B-spline with the keyframes as control points passes each at a sixth of its second difference; near
    the ends, where knots are clamped, at a little more, and once its legs are halved at less.

    Args:
        arm: the arm.
        trajectory: the motion.
        keyframes: of all coordinates, shape (K, c) [rad, m].
        settings: of the verifier.
    """
    name = "keyframes against motion"
    if len(keyframes) == 0:
        return Check(name, np.inf, 0.0, "rad", "there are none", passed=False)
    # On the axes that carry the base a link's length counts like a radian.
    scale = np.where(np.arange(keyframes.shape[1]) < arm.coordinates.joints, 1.0, 1.0 / arm.link_length)
    wanted = keyframes * scale
    allowed = np.full(len(wanted), settings.start_tolerance)
    bent = np.linalg.norm(wanted[2:] - 2.0 * wanted[1:-1] + wanted[:-2], axis=1)
    allowed[1:-1] += _KEYFRAME_SHARE * bent
    if len(bent) > 1:
        # Beside a clamped end the fourth control point, and with it what the third bends, counts by t³ / 6, and a path
        # of even steps is beside the second at t = 0.42.
        allowed[[1, -2]] += _CLAMPED_SHARE * bent[[1, -2]]
    points = trajectory.positions * scale
    pieces = np.diff(points, axis=0)
    # A motion that was given a new goal on its way has keyframes from the stop on alone.
    rests = (0, *trajectory.stops)
    piece = min(rests, key=lambda rest: float(np.linalg.norm(points[rest] - wanted[0])))
    worst = (0.0, 1.0, "")
    for number, (keyframe, most) in enumerate(zip(wanted, allowed.tolist(), strict=True), start=1):
        first = piece if number < len(wanted) else len(pieces) - 1
        away = _distances_from_pieces(keyframe, points[first:-1], pieces[first:])
        near = np.flatnonzero(away <= most)
        # The first piece that is near enough leaves most of the motion to the keyframes that follow.
        found = int(near[0] if len(near) else np.argmin(away))
        least = float(away[found])
        piece = first + found if len(near) else piece
        worst = max(worst, (least, most, f"keyframe {number}"), key=lambda met: met[0] / met[1])
    return Check(name, worst[0], worst[1], "rad", worst[2], passed=worst[0] <= worst[1])


def _distances_from_pieces(point: FloatArray, starts: FloatArray, pieces: FloatArray) -> FloatArray:
    """Return distances of a point from straight pieces that begin at some points, each of shape (n, c); shape (n,)."""
    away = point - starts
    squares = np.maximum(np.einsum("tc,tc->t", pieces, pieces), np.finfo(np.float64).tiny)
    along = np.clip(np.einsum("tc,tc->t", away, pieces) / squares, 0.0, 1.0)
    return np.asarray(np.linalg.norm(away - along[:, None] * pieces, axis=1))


def check_nearest_curves(curves: Sequence[Configuration], wanted: Sequence[Configuration]) -> Check:
    """Check that curves are those which come nearest to the keyframes.

    Args:
        curves: behind the keyframes, as they are reported.
        wanted: the same made from the keyframes.

    Returns:
        The check; its worst value is a share of the greatest curvature, or of a radian.
    """
    name = "curves against keyframes"
    if [len(curve.segments) for curve in curves] != [len(curve.segments) for curve in wanted]:
        return Check(name, np.inf, 0.0, "", f"{len(curves)} curves for {len(wanted)} keyframes", passed=False)
    steepest = max(float(np.max(np.abs(part.curvature))) for curve in wanted for part in curve.segments)
    # A straight curve has no size of its own; half a turn over the arm stands for it.
    size = max(steepest, np.pi / wanted[0].length)
    errors = [_difference(ours, theirs, size) for ours, theirs in zip(curves, wanted, strict=True)]
    k = int(np.argmax(errors))
    passed = errors[k] <= _CURVE_MATCH
    return Check(name, errors[k], _CURVE_MATCH, "", f"curve {k + 1}", passed=passed)


def check_followed_curves(arm: Arm, curves: Sequence[Configuration], keyframes: FloatArray) -> Check:
    """Check that an arm follows its curves, where these were planned first.

    Headings of links are the mean headings of their curve, and what the start's mapping adds to them all along.

    Args:
        arm: the arm.
        curves: behind the keyframes, as they are reported.
        keyframes: of all coordinates, shape (K, c) [rad, m].
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
    """Return the mean headings of a curve over the arm's links, shape (links,) [rad]."""
    of_links = np.linspace(0.0, curve.length, arm.links + 1)
    ends = np.union1d(curve.breakpoints, of_links)
    # Between breakpoints headings are quartics, which three Gauss points integrate exactly.
    nodes, weights = np.polynomial.legendre.leggauss(3)
    half = 0.5 * np.diff(ends)
    middle = ends[:-1] + half
    headings = curve.heading_at((middle[:, None] + half[:, None] * nodes).ravel()).reshape(-1, 3)
    turned = np.concatenate(([0.0], np.cumsum(half * (headings @ weights))))
    return np.asarray(np.diff(np.interp(of_links, ends, turned)) / np.diff(of_links))


def _difference(ours: Configuration, theirs: Configuration, size: float) -> float:
    """Return the greatest difference of headings at the base [rad], and of curvatures, lengths and knots as shares."""
    found = [abs(ours.base_heading - theirs.base_heading)]
    for part, other in zip(ours.segments, theirs.segments, strict=True):
        found.append(float(np.max(np.abs(part.curvature - other.curvature))) / size)
        found.append(abs(part.length - other.length) / other.length)
        found.append(float(np.max(np.abs(np.subtract(part.knots, other.knots)))))
    return max(found)
