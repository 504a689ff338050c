"""Whether the arrays of a plan agree and have their form, and how far rounded numbers may be off.

The bounds are those of running-error analysis: with u = 2⁻⁵³, a sum of n numbers in any order is off by at most
1.01 n u times the sum of their sizes, as long as n u < 0.01 (Higham, Accuracy and Stability of Numerical Algorithms,
section 4.2). Samples count as exact: they are what is proved.
"""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.verification.drives import Efforts, as_revolutes, joint_of_bend, revolutes_of_bends
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def check_consistency(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    needed: Efforts,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check that angles, rates and torques tell one story; ``needed`` are efforts by the verifier's own dynamics."""
    return [
        _velocities(problem, trajectory),
        _accelerations(problem, trajectory, settings),
        _revolutes(trajectory, joints, settings),
        _torques(trajectory, joints, needed[0], settings),
    ]


def _velocities(problem: Problem, trajectory: JointTrajectory) -> Check:
    """|Δq/h − (v₀ + v₁)/2| ≤ h a/4 for any acceleration within ± a (error of the trapezoid rule on a Lipschitz v)."""
    step = np.diff(trajectory.time)[:, None]
    bends = trajectory.bend_angles
    speed = trajectory.bend_velocities
    gap = np.abs(np.diff(bends, axis=0) / step - 0.5 * (speed[1:] + speed[:-1]))
    # Differences of angles as long as 1 rad lose their last digits, and a short step makes much of them.
    rounding = 16.0 * np.finfo(np.float64).eps * (1.0 + np.max(np.abs(bends))) / step
    # A bend has the limit of its revolute.
    limit = problem.limits.acceleration[revolutes_of_bends(trajectory.coordinates)]
    allowed = 0.25 * step * limit + rounding

    share = gap / allowed
    k, j = np.unravel_index(np.argmax(share), share.shape)
    return Check(
        "velocities against angles",
        float(gap[k, j]),
        float(allowed[k, j]),
        "rad/s",
        f"{joint_of_bend(trajectory.coordinates, int(j))} at t = {trajectory.time[k]:.4f} s",
        passed=bool(share[k, j] <= 1.0),
    )


def _accelerations(problem: Problem, trajectory: JointTrajectory, settings: VerificationSettings) -> Check:
    """The velocity a joint gains is that of its accelerations, up to what the samples cannot show.

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
    limit = problem.limits.acceleration[revolutes_of_bends(trajectory.coordinates)]
    floor = settings.unseen_floor * trajectory.time[-1] * limit
    allowed = settings.unseen_share * np.sum(np.abs(gained), axis=0) + floor + rounding

    j = int(np.argmax(outside / allowed))
    worst = float(outside[j])
    bound = float(allowed[j])
    where = joint_of_bend(trajectory.coordinates, j)
    return Check("accelerations against velocities", worst, bound, "rad/s", where, passed=worst <= bound)


def _revolutes(trajectory: JointTrajectory, joints: JointStates, settings: VerificationSettings) -> Check:
    """The bends of a ball are revolutes of it, and its other revolutes stay at zero."""
    pairs = (
        (trajectory.bend_angles, joints.angles),
        (trajectory.bend_velocities, joints.velocities),
        (trajectory.bend_accelerations, joints.accelerations),
    )
    # Angles, rates and their derivatives are held to one tolerance, each in its own unit.
    errors = np.stack([np.abs(as_revolutes(trajectory.coordinates, bends) - revolutes) for bends, revolutes in pairs])
    worst = float(np.max(errors))
    _, k, j = np.unravel_index(np.argmax(errors), errors.shape)
    where = f"joint {j // 3 + 1} ({joints.names[j]}) at t = {trajectory.time[k]:.4f} s"
    return Check("revolutes against bends", worst, settings.match, "rad", where, passed=worst <= settings.match)


def _torques(
    trajectory: JointTrajectory, joints: JointStates, expected: FloatArray, settings: VerificationSettings
) -> Check:
    """Reported torques against the verifier's own inverse dynamics."""
    error = np.abs(expected - joints.torques)
    # Torques are summed along the arm, so rounding is in proportion to the greatest, not to each by itself.
    allowed = settings.effort_mismatch * float(np.max(np.abs(expected))) + settings.effort_floor
    k, j = np.unravel_index(np.argmax(error), error.shape)
    where = f"joint {j // 3 + 1} ({joints.names[j]}) at t = {trajectory.time[k]:.4f} s"
    worst = float(error[k, j])
    return Check("torques against dynamics", worst, allowed, "N m", where, passed=worst <= allowed)


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
    """By how much a joint's place may be off [m], for poses at samples and linear between them.

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
    """By how much the distance of two segments may be off [m].

    Args:
        size: that no coordinate of the segments exceeds [m].
    """
    return OF_DISTANCES * size
