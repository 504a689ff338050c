"""Plans kept and shown from Python: saved to a folder, loaded from one, drawn, and animated."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ccm_opt.core.arguments import expect
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import put_file_or_refuse
from ccm_opt.io.folder import solution_files, write_folder
from ccm_opt.io.reading_back import SavedMotion, load_any_problem, load_motion, recorded_curves, recorded_nearest
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointStates, JointTrajectory, Solution
from ccm_opt.problem.solution.solution import present_with
from ccm_opt.robot.frames import joint_positions_3d

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ccm_opt.viz.arm_drawing import DrawnPlan


@dataclass(frozen=True, repr=False)
class SavedPlan:
    """A plan as its folder holds it.

    Attributes:
        folder: where it was loaded from.
        problem: what it solves.
        trajectory: the motion in time.
        joints: the same for the drives.
        motion: all of its arrays.
    """

    folder: Path
    problem: Problem
    trajectory: JointTrajectory
    joints: JointStates = field(repr=False)
    motion: SavedMotion = field(repr=False)

    def __repr__(self) -> str:
        return f"<SavedPlan of '{self.problem.name}': {self.trajectory.duration:.2f} s, from {self.folder}>"


def load(folder: str | Path) -> SavedPlan:
    """Load a plan from an output folder of ``ccm-opt solve`` or of ``save``.

    What is loaded is read, not verified again: ``ccm_opt.check(plan.problem, plan.trajectory, plan.joints)`` does that.

    Args:
        folder: the folder.

    Raises:
        ProblemError: there is no such folder, or it is not readable.
        VerificationError: it holds the record of a failure.
    """
    expect(folder, (str, Path), "the path of an output folder")
    place = Path(folder)
    problem = load_any_problem(place)
    motion = load_motion(place, problem.arm)
    return SavedPlan(place, problem, motion.trajectory, motion.joints, motion)


def save(solution: Solution, folder: str | Path) -> Path:
    """Save a solution to a folder, as ``ccm-opt solve --no-pictures`` does.

    Args:
        solution: the plan.
        folder: that is to hold it; an earlier plan in it gives way, files of yours stay.

    Returns:
        The folder.

    Raises:
        ProblemError: it cannot be written, or holds something else.
    """
    expect(solution, Solution, "a ccm_opt.Solution", "ccm_opt.solve makes one")
    expect(folder, (str, Path), "the path of an output folder")
    return write_folder(Path(folder), solution_files(solution))


def plot(plan: Solution | SavedPlan) -> "Figure":
    """Draw a plan: room, start, poses on the way, goals, path of the tip, least gap.

    Args:
        plan: just made, or loaded.

    Returns:
        A matplotlib figure, which notebooks show, and ``savefig`` writes.
    """
    from ccm_opt.viz.plan import plan_figure  # noqa: PLC0415 - loads matplotlib

    return plan_figure(drawn(plan))


def animate(plan: Solution | SavedPlan, file: str | Path) -> Path:
    """Write a film of a plan.

    Args:
        plan: just made, or loaded.
        file: ends with ``.gif``, or with ``.mp4`` where ffmpeg is installed.

    Returns:
        The file.

    Raises:
        ProblemError: for another ending, without ffmpeg, or where the file cannot be written.
    """
    from ccm_opt.viz.films import motion_gif, motion_mp4  # noqa: PLC0415 - loads matplotlib

    expect(file, (str, Path), "the path of a film")
    place = Path(file)
    if place.suffix not in {".gif", ".mp4"}:
        raise ProblemError(f"a film ends with .gif or .mp4, got '{place.name}'")
    shown = drawn(plan)
    put_file_or_refuse(place, motion_gif(shown) if place.suffix == ".gif" else motion_mp4(shown))
    return place


def drawn(plan: Solution | SavedPlan) -> "DrawnPlan":
    """Return what pictures show of a plan; of one that was loaded the simulated arm too."""
    from ccm_opt.viz.arm_drawing import DrawnPlan  # noqa: PLC0415 - loads matplotlib

    expect(plan, (Solution, SavedPlan), "a plan", "ccm_opt.solve makes one and ccm_opt.load reads one")
    if not isinstance(plan, SavedPlan):
        return DrawnPlan.from_solution(plan)
    arm, motion = plan.problem.arm, plan.motion
    simulated = joint_positions_3d(arm, motion.simulated_angles, motion.simulated_base.sum(axis=1))
    return DrawnPlan(
        problem=plan.problem,
        trajectory=plan.trajectory,
        points=arm.joint_positions_at(plan.trajectory.positions),
        curves=recorded_curves(motion.arrays, arm),
        nearest=recorded_nearest(plan.folder),
        simulated=simulated if arm.dimension == 2 else None,
    )


present_with(sys.modules[__name__])
