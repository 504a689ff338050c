"""Pictures of survived errors.

Each link is drawn as wide as the errors that the plan survives may take it, by the bound that is certified.
"""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.robot.space_kinematics import joint_positions
from ccm_opt.solution import JointTrajectory, SurvivedError
from ccm_opt.verification.survived_in_space import moved_by_joint_errors
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import draw_body, draw_workspace, polygon_patch
from ccm_opt.viz.figure_files import figure_png
from ccm_opt.viz.plan import dress, layout_of
from ccm_opt.viz.settings import PICTURES, SPACE_PICTURES, PictureSettings, SpacePictureSettings
from ccm_opt.viz.space_plan import draw_arm, dress_view, points_a_metre, sheet_of_sides
from ccm_opt.viz.space_section import draw_section
from ccm_opt.viz.space_views import SIDES, SeenScene, Side, window_of


def space_tolerance_png(
    problem: SpaceProblem,
    trajectory: JointTrajectory,
    error: SurvivedError,
    settings: SpacePictureSettings = SPACE_PICTURES,
) -> bytes:
    """The picture of what errors of the joints may do.

    Args:
        problem: arm and scene.
        trajectory: the plan.
        error: of the joints, that it survives.
        settings: sizes.

    Returns:
        The content of a PNG file.
    """
    number = len(trajectory.time) - 1 if error.time is None else int(np.argmin(np.abs(trajectory.time - error.time)))
    points = joint_positions(problem.arm, trajectory.positions[number])
    moved = moved_by_joint_errors(problem.arm, points, error.size)

    def draw() -> Figure:
        window = window_of(problem, points[None])
        sheet = sheet_of_sides(window, settings)
        scene = SeenScene(problem, settings)
        for side, axes in zip(SIDES, sheet.views, strict=True):
            low, high = side(window)
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[1], high[1])
            scene.draw_room(axes, side)
            scene.draw(axes, side)
            axes.set_aspect("equal", adjustable="box", anchor="NW")
            _draw_reach_of_errors(axes, side(points), problem.arm.radius + moved)
            draw_arm(axes, side(points), problem.arm.radius, style.GOAL_ARM, 0.85, "arm")
            _draw_place(axes, side, error)
            dress_view(axes, side, problem)
        when = trajectory.time[number]
        _draw_along(sheet.section, problem, points, moved, settings)
        figure = sheet.figure
        title = f"{problem.name} at {when:.2f} s: survives joint errors of {np.rad2deg(error.size):.3g}°"
        figure.suptitle(title, x=0.02, ha="left", fontsize=10)
        handles, labels = sheet.views[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=5, frameon=False, fontsize=style.FONT_SIZE)
        return figure

    return figure_png(draw)


def _draw_reach_of_errors(axes: Axes, flat: FloatArray, half: FloatArray) -> None:
    """Every link as wide as it may get.

    Args:
        axes: with their limits and aspect.
        flat: joints and tip in the picture, shape (links + 1, 2) [m].
        half: width of each link to either side, shape (links,) [m].
    """
    scale = points_a_metre(axes)
    for link, width in enumerate(half):
        label = "where errors may take it" if link == 0 else ""
        ends = flat[link : link + 2].T
        axes.plot(
            *ends, color=style.START_EDGE, linewidth=max(2.0 * width * scale, 1.2), solid_capstyle="round", zorder=5,
            label=label,
        )  # fmt: skip


def _draw_place(axes: Axes, side: Side, error: SurvivedError) -> None:
    """A cross where the error is limited."""
    if error.place:
        axes.plot(
            *side(np.array(error.place)), marker="x", markersize=8, markeredgewidth=2.0, linestyle="none", zorder=9,
            color=style.PRESSED, label="what limits them",
        )  # fmt: skip


def _draw_along(
    axes: Axes, problem: SpaceProblem, points: FloatArray, moved: FloatArray, settings: SpacePictureSettings
) -> None:
    """The section along the arm, with how far errors take it."""
    draw_section(axes, problem, points, settings, "section along the arm, and how far errors take it")
    arm = problem.arm
    unit = METRES[problem.length_unit]
    along = arm.link_length * (np.arange(arm.links) + 0.5) / unit
    for sign in (1.0, -1.0):
        axes.plot(along, sign * (arm.radius + moved) / unit, color=style.START_EDGE, linewidth=1.0, zorder=4)


def tolerance_png(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: SurvivedError,
    tube: shapely.Geometry,
    planned: shapely.Geometry,
    settings: PictureSettings = PICTURES,
) -> bytes:
    """The content of the PNG file.

    Args:
        problem: the room and the arm.
        trajectory: the plan.
        joints: the error of the joints that it survives.
        tube: what the arm may sweep with it.
        planned: what it sweeps without.
        settings: sizes.
    """
    return figure_png(lambda: _figure(problem, trajectory, joints, tube, planned, settings))


def _figure(
    problem: Problem,
    trajectory: JointTrajectory,
    joints: SurvivedError,
    tube: shapely.Geometry,
    planned: shapely.Geometry,
    settings: PictureSettings,
) -> Figure:
    layout = layout_of(problem.workspace.boundary.bounds, settings)
    figure = Figure(figsize=layout.size, dpi=settings.dots_per_inch)
    axes = figure.add_axes(layout.place)
    draw_workspace(axes, problem.workspace, settings)
    _draw_region(axes, tube, style.TUBE, "may be swept", 2.2)
    _draw_region(axes, planned, style.REGION_TINT, "swept as planned", 2.4)
    if joints.time is not None:
        _draw_limit(axes, problem, trajectory, joints)
    least = "" if joints.limited else "at least "
    dress(figure, axes, f"{problem.name}: every joint may be off by {least}{np.rad2deg(joints.size):.3g}°", problem)
    return figure


def _draw_region(axes: Axes, region: shapely.Geometry, colour: str, label: str, zorder: float) -> None:
    for part in getattr(region, "geoms", [region]):
        axes.add_patch(polygon_patch(part, facecolor=colour, edgecolor="none", zorder=zorder, label=label))
        label = ""


def _draw_limit(axes: Axes, problem: Problem, trajectory: JointTrajectory, joints: SurvivedError) -> None:
    """The pose that limits the error, the same with the worst errors, and a ring about the place."""
    arm = problem.arm
    pose = np.array([np.interp(joints.time or 0.0, trajectory.time, column) for column in trajectory.positions.T])
    worst = pose.copy()
    worst[: arm.links] += joints.size * np.array(joints.worst)
    planned, off = arm.joint_positions_at(np.stack((pose, worst)))
    draw_body(axes, planned, arm.radius, style.START, style.START_EDGE, label="the pose that limits it", zorder=3.0)
    axes.plot(off[:, 0], off[:, 1], color=style.PRESSED, linewidth=1.1, zorder=6.0, label="with the worst errors")
    axes.plot(
        *joints.place, marker="o", markersize=11, markerfacecolor="none", markeredgewidth=1.6, color=style.PRESSED,
        zorder=9, linestyle="none", label="the place",
    )  # fmt: skip
