"""Python interface to plans: saving to a folder, drawing, animating, and reports."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ccm_opt.core.arguments import expect
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import put_file_or_refuse
from ccm_opt.io.folder import solution_files, write_folder
from ccm_opt.io.reading_back import SavedMotion, load_any_problem, load_motion
from ccm_opt.io.record_reading import recorded_curves, recorded_nearest
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution
from ccm_opt.problem.solution.solution import present_with
from ccm_opt.robot.frames import joint_positions_3d
from ccm_opt.scene.tool_links import points_with_tool

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ccm_opt.viz.arm_drawing import PlanDrawing


@dataclass(frozen=True)
class SavedPlan:
    """A plan read from an output folder, not verified.

    Attributes:
        folder: folder that the plan was read from.
        problem: problem that the plan solves.
        motion: the motion, with all arrays of the folder.
    """

    folder: Path
    problem: Problem
    motion: SavedMotion


def read_plan(folder: Path) -> SavedPlan:
    """Return the plan stored in an output folder for drawing it, without verifying it again.

    Args:
        folder: the output folder.

    Raises:
        ProblemError: the folder does not exist or is not readable.
        VerificationError: the folder holds the record of a run without a plan.
    """
    problem = load_any_problem(folder)
    return SavedPlan(folder, problem, load_motion(folder, problem.arm))


def save(solution: Solution, folder: str | Path) -> Path:
    """Write a plan to an output folder, as ``ccm-opt solve --no-pictures`` does.

    Args:
        solution: the plan.
        folder: the output folder; an earlier plan in it is replaced, your own files stay.

    Returns:
        The folder written.

    Raises:
        ProblemError: the folder cannot be written, or holds something other than a plan.
    """
    expect(solution, Solution, "a ccm_opt.Solution", "ccm_opt.solve makes one")
    expect(folder, (str, Path), "the path of an output folder")
    return write_folder(Path(folder), solution_files(solution))


def plot(plan: Solution) -> "Figure":
    """Return a figure of a plan: workspace, start pose, poses along the motion, goals, tip path, minimum clearance.

    Args:
        plan: the plan.

    Returns:
        A matplotlib figure, which notebooks display and whose ``savefig`` writes files.
    """
    from ccm_opt.viz.plan import plan_figure  # noqa: PLC0415 - loads matplotlib

    return plan_figure(plan_drawing(plan))


def animate(plan: Solution, file: str | Path) -> Path:
    """Write a film of the motion of a plan.

    Args:
        plan: the plan.
        file: path of the film, with the suffix ``.gif``, or ``.mp4`` where ffmpeg is installed.

    Returns:
        Path of the file written.

    Raises:
        ProblemError: the suffix is another, ffmpeg is missing, or the file cannot be written.
    """
    from ccm_opt.viz.films import motion_gif, motion_mp4  # noqa: PLC0415 - loads matplotlib

    expect(file, (str, Path), "the path of a film")
    place = Path(file)
    if place.suffix not in {".gif", ".mp4"}:
        raise ProblemError(f"a film ends with .gif or .mp4, got '{place.name}'")
    shown = plan_drawing(plan)
    put_file_or_refuse(place, motion_gif(shown) if place.suffix == ".gif" else motion_mp4(shown))
    return place


def report(plan: Solution, file: str | Path) -> Path:
    """Write the HTML report of a plan: scene, charts, checks, in one file that loads no others.

    Args:
        plan: the plan.
        file: path of the report, with the suffix ``.html``.

    Returns:
        Path of the file written.

    Raises:
        ProblemError: the suffix is another, or the file cannot be written.
    """
    from ccm_opt.viz.page import report_html  # noqa: PLC0415 - slow to import

    expect(plan, Solution, "a ccm_opt.Solution", "ccm_opt.solve makes one and ccm_opt.load reads one")
    expect(file, (str, Path), "the path of a report")
    place = Path(file)
    if place.suffix != ".html":
        raise ProblemError(f"a report ends with .html, got '{place.name}'")
    put_file_or_refuse(place, report_html(plan, pictures=None).encode())
    return place


def plan_drawing(plan: Solution | SavedPlan) -> "PlanDrawing":
    """Return the data of a plan that pictures show, with the simulated arm for a planar plan loaded from a folder."""
    from ccm_opt.viz.arm_drawing import PlanDrawing  # noqa: PLC0415 - loads matplotlib

    expect(plan, (Solution, SavedPlan), "a plan", "ccm_opt.solve makes one and ccm_opt.load reads one")
    if isinstance(plan, Solution):
        return PlanDrawing.from_solution(plan)
    arm, motion = plan.problem.arm, plan.motion
    simulated = None
    if arm.dimension == 2 and not arm.unsimulated:
        simulated = joint_positions_3d(arm, motion.simulated_angles, motion.simulated_base)
    return PlanDrawing(
        problem=plan.problem,
        trajectory=motion.trajectory,
        points=points_with_tool(arm, motion.trajectory.positions),
        curves=recorded_curves(motion.arrays, arm),
        nearest=recorded_nearest(plan.folder),
        simulated=simulated,
    )


present_with(sys.modules[__name__])
