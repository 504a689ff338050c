"""Pictures of simulated motions and of the joint errors that a plan tolerates.

Under tolerated errors each link is drawn with the width of the region that it may cover, by a certified bound.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointStates, JointTrajectory, SimulatedMotion, ToleratedError
from ccm_opt.robot.frames import joint_positions_3d
from ccm_opt.verification.tolerance.error_model import moved_by_joint_errors
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import PLANE, SIDES, Side, whole_workspace
from ccm_opt.viz.figure_files import figure_file
from ccm_opt.viz.scene_views import Pose, SceneViews
from ccm_opt.viz.settings import PICTURES
from ccm_opt.viz.views import SPACE_DOTS_PER_INCH, VIEW_SIDE, Sheet, action_window, dress_view, points_a_metre
from ccm_opt.viz.work_box import work_box

_SIMULATED_POSES = (0.25, 0.5, 0.75)
"""Fractions of the simulated duration at which the arm is drawn."""


def simulation_png(
    problem: Problem, trajectory: JointTrajectory, joints: JointStates, simulated: SimulatedMotion
) -> bytes:
    """Return the picture of a simulated motion and its tracking errors as the bytes of a PNG file.

    Args:
        problem: the problem, which gives arm and workspace.
        trajectory: the planned motion.
        joints: states of all revolute joints over the planned motion.
        simulated: motion of the simulated arm.
    """
    return figure_file(lambda: _simulation_figure(problem, trajectory, joints, simulated), "png")


def simulated_samples(trajectory: JointTrajectory, simulated: SimulatedMotion) -> int:
    """Return the number of samples before the simulation diverged, at least 1; all samples if it did not diverge."""
    verdict = simulated.verdict
    if verdict.outcome != "diverged" or verdict.time is None:
        return len(trajectory.time)
    return max(int(np.searchsorted(trajectory.time, verdict.time)), 1)


def draw_errors(
    axes: Axes, trajectory: JointTrajectory, joints: JointStates, simulated: SimulatedMotion, least: float
) -> None:
    """Draw the maximum joint error over time on a logarithmic scale, and the time at which tracking failed.

    Args:
        axes: axes to draw in.
        trajectory: the planned motion.
        joints: states of all revolute joints over the planned motion.
        simulated: motion of the simulated arm.
        least: error at the bottom of the scale [rad] or [m]; smaller errors are drawn there too.
    """
    reached = slice(simulated_samples(trajectory, simulated))
    time = trajectory.time[reached]
    errors = np.max(np.abs(simulated.angles - joints.angles), axis=1)[reached]
    axes.semilogy(time, np.maximum(errors, least), color=style.GOAL_ARM, label="joints [rad]")
    away = np.abs(simulated.base_positions - trajectory.base_positions)[reached]
    for name, error in zip(trajectory.coordinates.base_names, away.T, strict=True):
        axes.semilogy(time, np.maximum(error, least), color=style.TIP_PATH, label=f"{name} [m]")
    verdict = simulated.verdict
    if verdict.time is not None:
        label = f"{verdict.outcome} at {verdict.time:.3g} s"
        axes.axvline(verdict.time, color=style.WALL_EDGE, linewidth=1.0, linestyle="--", label=label)
    axes.set(title="largest error", xlabel="time [s]", ylabel="deviation from the plan")
    axes.legend(frameon=False)
    axes.grid(visible=True, linewidth=0.4, color=style.WALL)


def _simulation_figure(
    problem: Problem, trajectory: JointTrajectory, joints: JointStates, simulated: SimulatedMotion
) -> Figure:
    """Return the figure of a simulated motion, with the tracking errors over time.

    The figure shows the planned final pose, simulated poses, and the simulated final pose; in space from above and
    from the front.
    """
    arm, reached = problem.arm, simulated_samples(trajectory, simulated)
    points = joint_positions_3d(arm, simulated.angles[:reached], simulated.base_positions[:reached])
    planned = arm.joint_positions_at(trajectory.positions)
    if problem.dimension == 2:
        points = points[..., [0, 2]]
        window = whole_workspace(problem.workspace)
        sides: tuple[Side, ...] = (PLANE,)
    else:
        window = work_box(problem, np.concatenate((planned, points)), np.concatenate((planned[-1:], points)))
        sides = SIDES[:2]
    figure, grid = _sheet_with_errors([np.ptp(side(window), axis=0) for side in sides])
    scene = SceneViews(problem)
    time = trajectory.time[:reached]
    between = points[np.searchsorted(time, np.array(_SIMULATED_POSES) * time[-1])]
    for row, side in enumerate(sides):
        axes = figure.add_subplot(grid[row, 0])
        dress_view(axes, side, problem)
        # The resolution of the view depends on the place of its axes.
        figure.draw_without_rendering()
        planned_end = Pose(planned[-1], arm.radii, "start", "planned end")
        scene.begin_view(axes, side, window, [planned_end, Pose(points[-1], arm.radii, "end", "simulated end")])
        for k, pose in enumerate(between):
            label = "simulated, along the way" if k == 0 else ""
            axes.plot(*side(pose).T, color=style.TIP_PATH, linewidth=1.0, label=label, zorder=5)
    draw_errors(figure.add_subplot(grid[:, 1]), trajectory, joints, simulated, PICTURES.least_error)
    figure.suptitle(f"{problem.name}: {simulated.verdict.outcome}", x=0.02, ha="left", fontsize=10)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=3, frameon=False, fontsize=style.FONT_SIZE)
    return figure


def _sheet_with_errors(spans: list[FloatArray]) -> tuple[Figure, GridSpec]:
    """Return a figure and its grid, with stacked views in the left column and the error chart in the right column.

    Args:
        spans: width and height of each view, each of shape (2,) [m].
    """
    scale = VIEW_SIDE / float(np.max(spans))
    width = max(scale * spans[0][0], 2.6)
    heights = [max(scale * span[1], 1.3) for span in spans]
    size = (width + 5.2, max(sum(heights), 2.6) + 0.6 + 0.6 * len(spans))
    figure = Figure(figsize=size, dpi=SPACE_DOTS_PER_INCH, layout="constrained")
    return figure, figure.add_gridspec(len(spans), 2, width_ratios=(width, 4.4), height_ratios=heights)


def tolerance_png(problem: Problem, trajectory: JointTrajectory, error: ToleratedError) -> bytes:
    """Return the picture of the effect of the tolerated joint errors on a plan as the bytes of a PNG file.

    Args:
        problem: the problem, which gives arm and workspace.
        trajectory: the planned motion.
        error: the maximum joint error that the plan tolerates.
    """
    return figure_file(lambda: _tolerance_figure(problem, trajectory, error), "png")


def _tolerance_figure(problem: Problem, trajectory: JointTrajectory, error: ToleratedError) -> Figure:
    number = len(trajectory.time) - 1 if error.time is None else int(np.argmin(np.abs(trajectory.time - error.time)))
    pose = trajectory.positions[number]
    worst = pose.copy()
    worst[: len(error.worst)] += error.size * np.array(error.worst)
    points, off = problem.arm.joint_positions_at(np.stack((pose, worst)))
    moved = moved_by_joint_errors(problem.arm, points, error.size)
    window = work_box(problem, points) if problem.dimension == 3 else action_window(problem, points)
    sheet = Sheet.for_problem(problem, window, [Pose(points, problem.arm.radii, "end", "arm")])
    for axes, side in sheet.all_views:
        _draw_error_reach(axes, side(points), problem.arm.radius + moved)
        axes.plot(*side(off).T, color=style.PRESSED, linewidth=1.1, zorder=8, label="with the worst errors")
        _mark_limiting_place(axes, side, error)
    label = f"tolerates joint errors of {np.rad2deg(error.size):.3g}°"
    sheet.finish(f"{problem.name} at {trajectory.time[number]:.2f} s: {label}")
    return sheet.figure


def _draw_error_reach(axes: Axes, flat: FloatArray, half: FloatArray) -> None:
    """Draw every link with the width of the region that the link may cover under the tolerated joint errors.

    Args:
        axes: axes with their limits and aspect set.
        flat: positions of joints and tip of n links in the picture, shape (n + 1, 2) [m].
        half: half width of each link's region, shape (n,) [m].
    """
    scale = points_a_metre(axes)
    for link, width in enumerate(half):
        label = "farthest under errors" if link == 0 else ""
        ends = flat[link : link + 2].T
        axes.plot(
            *ends, color=style.START_EDGE, linewidth=max(2.0 * width * scale, 1.2), solid_capstyle="round", zorder=5,
            label=label,
        )  # fmt: skip


def _mark_limiting_place(axes: Axes, side: Side, error: ToleratedError) -> None:
    """Draw a cross at the contact or limit that determines the maximum tolerated error."""
    if error.place:
        axes.plot(
            *side(np.array(error.place)), marker="x", markersize=8, markeredgewidth=2.0, linestyle="none", zorder=9,
            color=style.PRESSED, label="limiting place",
        )  # fmt: skip
