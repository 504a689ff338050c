"""Checks that the record in a plan's output folder agrees with the motion in the folder's arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.driver.closed_loop import simulate_and_check
from ccm_opt.driver.metrics import motion_figures
from ccm_opt.io.reading_back import SavedMotion
from ccm_opt.io.record_reading import RecordedResults, recorded_curves
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import (
    Check,
    ClearanceRecord,
    JointTrajectory,
    SimulatedMotion,
    SimulationVerdict,
    ToleratedError,
)
from ccm_opt.verification.consistency import check_followed_curves, check_keyframes, check_nearest_curves
from ccm_opt.verification.tolerance.error_model import DEFAULT_TOLERANCE, ErrorModel, error_models
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_error
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

_SIMULATED_ANGLE = 1e-6
"""Difference of positions between a recorded simulation and a rerun that counts as rounding [rad, m]. Heuristic:
machines and back ends were found to differ by 1e-13."""
_SIMULATED_TORQUE = 1e-6
"""Difference of torques between a recorded simulation and a rerun that counts as rounding, as a fraction of the peak
torque."""
_FIGURE_SHARE = 1e-6
"""Allowed relative difference between a recorded figure of merit and the recomputed one. Heuristic: far above
rounding."""
_FIGURE_FLOOR = 1e-9
"""Allowed absolute difference between figures of merit, so that mere rounding errors count as equal. Heuristic."""


_OF_PLANNING = ("cost_", "residual_")
"""Prefixes of figures of merit, of costs and constraints, that cannot be recomputed from an output folder."""
_OF_SIMULATION = ("tracking_error_rad", "tracking_error_m", "saturated_time_s")
"""Suffixes of figures of merit that are meaningless if nothing was simulated."""
_OF_USER = "constraint "
"""Prefix of the names of checks of the user's constraints."""


def record_checks(
    problem: Problem,
    motion: SavedMotion,
    record: RecordedResults,
    checks: tuple[Check, ...],
    room: ClearanceRecord,
) -> list[Check]:
    """Return the checks that everything recorded about a motion in an output folder agrees with the motion.

    The simulation is rerun, which is reproducible to rounding as long as the arm follows the plan.

    Args:
        problem: the problem as posed.
        motion: the motion in the folder, with keyframes and simulation.
        record: the recorded results.
        checks: checks of the verifier, recomputed.
        room: clearance of the motion over time, recomputed.
    """
    settings = DEFAULT_VERIFICATION.for_problem(problem)
    trajectory, joints = motion.trajectory, motion.joints
    found = [check_keyframes(problem.arm, trajectory, motion.keyframes, settings)]
    figures = dict(motion_figures(problem, trajectory, joints, checks))
    if problem.dimension == 2:
        found.append(_curves(problem, motion))
    figures["keyframes"] = float(len(motion.keyframes))
    if record.verdict["outcome"] == ("not modelled" if problem.arm.unsimulated else "not simulated"):
        found.append(_at_rest(motion))
        unheld = {name: value for name, value in record.figures.items() if name.endswith(_OF_SIMULATION)}
        figures |= {name: np.nan if value is None else value for name, value in unheld.items()}
    else:
        again, of_simulation = simulate_and_check(problem, trajectory, joints)
        found.append(_simulated(motion, record.verdict, again))
        figures |= of_simulation
    found.append(_figures(record.figures, figures, settings))
    found.append(_checks(record.checks, checks, settings))
    if motion.clearance_arrays:
        found.append(_room(motion.clearance_arrays, room, settings))
    if record.tolerance:
        found.append(_tolerated_errors(problem, trajectory, record.tolerance))
    return found


def _curves(problem: Problem, motion: SavedMotion) -> Check:
    """Return the check of the recorded backbone curves of a planar motion against its keyframes."""
    curves = recorded_curves(motion.arrays, problem.arm)
    if problem.planner.method != "nlp":
        return check_followed_curves(problem.arm, curves, motion.keyframes)
    return check_nearest_curves(curves, nearest_curves(problem.arm, motion.keyframes))


def _at_rest(motion: SavedMotion) -> Check:
    """Return the check that the record of an arm that was not simulated rests in the start pose."""
    off = [
        np.abs(motion.simulated_angles - motion.joints.angles[:1]),
        np.abs(motion.simulated_torques),
        np.abs(motion.simulated_base - motion.trajectory.base_positions[:1]),
    ]
    worst = max(float(np.max(part, initial=0.0)) for part in off)
    return Check("simulated arm against its plan", worst, 0.0, "rad", "it was not simulated", passed=worst == 0.0)


def _simulated(motion: SavedMotion, recorded: Mapping[str, object], again: SimulatedMotion) -> Check:
    """Return the check of the recorded simulation against a rerun."""
    name = "simulated arm against its plan"
    verdict = asdict(again.verdict)
    # If the arm does not follow its plan, only the outcome is reproducible; details of the verdict vary with the run.
    held = [field for field in verdict if again.verdict.followed or field == "outcome"]
    for field in held:
        value = recorded.get(field, verdict[field])
        wanted = list(verdict[field]) if isinstance(verdict[field], tuple) else verdict[field]
        if value != wanted:
            return Check(
                name, np.inf, 0.0, "rad", f"{field}: recorded {value!r:.60}, recomputed {wanted!r}", passed=False
            )
    peak = float(np.max(np.abs(again.torques), initial=0.0))
    sources = (
        ("angle", motion.simulated_angles, again.angles, _SIMULATED_ANGLE),
        ("feed", motion.simulated_base, again.base_positions, _SIMULATED_ANGLE),
        ("torque", motion.simulated_torques, again.torques, _SIMULATED_TORQUE * peak),
    )
    worst = (0.0, _SIMULATED_ANGLE, "")
    rows = slice(_samples_alike(motion.trajectory.time, again.verdict))
    for what, ours, theirs, allowed in sources:
        off = np.abs(ours[rows] - theirs[rows])
        if off.size and float(np.max(off)) > worst[0] / worst[1] * allowed:
            sample = int(np.argmax(np.max(off, axis=1)))
            worst = (float(np.max(off)), allowed, f"{what} at sample {sample + 1}")
    return Check(name, worst[0], worst[1], "rad", worst[2], passed=worst[0] <= worst[1])


def _samples_alike(time: FloatArray, verdict: SimulationVerdict) -> int:
    """Return the number of leading samples at which two runs of a simulation agree to rounding.

    These are all samples if the arm follows the plan. Otherwise rounding errors grow exponentially until the failure,
    so the runs are compared only up to half the time of the failure, when about half of the digits still agree. The
    result is at least 1.
    """
    if verdict.followed:
        return len(time)
    until = time[0] if verdict.time is None else 0.5 * (time[0] + verdict.time)
    return max(1, int(np.searchsorted(time, until, side="right")))


def _figures(
    recorded: Mapping[str, float | None],
    figures: Mapping[str, float],
    settings: VerificationSettings,
) -> Check:
    """Return the check of recorded figures of merit, except those of costs and constraints, against recomputed ones."""
    known = {name: value for name, value in figures.items() if name in recorded}
    wrong = [name for name in recorded if name not in figures and not name.startswith(_OF_PLANNING)]
    for name, value in known.items():
        floor = settings.report_resolution if name.endswith("clearance_m") else _FIGURE_FLOOR
        if not _alike(recorded[name], value, floor):
            wrong.append(name)
    # Figures missing from the record are fine: an earlier version may not have written them.
    return _listed("figures against arrays", wrong, len(known))


def _checks(recorded: Sequence[Check], checks: Sequence[Check], settings: VerificationSettings) -> Check:
    """Return the check of recorded checks against recomputed ones; checks missing from the record are ignored.

    The user's constraints cannot be evaluated again from a folder, so their recorded checks need only have passed.
    """
    wanted = {check.name: check for check in checks}
    names = [check.name for check in recorded]
    wrong = []
    for check in recorded:
        again = wanted.get(check.name)
        held = check.passed and names.count(check.name) == 1
        if again is None:
            held = held and check.name.startswith(_OF_USER)
        else:
            # Least gaps are computed to a finite resolution.
            gap = settings.report_resolution if again.place is not None else 0.0
            floor = max(gap, _FIGURE_FLOOR)
            # Worst values may be mere rounding; limits follow from the problem and get no absolute tolerance.
            held = held and check.unit == again.unit
            held = held and _alike(_finite(check.worst), again.worst, floor)
            held = held and _alike(_finite(check.limit), again.limit, 0.0)
        if not held:
            wrong.append(check.name)
    return _listed("record against checks", wrong, len(recorded))


def _tolerated_errors(problem: Problem, trajectory: JointTrajectory, recorded: Sequence[ToleratedError]) -> Check:
    """Return the check that the motion tolerates every recorded error, proved anew; larger errors are not tried."""
    models: Mapping[str, ErrorModel] = {str(name): model for name, model in error_models(problem.arm).items()}
    wrong = []
    for error in recorded:
        model = models.get(error.name)
        if model is None or model.unit != error.unit:
            wrong.append(error.name)
            continue
        # The recorded size was found to the precision of the search.
        found = tolerated_error(problem, trajectory, model, most=error.size)
        if not found.size >= (1.0 - 2.0 * DEFAULT_TOLERANCE.precision) * error.size:
            wrong.append(f"{error.name}: only {found.size:.3g} {error.unit} are tolerated")
    return _listed("survived errors against motion", wrong, len(recorded))


def _room(recorded: Mapping[str, FloatArray], room: ClearanceRecord, settings: VerificationSettings) -> Check:
    """Return the check of recorded clearances over time against recomputed ones."""
    wanted = {"room_time": room.time, "wall_gaps": room.wall_gaps, "self_gaps": room.self_gaps}
    wrong = [
        name
        for name, values in wanted.items()
        if name not in recorded
        or recorded[name].shape != values.shape
        or float(np.max(np.abs(recorded[name] - values), initial=0.0)) > settings.goal_rounding
    ]
    return _listed("gaps over time against motion", wrong, len(wanted))


def _listed(name: str, wrong: Sequence[str], count: int) -> Check:
    where = ", ".join(wrong) if wrong else f"{count} agree"
    return Check(name, float(len(wrong)), 0.0, "that differ", where, passed=not wrong)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _alike(recorded: float | None, value: float, floor: float) -> bool:
    if recorded is None or not np.isfinite(value):
        return recorded is None and not np.isfinite(value)
    size = max(abs(recorded), abs(value))
    return abs(recorded - value) <= max(_FIGURE_SHARE * size, floor)
