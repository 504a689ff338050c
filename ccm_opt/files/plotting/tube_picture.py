"""The picture ``tolerance.png``: what the arm may sweep when its joints are off, and the place that limits it."""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.files.plotting import style
from ccm_opt.files.plotting.arm_drawing import draw_body
from ccm_opt.files.plotting.figure_files import figure_png
from ccm_opt.files.plotting.picture_settings import PICTURES, PictureSettings
from ccm_opt.files.plotting.plan import dress, layout_of
from ccm_opt.files.plotting.workspace_drawing import draw_workspace, polygon_patch
from ccm_opt.problem import Problem
from ccm_opt.solution import JointTrajectory, SurvivedError


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
