"""The section along an arm in space: distances to surfaces above, below, left and right of it.

The directions are carried along the arm by the smallest rotation from link to link, like the curve's own frame, so that
up stays up as far as the arm allows.
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
"""Search distance of the section, as a share of the arm's length."""

_PLACES = 100
"""Number of places along the arm at which the section measures. Taste."""
_TOUCHING = 1e-5
"""Share of the search distance within which a ray counts as touching: distances near zero carry rounding."""
_STEPS = 40
"""Steps along a ray, after which it is within a thousandth of a surface that it meets at 10 degrees. Derived."""


@dataclass(frozen=True, eq=False)
class ArmSection:
    """Free lengths of rays perpendicular to the arm, at several positions along its axis.

    Attributes:
        place: arc length along the arm, shape (N,) [m].
        free: length of the rays in four directions, up, left, down, right, at most the search distance, shape (N, 4)
            [m].
        nearest: distance of the axis from the nearest surface in any direction, even between the rays; at most the
            search distance, shape (N,) [m].
        reach: search distance [m].
    """

    place: FloatArray
    free: FloatArray
    nearest: FloatArray
    reach: float


def section_along(problem: Problem, points: FloatArray, count: int, reach: float) -> ArmSection:
    """Measure the free space around the arm in a pose.

    Args:
        problem: problem with the surfaces.
        points: joints and tip, shape (links + 1, 3) [m].
        count: number of positions along the arm.
        reach: search distance [m].
    """
    arm = problem.arm
    place = np.linspace(0.0, arm.length, count, endpoint=False) + 0.5 * arm.length / count
    link = np.minimum((place / arm.link_length).astype(np.intp), arm.links - 1)
    along = np.diff(points, axis=0) / arm.link_length
    origins = points[link] + (place - link * arm.link_length)[:, None] * along[link]
    up = _carried_up(along, arm.up)[link]
    left = np.cross(up, along[link])
    rays = np.stack((up, left, -up, -left), axis=1)
    tree = SurfaceTree.of(problem.workspace.soup)
    free = free_lengths(tree, np.repeat(origins, 4, axis=0), rays.reshape(-1, 3), reach)
    nearest = tree.distances(np.stack((origins, origins), axis=1), reach)
    return ArmSection(place, free.reshape(count, 4), np.maximum(nearest, 0.0), reach)


def _carried_up(along: FloatArray, first: FloatArray) -> FloatArray:
    """Return an upward direction per link, carried from link to link by the smallest rotation, shape (links, 3)."""
    found = [first - (first @ along[0]) * along[0]]
    for before, after in pairwise(along):
        axis = np.cross(before, after)
        latest = found[-1]
        # Rodrigues' formula for the rotation that takes one unit vector to the other.
        turned = latest + np.cross(axis, latest) + np.cross(axis, np.cross(axis, latest)) / (1.0 + before @ after)
        found.append(turned / np.linalg.norm(turned))
    return np.stack(found)


def free_lengths(tree: SurfaceTree, origins: FloatArray, rays: FloatArray, reach: float) -> FloatArray:
    """Return the length of each ray to the first surface that it meets, at most the search distance, shape (N,) [m].

    Each step along a ray is as long as the distance to the nearest surface in any direction (Hart, *Sphere tracing*,
    1996).

    Args:
        tree: tree of the surfaces.
        origins: start points of the rays, shape (N, 3) [m].
        rays: unit vectors, shape (N, 3).
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
    """Draw the surfaces around the straightened arm, and the distance to the nearest surface in any direction.

    Args:
        axes: axes to draw in.
        problem: arm and scene.
        pose: joints and tip, shape (links + 1, 3) [m].
        title: title above the section and its legend.
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
    radius = max(arm.radius, 0.002 * arm.length) / unit
    axes.fill_between([0.0, arm.length / unit], -radius, radius, color=style.GOAL_ARM, linewidth=0.0, zorder=2)
    for limit in (1.0, -1.0):
        wanted = limit * (radius + (problem.workspace.clearance + problem.wanted_gap) / unit)
        axes.axhline(wanted, color=style.GOAL_ARM_EDGE, linewidth=0.6, linestyle=(0, (1, 2)), zorder=2)
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
