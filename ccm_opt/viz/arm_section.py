"""Section along an arm in space: a chart of the distances to surfaces above, below, left and right of the arm.

The four directions are transported from link to link by the smallest rotation (as in a rotation-minimising frame), so
that up remains up as far as the arm allows.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import METRES
from ccm_opt.problem import Problem
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.viz import figure_files as style

_SECTION_SHARE = 0.12
"""Maximum distance measured from the arm's axis, as a fraction of the arm's length."""

_PLACES = 100
"""Number of positions along the arm at which distances are measured. Heuristic."""
_TOUCHING = 1e-5
"""Distance from a surface at which a ray ends, as a fraction of the search distance; smaller distances are dominated by
rounding errors."""
_STEPS = 40
"""Maximum number of steps along a ray. Derived: they reach a surface at an angle of 10 degrees to within a thousandth
of the distance."""


@dataclass(frozen=True, eq=False)
class ArmSection:
    """Free lengths of rays perpendicular to an arm in space, at N positions along the arm's axis.

    Attributes:
        place: arc lengths of the positions from the base, shape (N,) [m].
        free: lengths of the rays up, left, down and right to the first surface, at most ``reach``, shape (N, 4) [m].
        nearest: distances from the axis to the nearest surface in any direction, at most ``reach``, shape (N,) [m].
        reach: search distance [m].
    """

    place: FloatArray
    free: FloatArray
    nearest: FloatArray
    reach: float


def section_along(problem: Problem, points: FloatArray, count: int, reach: float) -> ArmSection:
    """Return the distances from an arm in a given pose to the surfaces around the arm.

    Args:
        problem: the problem, which gives the arm of n links and the surfaces.
        points: positions of joints and tip, shape (n + 1, 3) [m].
        count: number N of positions along the arm.
        reach: search distance [m].
    """
    arm = problem.arm
    place = np.linspace(0.0, arm.length, count, endpoint=False) + 0.5 * arm.length / count
    link = np.clip(np.searchsorted(arm.joint_places, place, side="right") - 1, 0, arm.links - 1)
    along = np.diff(points, axis=0) / arm.lengths[:, None]
    origins = points[link] + (place - arm.joint_places[link])[:, None] * along[link]
    up = _carried_up(along, arm.up)[link]
    left = np.cross(up, along[link])
    rays = np.stack((up, left, -up, -left), axis=1)
    tree = SurfaceTree.from_triangles(problem.workspace.triangle_soup)
    free = free_lengths(tree, np.repeat(origins, 4, axis=0), rays.reshape(-1, 3), reach)
    nearest = tree.distances(np.stack((origins, origins), axis=1), reach)
    return ArmSection(place, free.reshape(count, 4), np.maximum(nearest, 0.0), reach)


def _carried_up(along: FloatArray, first: FloatArray) -> FloatArray:
    """Return an upward unit vector for each link, transported from link to link by the smallest rotation, shape (n, 3).

    Args:
        along: unit vectors along the n links, shape (n, 3).
        first: upward direction at the base, shape (3,).
    """
    found = [first - (first @ along[0]) * along[0]]
    for before, after in pairwise(along):
        axis = np.cross(before, after)
        latest = found[-1]
        # Rodrigues' formula for the rotation that takes one unit vector to the other.
        turned = latest + np.cross(axis, latest) + np.cross(axis, np.cross(axis, latest)) / (1.0 + before @ after)
        found.append(turned / np.linalg.norm(turned))
    return np.stack(found)


def free_lengths(tree: SurfaceTree, origins: FloatArray, rays: FloatArray, reach: float) -> FloatArray:
    """Return the length of each of N rays up to the first surface, at most the search distance, shape (N,) [m].

    The method is sphere tracing (Hart, 1996): each step along a ray is as long as the distance to the nearest surface.
    It never passes a surface; along one that a ray nearly grazes, the result may be too short.

    Args:
        tree: tree of the surfaces.
        origins: start points of the rays, shape (N, 3) [m].
        rays: unit vectors along the rays, shape (N, 3).
        reach: search distance [m].
    """
    free = np.zeros(len(origins))
    for _ in range(_STEPS):
        places = origins + free[:, None] * rays
        away = tree.distances(np.stack((places, places), axis=1), reach)
        free = np.minimum(free + np.where(away > _TOUCHING * reach, away, 0.0), reach)
    return free


def draw_section(
    axes: Axes,
    problem: Problem,
    pose: FloatArray,
    title: str = "section along the arm at the goal",
) -> None:
    """Draw the surfaces around an arm in space as if the arm were straight, and the distance to the nearest surface.

    Args:
        axes: axes to draw in.
        problem: the problem, which gives the arm of n links and the surfaces.
        pose: positions of joints and tip, shape (n + 1, 3) [m].
        title: title above the drawing and the legend.
    """
    arm = problem.arm
    reach = max(_SECTION_SHARE * arm.length, 4.0 * arm.radius)
    section = section_along(problem, pose, _PLACES, reach)
    along = section.place / METRES[problem.length_unit]
    unit = METRES[problem.length_unit]
    up, left, down, right = section.free.T / unit
    edge = 1.02 * reach / unit
    for side, limit, name in ((up, edge, "above, below"), (-down, -edge, "")):
        met = np.abs(side) < reach / unit
        axes.fill_between(
            along, side, limit, where=met.tolist(), step="mid", label=name, color=style.WALL, linewidth=0.0, zorder=1
        )
    for side, name, colour in ((left, "left", style.TIP_PATH), (-right, "right", style.PRESSED)):
        shown = np.where(np.abs(side) < 0.999 * reach / unit, side, np.nan)
        axes.plot(along, shown, color=colour, linewidth=1.0, linestyle=(0, (3, 1.5)), label=name, zorder=3)
    nearest = np.where(section.nearest < 0.999 * reach, section.nearest, np.nan) / unit
    for sign, name in ((1.0, "nearest"), (-1.0, "")):
        axes.plot(along, sign * nearest, color=style.BOUNDARY, linewidth=0.8, label=name, zorder=2.5)
    radius = np.repeat(np.maximum(arm.radii, 0.002 * arm.length), 2) / unit
    ends = np.repeat(arm.joint_places, 2)[1:-1] / unit
    axes.fill_between(ends, -radius, radius, color=style.GOAL_ARM, linewidth=0.0, zorder=2)
    for limit in (1.0, -1.0):
        wanted = limit * (radius + (problem.workspace.clearance + problem.wanted_gap) / unit)
        axes.plot(ends, wanted, color=style.GOAL_ARM_EDGE, linewidth=0.6, linestyle=(0, (1, 2)), zorder=2)
    axes.set_xlim(0.0, arm.length / unit)
    axes.set_ylim(-edge, edge)
    axes.set_xlabel(f"from the base [{problem.length_unit}]; dotted: preferred clearance", fontsize=style.FONT_SIZE)
    axes.set_ylabel(f"distance from the axis [{problem.length_unit}]", fontsize=style.FONT_SIZE)
    axes.tick_params(length=2.5, color=style.WALL_EDGE, labelsize=style.FONT_SIZE)
    axes.set_title(title, fontsize=style.FONT_SIZE, loc="left", pad=14, y=1.0)
    # The space between title and section fits a legend of one line.
    axes.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, fontsize=style.FONT_SIZE - 1.5,
        borderpad=0.0, borderaxespad=0.2, handlelength=1.4, handletextpad=0.4, columnspacing=0.9,
    )  # fmt: skip
    for spine in axes.spines.values():
        spine.set_visible(False)
