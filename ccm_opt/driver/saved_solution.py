"""Plans read back from their output folders as solutions, verified again."""

from dataclasses import replace
from pathlib import Path

from scipy.interpolate import make_interp_spline

from ccm_opt.core.arguments import expect
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.driver.solution_assembly import clearance_record, draft_solution
from ccm_opt.driver.verified_plan import TermResults, VerifiedPlan, verified
from ccm_opt.io.reading_back import SavedMotion, load_motion, load_posed, recorded_simulation
from ccm_opt.io.record_reading import recorded_curves, recorded_results
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath, Solution


def load(folder: str | Path) -> Solution:
    """Return the plan stored in an output folder of ``ccm-opt solve`` or of ``save``, after verifying it again.

    The plan can be drawn, saved, retargeted and planned on like any other. Its clearance over time is measured again if
    the folder has it; the simulation and the tolerated errors are those of the folder, which ``ccm-opt check`` compares
    with the motion. Constraints of the user are not checked, since a folder holds their names only; ``not_checked``
    lists them. Records of the optimisation of the goal pose and of several attempts are left out.

    Args:
        folder: the output folder.

    Raises:
        ProblemError: the folder does not exist or is not readable.
        VerificationError: the verifier rejects the motion, or the folder holds the record of a run without a plan.
    """
    expect(folder, (str, Path), "the path of an output folder")
    place = Path(folder)
    posed, tour = load_posed(place)
    motion = load_motion(place, posed.arm)
    recorded = recorded_results(place)
    problem = posed if tour is None else tour.visited
    trajectory = replace(motion.trajectory, timed_by=recorded.timed_by)
    with on_one_thread(), words_in(problem.length_unit):
        checks = verified(posed, trajectory, motion.joints, tour=tour)
        plan = VerifiedPlan(_path(problem, motion), trajectory, motion.joints, checks, TermResults(), tour=tour)
        room = clearance_record(problem, plan.path, trajectory, checks) if motion.clearance_arrays else None
        simulated = recorded_simulation(motion, recorded)
        drafted = draft_solution(problem, plan, Stages(), simulated, room=room, tolerance=recorded.tolerance)
    known = {name: value for name, value in recorded.figures.items() if value is not None}
    unchecked = tuple(f"the constraint '{name}' with which it was planned" for name in recorded.constraints)
    return replace(
        drafted,
        metrics={**known, **drafted.metrics},
        timings=recorded.timings,
        versions=recorded.versions,
        not_checked=(*drafted.not_checked, *unchecked),
    )


def _path(problem: Problem, motion: SavedMotion) -> JointPath:
    """Return the path through all samples of a motion, with the share of its duration as the path parameter."""
    trajectory = motion.trajectory
    degree = min(3, len(trajectory.time) - 1)
    spline = make_interp_spline(trajectory.time / trajectory.duration, trajectory.positions, degree)
    return JointPath(spline, motion.keyframes, recorded_curves(motion.arrays, problem.arm), "read from a folder")
