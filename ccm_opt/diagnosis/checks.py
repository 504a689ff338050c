"""Necessary conditions for a problem to have a plan, and the order in which they are checked.

One check is implemented here: whether the first links can turn from the start to the goal. They have few joints, so all
of their poses can be covered by cells in the space of their bends. A cell is closed if some point of a link is too
close to a wall in every pose of the cell. If no chain of open cells joins the start to the goal, there is no motion of
the first links, and hence none of the arm. Self-collision is ignored, and a cell is closed only if its centre is
blocked by enough to cover the whole cell, so the check never rejects a solvable problem.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import shapely
from scipy import ndimage

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Finding
from ccm_opt.core.length_words import words_for_unit
from ccm_opt.diagnosis.axis_paths import axis_path_exists, is_any_goal_closed_off
from ccm_opt.diagnosis.contact import contact_at_poses, contact_at_tips, touching_overlap, within_torque_limits
from ccm_opt.diagnosis.last_link import last_link_is_led_to
from ccm_opt.diagnosis.named_goals import NamedPose, named_poses
from ccm_opt.diagnosis.ranking import degrees, listed, point
from ccm_opt.diagnosis.reach import within_bend_limits, within_joint_limits, within_reach
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.planning.sampled_check import BlockedRaster
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace

_RASTER_CELLS = 200
"""Cells per link along a side of the raster of blocked positions. Heuristic: a hundredth of a link."""

_SHARES = (0.1, 0.1, 0.3)
"""Size of cells for one, two and three links: how far a point of the arm may move within half a cell.

The value is a fraction of the distance that the axis must keep from walls.

Measured with 8 unreachable whole-arm goals among 30 polygons: two links prove 5 in 5 ms, three links 2 more in 0.2 s.
"""
_MOST_CELLS = 4_000_000
"""Number of cells above which the turning check is skipped. Heuristic: one second, for joints that turn by 90°."""
_PLACES = 5
"""Number of points tested for contact along a link. Heuristic: more hardly prove more."""
_MOST_REMOVED = 4
"""Largest number of obstacles whose removal is tried one at a time, nearest to the base first. Heuristic."""
_BISECTIONS = 5
"""Number of bisections for the arm radius with which the first links could turn. Heuristic: 3 %."""
_ROUNDING = 1e-9
"""Tolerance of bends [rad] and relative tolerance of lengths. Derived: exceeds all rounding errors together."""

CellLabels: TypeAlias = np.ndarray[tuple[int, ...], np.dtype[np.int32]]


def two_links_turn(problem: Problem) -> Iterator[Finding]:
    """Yield a finding per whole-arm goal to which the first two links cannot turn, within milliseconds."""
    yield from _shut_off(problem, 2)


def three_links_turn(problem: Problem) -> Iterator[Finding]:
    """Yield a finding per whole-arm goal to which the first two or three links cannot turn from the start.

    Three links are checked only if two give no finding, since that check takes tenths of a second.
    """
    for links in (2, 3):
        found = tuple(_shut_off(problem, links))
        if found:
            yield from found
            return


def _shut_off(problem: Problem, links: int) -> Iterator[Finding]:
    # A fed base has no fixed centre of rotation, and in space the bends of three links need too many cells.
    if problem.dimension == 3 or problem.arm.base_axes or problem.arm.proportions is not None:
        return
    start, *others = named_poses(problem)
    # A goal given as a curve does not determine the bends uniquely.
    goals = [pose for pose in others if np.isfinite(pose.bend_tolerance)]
    if not goals or not np.isfinite(start.bend_tolerance) or problem.arm.links < links:
        return
    cells = FirstLinkCells(problem.arm, problem.workspace, problem.arm.radius, links)
    if not cells.useful:
        return
    for goal in goals:
        if not cells.joined(start, goal):
            yield _finding(problem, cells, start, goal)


@dataclass(frozen=True)
class FirstLinkCells:
    """Cells in the configuration space of the first links, to decide whether these links can turn between two poses.

    Attributes:
        arm: the arm.
        workspace: the workspace with its walls.
        radius: radius of the links, which may differ from the arm's [m].
        links: number of links considered, from the base.
    """

    arm: Arm
    workspace: Workspace
    radius: float
    links: int

    @property
    def reach(self) -> float:
        """Greatest distance of any point of the first links' axes from the base [m]."""
        return self.links * self.arm.link_length

    @property
    def near(self) -> Workspace:
        """The workspace reduced to the walls within reach of the first links."""
        gap = self.arm.radius + self.workspace.clearance
        return self.workspace.near(shapely.Point(self.arm.base), self.reach + gap)

    @property
    def useful(self) -> bool:
        """Whether obstacles are within reach of the first links and the number of cells is acceptable."""
        return len(self.near.obstacles) > 0 and 0 < int(np.prod(self.counts)) <= _MOST_CELLS

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of cells along the range of each bend, of length `links`."""
        share = _SHARES[self.links - 1]
        gap = self.arm.radius + self.workspace.clearance
        # The end of the last link moves by at most the sum of the rotations of all links, half a cell per joint.
        width = 2.0 * share * gap / (self.arm.link_length * np.arange(1, self.links + 1).sum())
        if width <= 0.0:
            return (0,)
        return tuple(int(np.ceil(2.0 * limit / width)) for limit in self.arm.bend_limits[: self.links])

    @property
    def widths(self) -> FloatArray:
        """Widths of a cell of configuration space along each bend, shape (links,) [rad]."""
        return np.asarray(2.0 * self.arm.bend_limits[: self.links] / np.array(self.counts))

    def joined(self, start: NamedPose, goal: NamedPose, turns: float = 0.0) -> bool:
        """Return whether a chain of open cells connects two poses within tolerances; true if a pose is in contact.

        Args:
            start: first pose.
            goal: second pose.
            turns: full turns that are added to the first bend of the goal [rad].
        """
        first = self._pose_labels(start, 0.0)
        last = self._pose_labels(goal, turns)
        return not first or not last or bool(first & last)

    def _pose_labels(self, pose: NamedPose, turns: float) -> set[int]:
        """Return the labels of the connected components in which a pose may lie; empty if all cells are closed."""
        limits = self.arm.bend_limits[: self.links]
        bends = pose.q[: self.links].copy()
        bends[0] += turns
        tolerance = pose.bend_tolerance + _ROUNDING
        low = np.floor((bends - tolerance + limits) / self.widths).astype(int)
        high = np.floor((bends + tolerance + limits) / self.widths).astype(int)
        box = tuple(slice(max(a, 0), min(b, count - 1) + 1) for a, b, count in zip(low, high, self.counts, strict=True))
        return set(np.unique(self.pieces[box]).tolist()) - {0}

    @cached_property
    def pieces(self) -> CellLabels:
        """Label of each cell's connected component, 0 for closed cells; cells are also connected through corners."""
        is_open = np.zeros(self.counts, dtype=bool)
        is_open[tuple(self._open_cells())] = True
        labels, _ = ndimage.label(is_open, structure=np.ones((3,) * self.links))
        return np.asarray(labels, dtype=np.int32)

    def _open_cells(self) -> list[IntArray]:
        """Return the cell indices of all open cells along every bend, found link by link.

        Cells that are closed for one link are closed for all links beyond.
        """
        arm = self.arm
        link, share = arm.mount_end
        numbers: list[IntArray] = []
        headings = np.array([arm.base_heading])
        joints = arm.base[None]
        for k in range(self.links):
            middles = (np.arange(self.counts[k]) + 0.5) * self.widths[k] - arm.bend_limits[k]
            turned = headings[:, None] + middles
            along = arm.link_length * np.stack((np.cos(turned), np.sin(turned)), axis=-1)
            free = np.ones(turned.shape, dtype=bool)
            if k >= link:
                raster = self._raster(k)
                least = share if k == link else 0.0
                for part in np.linspace(least, 1.0, _PLACES):
                    places = joints[:, None] + part * along
                    free &= ~raster.at(places[..., 0], places[..., 1])
            before, last = np.nonzero(free)
            numbers = [*(number[before] for number in numbers), last]
            headings = turned[before, last]
            joints = joints[before] + along[before, last]
        return numbers

    def _raster(self, link: int) -> BlockedRaster:
        """Return a raster of the positions at which a point of a link proves a whole cell closed.

        If the point is there at the cell's centre, the point is too close to a wall in every pose of the cell.

        Args:
            link: index of the link, from 0.
        """
        half_widths = 0.5 * self.widths[: link + 1]
        moved = self.arm.link_length * float(np.cumsum(half_widths).sum())
        gap = self.radius + self.workspace.clearance - moved - touching_overlap(self.arm)
        half = (1.0 + _ROUNDING) * self.reach
        cells = _RASTER_CELLS * self.links
        return BlockedRaster.around(self.near, self.arm.base, half, gap, cells)


def _finding(problem: Problem, cells: FirstLinkCells, start: NamedPose, goal: NamedPose) -> Finding:
    """Return the finding that the first links cannot turn to a goal, with changes that would remove the obstruction."""
    arm = problem.arm
    opening = _opening(cells, start, goal)
    nearest = _by_distance(cells)
    who = listed(opening or nearest[:2])
    turn = f"from {degrees(start.q[0])} to {degrees(goal.q[0])}"
    reason = (
        f"{goal.key}: the first {cells.links} links cannot turn about the base to the goal: {who} next to the base "
        f"{'stops' if len(opening or nearest[:2]) == 1 else 'stop'} them; joint 1 would have to turn {turn}"
    )
    other = _other_turn(cells, start, goal)
    if other is not None:
        reason += f"; with joint 1 at {degrees(other)}, a whole turn away, they lie the same way and are not stopped"
    bounds = {}
    radius = _opening_radius(cells, start, goal)
    if radius > 0.0:
        bounds["arm.radius"] = radius
    clearance = radius + problem.workspace.clearance - arm.radius
    if problem.workspace.clearance > 0.0 and clearance >= 0.0:
        bounds["workspace.clearance"] = clearance
    return Finding(
        "hemmed in",
        reason,
        key=goal.key,
        place=point(arm.base),
        measured=arm.radius,
        allowed=radius,
        obstacles=tuple(dict.fromkeys((*opening, *nearest))),
        bounds=bounds,
    )


def _by_distance(cells: FirstLinkCells) -> tuple[str, ...]:
    """Return the names of the obstacles within reach of the first links, the nearest to the base first."""
    base = shapely.Point(cells.arm.base)
    walls = sorted(cells.near.obstacles, key=lambda wall: shapely.distance(wall.core, base) - wall.rounding)
    return tuple(wall.name for wall in walls)


def _opening(cells: FirstLinkCells, start: NamedPose, goal: NamedPose) -> tuple[str, ...]:
    """Return the obstacles whose removal alone would let the first links turn to the goal, the nearest first."""
    names = _by_distance(cells)[:_MOST_REMOVED]

    def opened(name: str) -> bool:
        rest = cells.near.without_obstacle(name)
        return FirstLinkCells(cells.arm, rest, cells.radius, cells.links).joined(start, goal)

    return tuple(name for name in names if opened(name))


def _other_turn(cells: FirstLinkCells, start: NamedPose, goal: NamedPose) -> float | None:
    """Return the goal's first bend, a full turn more or less, if the links can turn to that bend [rad]; else None."""
    bend = float(goal.q[0])
    for turns in (2.0 * np.pi, -2.0 * np.pi):
        # A bend beyond the limit would lie in no open cell and count as joined.
        within = abs(bend + turns) <= cells.arm.base_limit
        if within and cells.joined(start, goal, turns):
            return bend + turns
    return None


def _opening_radius(cells: FirstLinkCells, start: NamedPose, goal: NamedPose) -> float:
    """Return the largest radius found with which the first links could turn to the goal [m]; 0 if none was found."""
    low = 0.0
    high = cells.radius
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        thinner = FirstLinkCells(cells.arm, cells.workspace, middle, cells.links)
        if thinner.joined(start, goal):
            low = middle
        else:
            high = middle
    return low


Check: TypeAlias = Callable[..., Iterator[Finding]]
"""Function from a problem, and for a slow check a deadline, to findings that prove that no plan exists."""
CHEAP_CHECKS: tuple[Check, ...] = (
    *(contact_at_poses, contact_at_tips, within_joint_limits, within_reach, within_bend_limits),
    *(within_torque_limits, two_links_turn),
)
"""Inexpensive necessary checks; the planner itself makes the others that it needs before its search."""
NECESSARY_CHECKS: tuple[Check, ...] = (
    *(contact_at_poses, contact_at_tips, within_joint_limits, within_reach, axis_path_exists, within_bend_limits),
    *(within_torque_limits, three_links_turn),
)
"""All checks of necessary conditions for a plan, the most elementary first."""
_TIMED = (axis_path_exists, last_link_is_led_to)
"""Checks that take a deadline."""
QUICK_CHECKS = tuple(check for check in NECESSARY_CHECKS if check is not axis_path_exists)
"""All necessary checks except the search for axis paths, which takes long to explain its result."""


def is_covered(arm: Arm) -> bool:
    """Return whether the checks hold for an arm: without tool, each joint by itself, fixed or on a feed axis."""
    return arm.drives is None and not arm.carrier and not arm.rigid_bodies and arm.tool_links is None


def failed(
    problem: Problem, checks: tuple[Check, ...] = NECESSARY_CHECKS, until: Deadline | None = None
) -> tuple[Finding, ...]:
    """Return the findings of necessary checks, in the order of the checks.

    There are none for an arm with a tool, of sections that bend evenly, or on other axes than a feed axis, which the
    proofs do not cover.

    Args:
        problem: the problem to check.
        checks: the checks to run.
        until: deadline after which no search is started; slow checks also have their own deadlines.
    """
    if not is_covered(problem.arm):
        return ()
    last = until or Deadline.never()
    return find_scaled(problem, lambda p: (each for check in checks for each in _found(check, p, last)))


def find_scaled(problem: Problem, find: Callable[[Problem], Iterable[Finding]]) -> tuple[Finding, ...]:
    """Return the findings that a function yields for a problem, with lengths in metres.

    The function gets a planar problem scaled to an arm of unit length, and its findings are scaled back.
    """
    if problem.dimension == 3:
        return tuple(find(problem))
    units = OwnUnits(problem.arm.length)
    with words_for_unit(units.metres):
        return units.findings_in_metres(tuple(find(units.scaled(problem))))


def _found(check: Check, problem: Problem, until: Deadline) -> Iterator[Finding]:
    return check(problem, until) if check in _TIMED else check(problem)


def is_goal_closed_off(problem: Problem, until: Deadline) -> bool:
    """Return whether it is proved for any goal that no path of the arm's axis is wide and short enough."""
    if not is_covered(problem.arm):
        return False
    scaled = OwnUnits(problem.arm.length).scaled(problem) if problem.dimension == 2 else problem
    return is_any_goal_closed_off(scaled, until)


def provably_infeasible(problem: Problem, until: Deadline) -> bool:
    """Return whether any necessary check proves that there is no plan; much faster than finding the cause."""
    return any(finding.proved for finding in failed(problem, QUICK_CHECKS, until)) or is_goal_closed_off(problem, until)
