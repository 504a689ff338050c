"""The rows that hold a goal pose where it is, in plain words: which wall, which joint, which constraint."""

import re
from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import GoalPoseRecord, Solution

_REGION = re.compile(r"link (\d+): side \d+ of its region, at its (start|end)")
_BEND = re.compile(r"joint (\d+): bend (left|right)")
_NEAR = 3.0
"""Multiples of the wanted gap within which the neighbour of a link is named. Taste."""
_TORQUE = re.compile(r"joint (\d+): torque (?:up|down)")


@dataclass(frozen=True)
class BindingRow:
    """Something that holds a pose where it is.

    Attributes:
        words: what it is.
        gain: how much the objective would fall if it gave way by the unit.
        unit: in words, for example ``1 mm``.
    """

    words: str
    gain: float
    unit: str


def binding_rows(
    solution: Solution, record: GoalPoseRecord, points: FloatArray, units: PageUnits, most: int = 6
) -> list[BindingRow]:
    """The strongest rows of a goal pose; those of one link against one wall count as one.

    Args:
        solution: the plan.
        record: of the goal pose.
        points: base, joints and tip of the pose, shape (n + 1, 2) [m].
        units: of the page.
        most: rows that are kept.
    """
    merged: dict[tuple[str, str], float] = {}
    for name, multiplier in record.multipliers.items():
        row = _row(solution, record, name, multiplier, points, units)
        key = (row.words, row.unit)
        merged[key] = merged.get(key, 0.0) + row.gain
    rows = [BindingRow(words, gain, unit) for (words, unit), gain in merged.items()]
    return sorted(rows, key=lambda row: -row.gain)[:most]


def _row(
    solution: Solution, record: GoalPoseRecord, name: str, multiplier: float, points: FloatArray, units: PageUnits
) -> BindingRow:
    """One row: multipliers are for one arm's length, one radian, or the whole of a limit."""
    if region := _REGION.fullmatch(name):
        link = int(region[1])
        end = points[link if region[2] == "end" else link - 1]
        gain = units.metres * multiplier / solution.problem.arm.length
        beside = _neighbour(solution, points, link, end, reach=_NEAR * record.wanted_gap)
        return BindingRow(f"link {link} beside {beside}", gain, f"1 {units.name}")
    if bend := _BEND.fullmatch(name):
        return BindingRow(f"joint {bend[1]} at its limit to the {bend[2]}", np.deg2rad(1.0) * multiplier, "1°")
    if torque := _TORQUE.fullmatch(name):
        return BindingRow(f"the torque that joint {torque[1]} may hold", 1e-2 * multiplier, "1 % more")
    if name.startswith("user: "):
        return BindingRow(f"your constraint '{name.removeprefix('user: ')}'", multiplier, "1 of its unit")
    return BindingRow(name, multiplier, "1")


def _neighbour(solution: Solution, points: FloatArray, link: int, end: FloatArray, reach: float) -> str:
    """What is nearest to the end of a link: a wall by its name, or another link that is not its neighbour."""
    # A side of a region is a plane: what it keeps the link from may touch it far from the link.
    problem = solution.problem
    place = shapely.Point(end)
    walls = problem.workspace.walls
    gaps = [shapely.distance(wall.core, place) - wall.rounding for wall in walls]
    nearest = int(np.argmin(gaps))
    links = np.asarray(shapely.linestrings(np.stack((points[:-1], points[1:]), axis=1)))
    # Two links share the room between them; the arm's radius is taken off on both sides.
    apart = np.abs(np.arange(len(links)) + 1 - link) * problem.arm.length / len(links)
    far_along = apart > np.pi * problem.arm.radius + 2.0 * problem.arm.length / len(links)
    to_links = np.where(far_along, shapely.distance(links, place), np.inf)
    to_wall = gaps[nearest] - problem.arm.radius - problem.workspace.clearance
    to_link = 0.5 * float(to_links.min()) - problem.arm.radius
    if min(to_wall, to_link) > reach:
        return "what is around it"
    if to_link < to_wall:
        return f"link {int(np.argmin(to_links)) + 1}"
    return f"'{walls[nearest].name}'"
