"""Necessary checks of a problem, in their order.

Near the base an arm has few joints, so that all poses of its first links can be looked at: their bends are divided into
cells, and a cell is closed when a point of a link is too near to a wall in every pose of it. When no chain of open
cells joins the start to the goal, no motion of the first links does, and so none of the arm. Links of the arm that meet
each other are not looked at, nor is what lies between the cells' middles and their corners taken for closed, so the
proof errs on the safe side alone.
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
from ccm_opt.diagnosis.contact import contact_at_poses, contact_at_tips, strong_enough, touching_overlap
from ccm_opt.diagnosis.keyed_poses import WholePose, whole_poses
from ccm_opt.diagnosis.ranking import degrees, listed, point
from ccm_opt.diagnosis.reach import supple_enough, within_joint_limits, within_reach
from ccm_opt.diagnosis.ways import any_way_closed, wide_and_short_enough
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.planning.sampled_check import BlockedRaster
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.workspace import Workspace

_RASTER_CELLS = 200
"""Of the raster of blocked places, along a side, for every link. Taste: a hundredth of a link."""

_SHARES = (0.1, 0.1, 0.3)
"""For one link, two, three: how far a point may move within half a cell, as a share of the distance that an axis keeps
from walls. Measured: of 8 goals for the whole arm among 30 polygons that nobody reaches two links prove 5 in 5 ms,
three 2 more in 0.2 s."""
_MOST_CELLS = 4_000_000
"""Where there are more, nothing is proved. Taste: a second, for joints that turn by 90°."""
_PLACES = 5
"""Along a link that are looked up. Taste: more prove hardly more."""
_MOST_REMOVED = 4
"""Obstacles that are taken away one at a time, nearest to the base first. Taste."""
_BISECTIONS = 5
"""Of the radius that would do. Taste: 3 %."""
_ROUNDING = 1e-9
"""Of bends and lengths, relative [rad]. Derived: more than all rounding together."""

CellLabels: TypeAlias = np.ndarray[tuple[int, ...], np.dtype[np.int32]]


def two_links_turn(problem: Problem) -> Iterator[Finding]:
    """Yield the goals of the whole arm that the first two links cannot turn to from the start; some milliseconds."""
    yield from _shut_off(problem, 2)


def three_links_turn(problem: Problem) -> Iterator[Finding]:
    """Yield the same of the first two links, or else of the first three; some tenths of a second."""
    for links in (2, 3):
        found = tuple(_shut_off(problem, links))
        if found:
            yield from found
            return


def _shut_off(problem: Problem, links: int) -> Iterator[Finding]:
    # A base that is fed turns about no place, and in space bends of three links have too many cells.
    if problem.dimension == 3 or problem.arm.base_axes:
        return
    start, *others = whole_poses(problem)
    # A goal that is a curve may be laid on the joints in other ways than one.
    goals = [pose for pose in others if np.isfinite(pose.bend_play)]
    if not goals or not np.isfinite(start.bend_play) or problem.arm.links < links:
        return
    cells = FirstLinkCells(problem.arm, problem.workspace, problem.arm.radius, links)
    if not cells.useful:
        return
    for goal in goals:
        if not cells.joined(start, goal):
            yield _finding(problem, cells, start, goal)


@dataclass(frozen=True)
class FirstLinkCells:
    """Cells of the bends of the first links.

    Attributes:
        arm: the arm.
        workspace: its walls.
        radius: of the links, perhaps another than the arm's [m].
        links: how many, from the base on.
    """

    arm: Arm
    workspace: Workspace
    radius: float
    links: int

    @property
    def reach(self) -> float:
        """Farthest place of the first links' axes from the base [m]."""
        return self.links * self.arm.link_length

    @property
    def near(self) -> Workspace:
        """The walls that the first links can come near to."""
        gap = self.arm.radius + self.workspace.clearance
        return self.workspace.near(shapely.Point(self.arm.base), self.reach + gap)

    @property
    def useful(self) -> bool:
        """Whether there is something to run into, and the cells are not too many."""
        return len(self.near.obstacles) > 0 and 0 < int(np.prod(self.counts)) <= _MOST_CELLS

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """How many cells each bend's range has."""
        share = _SHARES[self.links - 1]
        gap = self.arm.radius + self.workspace.clearance
        # The end of the last link moves by at most the sum of all turns of the links, half a cell a joint.
        width = 2.0 * share * gap / (self.arm.link_length * np.arange(1, self.links + 1).sum())
        if width <= 0.0:
            return (0,)
        return tuple(int(np.ceil(2.0 * limit / width)) for limit in self.arm.bend_limits[: self.links])

    @property
    def widths(self) -> FloatArray:
        """Widths of a cell, shape (links,) [rad]."""
        return np.asarray(2.0 * self.arm.bend_limits[: self.links] / np.array(self.counts))

    def joined(self, start: WholePose, goal: WholePose, turns: float = 0.0) -> bool:
        """Return whether a chain of open cells joins two poses within what they may be missed by.

        True where one is closed.

        Args:
            start: one pose.
            goal: the other.
            turns: whole turns that are added to the first bend of the goal [rad].
        """
        first = self._pose_labels(start, 0.0)
        last = self._pose_labels(goal, turns)
        return not first or not last or bool(first & last)

    def _pose_labels(self, pose: WholePose, turns: float) -> set[int]:
        """Return numbers of the pieces of open cells in which a pose may lie; none where it lies in closed cells."""
        limits = self.arm.bend_limits[: self.links]
        bends = pose.q[: self.links].copy()
        bends[0] += turns
        play = pose.bend_play + _ROUNDING
        low = np.floor((bends - play + limits) / self.widths).astype(int)
        high = np.floor((bends + play + limits) / self.widths).astype(int)
        box = tuple(slice(max(a, 0), min(b, count - 1) + 1) for a, b, count in zip(low, high, self.counts, strict=True))
        return set(np.unique(self.pieces[box]).tolist()) - {0}

    @cached_property
    def pieces(self) -> CellLabels:
        """The number of the piece that each cell belongs to, 0 for closed ones; cells that share a corner hang on."""
        is_open = np.zeros(self.counts, dtype=bool)
        is_open[tuple(self._open_cells())] = True
        labels, _ = ndimage.label(is_open, structure=np.ones((3,) * self.links))
        return np.asarray(labels, dtype=np.int32)

    def _open_cells(self) -> list[IntArray]:
        """Numbers of the open cells along every bend, link after link: what closes a link closes all beyond it."""
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
        """Return the places at which a link is too near to a wall in every pose of a cell that has its middle there."""
        half_widths = 0.5 * self.widths[: link + 1]
        moved = self.arm.link_length * float(np.cumsum(half_widths).sum())
        gap = self.radius + self.workspace.clearance - moved - touching_overlap(self.arm)
        half = (1.0 + _ROUNDING) * self.reach
        cells = _RASTER_CELLS * self.links
        return BlockedRaster.around(self.near, self.arm.base, half, gap, cells)


def _finding(problem: Problem, cells: FirstLinkCells, start: WholePose, goal: WholePose) -> Finding:
    """Return what shuts the first links off from a goal, and what would open the way."""
    arm = problem.arm
    opening = _opening(cells, start, goal)
    nearest = _by_distance(cells)
    who = listed(opening or nearest[:2])
    turn = f"from {degrees(start.q[0])} to {degrees(goal.q[0])}"
    reason = (
        f"{goal.key}: the first {cells.links} links cannot turn about the base to the goal: {who} beside the base "
        f"{'stops' if len(opening or nearest[:2]) == 1 else 'stop'} them, whose joint 1 would have to turn {turn}"
    )
    other = _other_turn(cells, start, goal)
    if other is not None:
        reason += f"; with joint 1 at {degrees(other)}, a whole turn on, they lie the same way and are not stopped"
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
    """Return the names of the obstacles near the first links, the nearest to the base first."""
    base = shapely.Point(cells.arm.base)
    walls = sorted(cells.near.obstacles, key=lambda wall: shapely.distance(wall.core, base) - wall.rounding)
    return tuple(wall.name for wall in walls)


def _opening(cells: FirstLinkCells, start: WholePose, goal: WholePose) -> tuple[str, ...]:
    """Return the obstacles near the base each of which alone shuts the way, the nearest first."""
    names = _by_distance(cells)[:_MOST_REMOVED]

    def opened(name: str) -> bool:
        rest = cells.near.without(name)
        return FirstLinkCells(cells.arm, rest, cells.radius, cells.links).joined(start, goal)

    return tuple(name for name in names if opened(name))


def _other_turn(cells: FirstLinkCells, start: WholePose, goal: WholePose) -> float | None:
    """Return the first bend of the goal a whole turn on or back that is not shut off [rad].

    None where there is none.
    """
    bend = float(goal.q[0])
    for turns in (2.0 * np.pi, -2.0 * np.pi):
        # A bend in no open cell would count as joined.
        within = abs(bend + turns) <= cells.arm.base_limit
        if within and cells.joined(start, goal, turns):
            return bend + turns
    return None


def _opening_radius(cells: FirstLinkCells, start: WholePose, goal: WholePose) -> float:
    """Return the largest radius, to some accuracy, of which the cells prove nothing [m]."""
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
"""What stands in the way, of a problem; of those that take long looked for until a deadline."""
AT_ONCE: tuple[Check, ...] = (
    *(contact_at_poses, contact_at_tips, within_joint_limits, within_reach, supple_enough),
    *(strong_enough, two_links_turn),
)
"""Checks that cost next to nothing; the planner makes those of the others itself before it searches."""
NECESSARY: tuple[Check, ...] = (
    *(contact_at_poses, contact_at_tips, within_joint_limits, within_reach, wide_and_short_enough, supple_enough),
    *(strong_enough, three_links_turn),
)
"""All necessary checks, the most elementary first."""
BUT_WAYS = tuple(check for check in NECESSARY if check is not wide_and_short_enough)
"""All but the one that takes long to say what it has found."""


def failed(
    problem: Problem, checks: tuple[Check, ...] = NECESSARY, until: Deadline | None = None
) -> tuple[Finding, ...]:
    """Return what some checks find, in their order.

    Args:
        problem: what was asked.
        checks: which ones.
        until: when nothing more is looked at; each check has an end of its own, too.
    """
    last = until or Deadline.never()
    return find_scaled(problem, lambda p: (each for check in checks for each in _found(check, p, last)))


def find_scaled(problem: Problem, find: Callable[[Problem], Iterable[Finding]]) -> tuple[Finding, ...]:
    """Return what is found of a problem, in the plane in units of its arm as planning has them; told in metres."""
    if problem.dimension == 3:
        return tuple(find(problem))
    units = OwnUnits(problem.arm.length)
    with words_for_unit(units.metres):
        return units.findings_in_metres(tuple(find(units.scaled(problem))))


def _found(check: Check, problem: Problem, until: Deadline) -> Iterator[Finding]:
    return check(problem, until) if check is wide_and_short_enough else check(problem)


def no_way(problem: Problem, until: Deadline) -> bool:
    """Return whether it is proved that no way to some goal is wide and short enough."""
    scaled = OwnUnits(problem.arm.length).scaled(problem) if problem.dimension == 2 else problem
    return any_way_closed(scaled, until)


def hopeless(problem: Problem, until: Deadline) -> bool:
    """Return whether any necessary check proves that there is no plan, which takes far less than to say why."""
    return any(finding.proved for finding in failed(problem, BUT_WAYS, until)) or no_way(problem, until)
