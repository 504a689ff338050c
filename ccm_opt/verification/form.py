"""Whether the data of a motion are well-formed: shapes, finite numbers, increasing and dense samples."""

import numpy as np

from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.verification.checked_problem import CheckedProblem
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def check_form(
    problem: CheckedProblem,
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


def _shape_defect(arm: DrivenArm, trajectory: JointTrajectory, joints: JointStates) -> str:
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


def _stop_defect(problem: CheckedProblem, trajectory: JointTrajectory) -> str:
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
