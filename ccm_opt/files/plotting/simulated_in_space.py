"""The picture ``simulation.png`` of an arm in space: where the simulated arm went, and how far it left the plan."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.figure_files import figure_png
from ccm_opt.files.plotting.picture_settings import PICTURES, SPACE_PICTURES
from ccm_opt.files.plotting.simulated_motion import draw_errors, poses_at, simulated_samples
from ccm_opt.files.plotting.space_plan import draw_arm, dress_view
from ccm_opt.files.plotting.space_views import SIDES, SeenScene, Side, window_of
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.frames import joint_positions_3d
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.solution import JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.space.problem import SpaceProblem

_VIEWS = SIDES[:2]
"""From above and from the front: between them they show every coordinate."""


def space_simulation_png(
    problem: SpaceProblem, trajectory: JointTrajectory, joints: JointStates, simulated: SimulatedMotion
) -> bytes:
    """The picture of a simulated motion in space.

    Args:
        problem: arm and scene.
        trajectory: the plan.
        joints: the plan for all revolutes.
        simulated: what the arm did.

    Returns:
        The content of a PNG file.
    """
    reached = simulated_samples(trajectory, simulated)
    carried = np.sum(simulated.base_positions[:reached], axis=1)
    points = joint_positions_3d(problem.arm, simulated.angles[:reached], carried)
    planned = joint_positions(problem.arm, trajectory.positions)
    between = poses_at(PICTURES.simulated_poses, trajectory.time[:reached], points)
    window = window_of(problem, np.concatenate((planned, points)))

    def draw() -> Figure:
        figure, grid = _sheet(np.ptp(window, axis=0))
        scene = SeenScene(problem)
        for row, side in enumerate(_VIEWS):
            axes = figure.add_subplot(grid[row, 0])
            _draw_scene(axes, scene, side, window)
            # The width of a band is known once its axes have their place.
            figure.draw_without_rendering()
            _draw_poses(axes, side, problem.arm.radius, planned[-1], points[-1], between)
        draw_errors(figure.add_subplot(grid[:, 1]), trajectory, joints, simulated, PICTURES.least_error)
        figure.suptitle(f"{problem.name}: {simulated.verdict.outcome}", x=0.02, ha="left", fontsize=10)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower left", ncols=3, frameon=False, fontsize=style.FONT_SIZE)
        return figure

    return figure_png(draw)


def _sheet(spans: FloatArray) -> tuple[Figure, GridSpec]:
    """A figure with room for two views of a box of some extent, shape (3,) [m], and for the errors beside them."""
    scale = SPACE_PICTURES.side / float(np.max(spans))
    width = max(scale * spans[0], 2.6)
    heights = [max(scale * spans[1], 1.3), max(scale * spans[2], 1.3)]
    size = (width + 5.2, sum(heights) + 1.8)
    figure = Figure(figsize=size, dpi=SPACE_PICTURES.dots_per_inch, layout="constrained")
    return figure, figure.add_gridspec(2, 2, width_ratios=(width, 4.4), height_ratios=heights)


def _draw_scene(axes: Axes, scene: SeenScene, side: Side, window: FloatArray) -> None:
    """The scene from a side, within its limits."""
    low, high = side(window)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    scene.draw_room(axes, side)
    scene.draw(axes, side)
    axes.set_aspect("equal", adjustable="box", anchor="NW")
    dress_view(axes, side, scene.problem)


def _draw_poses(
    axes: Axes, side: Side, radius: float, planned: FloatArray, end: FloatArray, between: FloatArray
) -> None:
    """Planned end, simulated poses on the way, and simulated end."""
    draw_arm(axes, side(planned), radius, style.START_EDGE, 0.45, "planned end")
    for k, pose in enumerate(between):
        label = "simulated, on the way" if k == 0 else ""
        axes.plot(*side(pose).T, color=style.TIP_PATH, linewidth=1.0, label=label, zorder=5)
    draw_arm(axes, side(end), radius, style.GOAL_ARM, 0.85, "simulated end")
