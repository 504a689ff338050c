"""The command ``retarget``: a written plan that is left for a new goal on the way."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ccm_opt.cli.loading import numbers_from, point_from
from ccm_opt.cli.outcome import run_all
from ccm_opt.cli.solving import solve_problem
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.problem.solution import Solution


def retarget_folder(
    folder: Path,
    out: Path,
    goal: tuple[str, str | None],
    time: float | None,
    joints: str | None,
    feed: float | None,
    *,
    pictures: bool,
) -> int:
    """Plan the motion of an output folder on to a new goal, write an output folder for it, and return the exit code.

    Args:
        folder: an output folder of ``ccm-opt solve``.
        out: parent folder of the new output folder.
        goal: position of the tip in the file's unit, and direction of the tool or last link, each as numbers with
            commas between them; None for any direction.
        time: time at which the new goal is known [s]; None with ``joints``.
        joints: joint angles measured then, with commas between them [deg]; None with ``time``.
        feed: base feed measured then [m]; None without a feed axis.
        pictures: whether to make pictures, film and HTML report.
    """

    def retarget_one(item: Path) -> int:
        if (time is None) == (joints is None):
            raise ProblemError("give one of --time and --joints-deg: when, or where, the arm gets its new goal")
        if feed is not None and joints is None:
            raise ProblemError("--feed has no effect without --joints-deg")
        from ccm_opt.driver.retargeting import retarget  # noqa: PLC0415 - loads casadi
        from ccm_opt.driver.saved_solution import load  # noqa: PLC0415 - likewise

        solution = load(item)
        problem = solution.problem
        position, direction = goal
        pointing = None if direction is None else _numbers(direction, "--direction", problem.dimension)
        if pointing is not None and not np.any(pointing):
            raise ProblemError("--direction must be nonzero")
        unit = None if pointing is None else pointing / np.linalg.norm(pointing)
        wanted = TipGoal(point_from(problem, "--position", position), unit)
        moment = _measured(problem, joints, feed) if time is None else time

        def retargeted(_: Problem, *, progress: Any, **_options: Any) -> Solution:
            return retarget(solution, moment, wanted, progress=progress)

        asked = replace(problem, goal=wanted, stops=(), source="")
        return solve_problem(asked, out, plan_with=retargeted, pictures=pictures)

    return run_all([folder], retarget_one)


def _measured(problem: Problem, joints: str | None, feed: float | None) -> JointPose:
    """Return the measured pose of the arm, two angles a joint in space; of sections that bend evenly, their bends.

    Raises:
        ProblemError: there are too few or too many angles, or a feed of an arm without a feed axis.
    """
    arm = problem.arm
    angles = 1 if problem.dimension == 2 else 2
    count = arm.links if arm.sections is None else len(arm.sections.counts)
    bends = np.deg2rad(_numbers(joints or "", "--joints-deg", angles * count))
    if arm.sections is not None:
        bends = arm.sections.coupling @ bends
    if feed is not None and arm.feed is None:
        raise ProblemError("--feed: the arm has no feed axis")
    if feed is None and arm.feed is not None:
        raise ProblemError("--feed is missing: the measured position of the base on its feed axis, in m")
    return JointPose(bends if angles == 1 else bends.reshape(-1, angles), feed or 0.0)


def _numbers(words: str, option: str, count: int) -> FloatArray:
    return numbers_from(option, words, count, f"{count} numbers with commas between them")
