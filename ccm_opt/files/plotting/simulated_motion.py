"""The picture ``simulation.png``: where the simulated arm went, and how far it left the plan."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_body
from ccm_opt.files.plotting.figure_files import figure_png
from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.files.plotting.workspace_drawing import draw_workspace
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.frames import joint_positions_3d
from ccm_opt.problem import Problem
from ccm_opt.solution import JointStates, JointTrajectory, SimulatedMotion


def simulation_png(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: JointStates,
    simulated: SimulatedMotion,
    settings: PictureSettings = PICTURES,
) -> bytes:
    """The picture of a simulated motion.

    Args:
        problem: arm and workspace.
        trajectory: the plan.
        joints: the plan for all revolutes.
        simulated: what the arm did.
        settings: resolution, and the poses that are drawn.

    Returns:
        The content of a PNG file.
    """

    def draw() -> Figure:
        figure = Figure(figsize=(9.0, 4.6), dpi=settings.dots_per_inch, layout="constrained")
        scene, errors = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
        _draw_scene(scene, problem, trajectory, simulated, settings.simulated_poses)
        draw_errors(errors, trajectory, joints, simulated, settings.least_error)
        figure.legend(*scene.get_legend_handles_labels(), loc="outside lower left", ncols=3, frameon=False)
        return figure

    return figure_png(draw)


def _draw_scene(
    axes: Axes,
    problem: Problem,
    trajectory: JointTrajectory,
    simulated: SimulatedMotion,
    shares: tuple[float, ...],
) -> None:
    """Planned end, simulated poses and end, seen in the plane."""
    draw_workspace(axes, problem.workspace)
    arm = problem.arm
    carried = np.sum(simulated.base_positions, axis=1)
    points = joint_positions_3d(arm, simulated.angles, carried)[..., [0, 2]]
    end = arm.joint_positions_at(trajectory.positions[-1])
    draw_body(axes, end, arm.radius, style.START, style.START_EDGE, label="planned end", zorder=3)
    for k, pose in enumerate(poses_at(shares, trajectory.time[: simulated_samples(trajectory, simulated)], points)):
        label = "simulated, on the way" if k == 0 else ""
        axes.plot(pose[:, 0], pose[:, 1], color=style.TIP_PATH, linewidth=1.0, label=label, zorder=4)
    draw_body(axes, points[-1], arm.radius, style.GOAL_ARM, style.GOAL_ARM_EDGE, label="simulated end", zorder=5)
    axes.set(title=f"{problem.name}: {simulated.verdict.outcome}", xlabel="x [m]", ylabel="y [m]")


def simulated_samples(trajectory: JointTrajectory, simulated: SimulatedMotion) -> int:
    """Number of samples that the simulation reached: those after a run was stopped show nothing of the arm."""
    verdict = simulated.verdict
    if verdict.outcome != "diverged" or verdict.time is None:
        return len(trajectory.time)
    return max(int(np.searchsorted(trajectory.time, verdict.time)), 1)


def poses_at(shares: tuple[float, ...], time: FloatArray, points: FloatArray) -> FloatArray:
    """The poses at given shares of the duration, shape (len(shares), links + 1, 2 or 3) [m]."""
    samples = np.searchsorted(time, np.array(shares) * time[-1])
    return np.asarray(points[samples], dtype=np.float64)


def draw_errors(
    axes: Axes, trajectory: JointTrajectory, joints: JointStates, simulated: SimulatedMotion, least: float
) -> None:
    """Largest joint error over time, on a logarithmic scale, and when the arm ceased to follow."""
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
    axes.set(title="largest error", xlabel="time [s]", ylabel="difference from the plan")
    axes.legend(frameon=False)
    axes.grid(visible=True, linewidth=0.4, color=style.WALL)
