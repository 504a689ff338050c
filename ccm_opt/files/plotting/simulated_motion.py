"""``simulation.png``: where the simulated arm went, beside how far it left the plan."""

from io import BytesIO

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ccm_opt.arrays import FloatArray
from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_body
from ccm_opt.files.plotting.room import draw_workspace
from ccm_opt.jointed.frames import joint_positions_3d
from ccm_opt.problem import Problem
from ccm_opt.solution import JointStates, JointTrajectory, SimulatedMotion

DOTS_PER_INCH = 120
FLOOR = 1e-7
"""Errors below this are drawn at it."""
POSES = (0.25, 0.5, 0.75)
"""Shares of the duration at which the simulated arm is drawn on its way."""


def simulation_png(
    problem: Problem, trajectory: JointTrajectory, joints: JointStates, simulated: SimulatedMotion
) -> bytes:
    """The picture of a simulated motion.

    Args:
        problem: arm and workspace.
        trajectory: the plan.
        joints: the plan for all revolutes.
        simulated: what the arm did.

    Returns:
        The content of a PNG file.
    """
    with rc_context({"font.family": style.FONT_FAMILY, "font.size": style.FONT_SIZE}):
        figure = Figure(figsize=(9.0, 4.6), dpi=DOTS_PER_INCH, layout="constrained")
        scene, errors = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
        _draw_scene(scene, problem, trajectory, simulated)
        _draw_errors(errors, trajectory, joints, simulated)
        figure.legend(*scene.get_legend_handles_labels(), loc="outside lower left", ncols=3, frameon=False)
        buffer = BytesIO()
        FigureCanvasAgg(figure).print_png(buffer)  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def _draw_scene(axes: Axes, problem: Problem, trajectory: JointTrajectory, simulated: SimulatedMotion) -> None:
    """Planned end, simulated poses and end, seen in the plane."""
    draw_workspace(axes, problem.workspace)
    arm = problem.arm
    carried = np.sum(simulated.base_positions, axis=1)
    points = joint_positions_3d(arm, simulated.angles, carried)[..., [0, 2]]
    end = arm.joint_positions_at(trajectory.positions[-1])
    draw_body(axes, end, arm.radius, style.START, style.START_EDGE, label="planned end", zorder=3)
    for label, pose in zip(("simulated, on the way", "", ""), _on_the_way(trajectory.time, points), strict=True):
        axes.plot(pose[:, 0], pose[:, 1], color=style.TIP_PATH, linewidth=1.0, label=label, zorder=4)
    draw_body(axes, points[-1], arm.radius, style.GOAL_ARM, style.GOAL_ARM_EDGE, label="simulated end", zorder=5)
    axes.set(title=problem.name, xlabel="x [m]", ylabel="y [m]")


def _on_the_way(time: FloatArray, points: FloatArray) -> FloatArray:
    samples = np.searchsorted(time, np.array(POSES) * time[-1])
    return np.asarray(points[samples], dtype=np.float64)


def _draw_errors(axes: Axes, trajectory: JointTrajectory, joints: JointStates, simulated: SimulatedMotion) -> None:
    """Largest joint error over time, on a logarithmic scale."""
    errors = np.max(np.abs(simulated.angles - joints.angles), axis=1)
    axes.semilogy(trajectory.time, np.maximum(errors, FLOOR), color=style.GOAL_ARM, label="joints [rad]")
    away = np.abs(simulated.base_positions - trajectory.base_positions)
    for name, error in zip(trajectory.coordinates.base_names, away.T, strict=True):
        axes.semilogy(trajectory.time, np.maximum(error, FLOOR), color=style.TIP_PATH, label=f"{name} [m]")
    axes.set(title="largest error", xlabel="time [s]", ylabel="difference from the plan")
    axes.legend(frameon=False)
    axes.grid(visible=True, linewidth=0.4, color=style.WALL)
