"""Paths for the arm's axis to a goal: whether one is wide and short enough, and if not, what obstructs it.

The existence of a path that is wide and short enough is a necessary condition for a plan, since at the goal the arm's
axis itself is such a path. Messages and findings call it a *way*.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Finding
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.length_words import place as at
from ccm_opt.core.polyline import path_length
from ccm_opt.diagnosis.contact import contact_at_tips
from ccm_opt.diagnosis.gaps import Gaps, beside, depth_beyond
from ccm_opt.diagnosis.named_goals import NamedTipGoal
from ccm_opt.diagnosis.ranking import degrees, diameter_words, listed, point
from ccm_opt.diagnosis.reach import angle_between, most_turn, within_reach
from ccm_opt.diagnosis.sections import Part, parts_of
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm

_DETOUR = 1e-3
"""Relative excess of the shortest path over the straight line below which only the arm's reach is blamed. Heuristic."""
_NARROW = 1.5
"""Passages narrower than this number of diameters are reported as tight, though not proved too narrow. Heuristic."""
_SHORT = 1.08
"""Arms shorter than this multiple of the shortest axis path are reported as barely long enough. Heuristic."""
_STIFF = 1.25
"""Turns that admit an arc of less than this multiple of the tightest radius are reported as tight. Heuristic."""
_LEAST_TURN = 0.3490658503988659
"""Turns of an axis path below this angle are not reported [rad]. Heuristic: 20°."""
_SPANNED = 0.99
"""Ratio of two widths below which the narrower axis path is reported in addition to the wider. Heuristic."""


@dataclass(frozen=True, eq=False)
class WidestPath:
    """Bounds on the width of the widest axis path that is no longer than the arm.

    Attributes:
        most: upper bound on the distance of the path from obstacles [m]; 0 if there is no path for any width.
        exact: whether a path is known that keeps almost the distance ``most``.
        closed: whether there is no path of any useful width, however long.
        place: position of the narrowest passage, shape (d,) [m].
        walls: names of the obstacles nearest to ``place``, the nearest first.
        unbounded_excess: distance from obstacles kept by the widest path of any length, if known [m].
        path: corners of a short path among the widest known, shape (m, d) [m]; None if none was found.
    """

    most: float
    exact: bool
    closed: bool
    place: FloatArray
    walls: tuple[str, ...]
    unbounded_excess: float = 0.0
    path: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class AxisPaths(ABC):
    """Paths of an arm's axis from its base, or from all fed base positions, to the tolerance of a tip goal.

    Attributes:
        problem: the problem.
        place: the goal.
        until: deadline of the search.
        part: the part of an arm of unequal links that the problem is about; None for a whole arm of equal links.
        shortest_is_proved: whether ``shortest`` is proved to be the shortest path that is wide enough.
        fed_from: text that says where the paths of a fed arm begin.
    """

    shortest_is_proved: ClassVar[bool]
    fed_from: ClassVar[str]
    problem: Problem
    place: NamedTipGoal
    until: Deadline
    part: Part | None = field(default=None, kw_only=True)

    @property
    def who(self) -> str:
        """What has to follow the paths, in messages."""
        return "the arm" if self.part is None else self.part.section.name

    @property
    def part_words(self) -> str:
        """What is too short for the paths, in messages."""
        return "the arm" if self.part is None or not self.part.beyond else f"the arm as far as {self.who}"

    @property
    def ends_at(self) -> str:
        """Text that says where the paths end: the goal, or near it where links beyond those of a part reach it."""
        beyond = 0.0 if self.part is None else self.part.beyond
        return f"within {long_length(beyond)} of the goal, where the links beyond reach it" if beyond else "the goal"

    def keys(self, bounds: dict[str, float]) -> dict[str, float]:
        """Return bounds with the keys of sections for those of links."""
        return bounds if self.part is None else self.part.keys(bounds)

    @property
    def begin(self) -> str:
        """Text that says where the axis paths begin; empty if at the base."""
        return "" if self.problem.arm.feed is None else f" from {self.fed_from}"

    @property
    @abstractmethod
    def arm(self) -> Arm:
        """Arm that must be long enough; for a fed arm, possibly only the part beyond the hole of the guide tube."""

    @property
    @abstractmethod
    def gaps(self) -> Gaps:
        """Distances of segments from all obstacles."""

    @property
    @abstractmethod
    def required_distance(self) -> float:
        """Distance that the arm's axis must keep from all obstacles [m]."""

    @property
    @abstractmethod
    def closed(self) -> bool:
        """Whether it is proved that no axis path is wide and short enough for the arm."""

    @property
    @abstractmethod
    def closed_to_short_arms(self) -> bool:
        """Whether the arm's length may be the only reason why no axis path exists."""

    @property
    @abstractmethod
    def shortest(self) -> FloatArray | None:
        """Corners of a short axis path, wide enough but maybe too long, shape (m, d) [m]; None if none is known."""

    @property
    @abstractmethod
    def least(self) -> float:
        """Length of the shortest known axis path that is wide enough [m]; 0 if unknown.

        The path ends at the edge of the goal's tolerance. ``shortest_is_proved`` says whether none is shorter.
        """

    @abstractmethod
    def all_longer_than(self, length: float) -> bool:
        """Return whether it is proved that every wide enough axis path is longer than a length [m]."""

    @abstractmethod
    def widest(self, most: float) -> WidestPath:
        """Return the axis path farthest from obstacles; distances beyond `most` [m] count as equal."""

    @abstractmethod
    def bound(self, known: float) -> float:
        """Return an upper bound on the distance from obstacles that any axis path keeps [m].

        The bound is at most ``required_distance``.

        Args:
            known: distance from obstacles that the widest known axis path keeps [m].
        """

    @abstractmethod
    def opening(self, place: FloatArray, *, closed: bool) -> tuple[str, ...]:
        """Return the obstacles whose removal alone opens an axis path, the most relevant first.

        Args:
            place: position where the path is closed or has to turn, shape (d,) [m].
            closed: whether there is no path of any useful width, so that other positions may be equally relevant.
        """

    def blocking_place(self, name: str, place: FloatArray) -> FloatArray:
        """Return a position in an obstacle that closes all axis paths, at which a path could lead through, (d,) [m].

        Args:
            name: name of the obstacle.
            place: position near the obstacle, returned if no better one is known, shape (d,) [m].
        """
        del name
        return place

    @abstractmethod
    def length_remedies(self) -> dict[str, float]:
        """Return, by key in the problem file, the values with which a too short arm would be long enough [SI units]."""


def axis_paths(problem: Problem, until: Deadline) -> Iterator[AxisPaths]:
    """Yield, per tip goal of a problem, the paths of the arm's axis to that goal, searchable until a deadline.

    For an arm of unequal links there are those of each part of it that thinner links follow, and those of the whole.
    """
    if problem.arm.proportions is not None:
        for part in parts_of(problem.arm):
            yield from (replace(paths, part=part) for paths in axis_paths(part.problem(problem), until))
        return
    # Imported on demand: only one of the two is ever needed, and most problems need neither.
    if problem.dimension == 2:
        from ccm_opt.diagnosis.planar_axis_paths import planar_axis_paths  # noqa: PLC0415

        yield from planar_axis_paths(problem, until)
    else:
        from ccm_opt.diagnosis.space_axis_paths import space_axis_paths  # noqa: PLC0415

        yield from space_axis_paths(problem, until)


def axis_path_exists(problem: Problem, until: Deadline) -> Iterator[Finding]:
    """Yield a finding per tip goal to which no axis path is wide and short enough for the arm."""
    for paths in _closed_off_goals(problem, until):
        yield _too_long(paths) if paths.shortest is not None and paths.least > paths.arm.length else _too_thick(paths)


def is_any_goal_closed_off(problem: Problem, until: Deadline) -> bool:
    """Return whether any tip goal has no axis path that is wide and short enough, without finding the cause."""
    return next(_closed_off_goals(problem, until), None) is not None


def _closed_off_goals(problem: Problem, until: Deadline) -> Iterator[AxisPaths]:
    # Goals where the tip is in contact or out of reach are reported by other checks.
    touched = {finding.key for finding in contact_at_tips(problem)}
    far = {finding.key for finding in within_reach(problem)}
    for paths in axis_paths(problem, until):
        key = paths.place.key
        if key in touched or not paths.closed:
            continue
        if key not in far or not paths.closed_to_short_arms or _is_detour(paths):
            touched.add(key)  # of an arm of unequal links the thickest part says most
            yield paths


def _is_detour(paths: AxisPaths) -> bool:
    """Return whether it is proved that the shortest axis path is notably longer than the straight line."""
    straight = float(np.linalg.norm(paths.place.goal.position - paths.arm.base)) - paths.place.tolerances.position
    return paths.shortest_is_proved and paths.least > (1.0 + _DETOUR) * straight


def path_corners(path: FloatArray | None) -> tuple[tuple[float, ...], ...]:
    """Convert the corners of an axis path to tuples of coordinates, as findings store them; empty for None."""
    return () if path is None else tuple(point(place) for place in path)


def _too_long(paths: AxisPaths) -> Finding:
    """Return the finding that all wide enough axis paths are longer than the arm, or than its part beyond the hole."""
    arm = paths.arm
    path = paths.shortest
    assert path is not None  # noqa: S101 - said by who asks
    corner = _farthest_off(path)
    turns = simplify_polyline(path, paths.required_distance)[1:-1]
    walls = tuple(dict.fromkeys(name for turn in turns for name in beside(paths.gaps, turn, 0.0)[:1]))
    round_what = f" round {listed(walls)}" if walls else ""
    lacking = f"{long_length(paths.least - arm.length)} too short; the shortest way"
    if not paths.shortest_is_proved:
        lacking = (
            f"too short: every way that is wide enough is longer than its {long_length(arm.length)}; the shortest found"
        )
    only = "the arm is only" if arm.length == paths.problem.arm.length else "beyond the hole the arm reaches only"
    only = only if paths.part is None else f"as far as {paths.who} the arm is only"
    return Finding(
        "too short",
        f"{paths.place.key}: {paths.part_words} is {lacking}{paths.begin} to {paths.ends_at}{round_what} is "
        f"{long_length(paths.least)} "
        f"long; {only} {long_length(arm.length)}{' long' * only.endswith('is only')}",
        key=paths.place.key,
        place=point(corner),
        measured=paths.least,
        allowed=arm.length,
        obstacles=tuple(dict.fromkeys((*paths.opening(corner, closed=False), *walls))),
        way=path_corners(path),
        bounds=paths.keys(paths.length_remedies()),
    )


def _farthest_off(path: FloatArray) -> FloatArray:
    """Return the corner of a polyline that is farthest from the straight line between its ends, shape (d,) [m]."""
    along = path[-1] - path[0]
    along = along / max(float(np.linalg.norm(along)), 1e-300)
    off = path - path[0]
    aside = np.linalg.norm(off - np.outer(off @ along, along), axis=1)
    return np.asarray(path[int(np.argmax(aside))])


def _too_thick(paths: AxisPaths) -> Finding:
    """Return the finding that no axis path is wide enough, with the widest path if there is any."""
    widest = paths.widest(paths.required_distance)
    opened = paths.opening(widest.place, closed=widest.closed)
    arm = paths.problem.arm
    clearance = paths.problem.workspace.clearance
    bounds: dict[str, float] = {}
    if widest.closed:
        who = opened[:3] or widest.walls
        if opened:
            widest = replace(widest, place=paths.blocking_place(opened[0], widest.place))
        thin = (
            f"even for an arm of {short_length(2.0 * widest.most)} in diameter"
            if widest.most > 0.0
            else "however thin the arm"
        )
        verb = "close" if not opened and len(who) > 1 else "closes"
        reason = (
            f"no way leads to the goal, {thin}; {'any of ' * (len(opened) > 1)}{listed(who)} {verb} it off at "
            f"{at(widest.place)}"
        )
        gap = 0.0
    else:
        gap = 2.0 * max(widest.most, widest.unbounded_excess)
        known = short_length(gap) if widest.exact else f"{short_length(gap)} at most"
        reason = (
            f"{paths.who} is too thick for every way to {paths.ends_at}; the widest leads through a gap of "
            f"{known} "
            f"{between(widest.walls)} at {at(widest.place)}; {paths.who} has {diameter_words(paths.problem)}"
        )
        if 0.0 < 2.0 * widest.most < _SPANNED * gap:
            within = short_length(2.0 * widest.most)
            reason += f"; of the ways that are no longer than the arm, the widest leads through a gap of {within}"
        if widest.most > clearance:
            bounds["arm.radius"] = widest.most - clearance
        if widest.most > arm.radius and clearance > 0.0:
            bounds["workspace.clearance"] = widest.most - arm.radius
    return Finding(
        "blocked" if widest.closed else "too thick",
        f"{paths.place.key}: {reason}",
        key=paths.place.key,
        place=point(widest.place),
        measured=gap,
        allowed=2.0 * (arm.radius + clearance),
        obstacles=tuple(dict.fromkeys((*opened, *widest.walls))),
        way=path_corners(widest.path),
        bounds=paths.keys(bounds),
    )


def between(walls: tuple[str, ...]) -> str:
    """Return text for the location of a passage: between several obstacles, or in the hole of a single one."""
    return f"between {listed(walls)}" if len(walls) > 1 else f"in {listed(walls)}"


def tight_passages(problem: Problem, until: Deadline) -> tuple[Finding, ...]:
    """Return likely but unproved obstructions on axis paths, the tightest first."""
    found: list[Finding] = []
    for paths in axis_paths(problem, until):
        found += _narrow(paths)
        found += _short(paths)
        # Bends are those of equal links.
        found += _stiff(paths) if paths.part is None else ()
    return tuple(sorted(found, key=lambda finding: (finding.measured or 0.0) / max(finding.allowed or 0.0, 1e-300)))


def _narrow(paths: AxisPaths) -> Iterator[Finding]:
    """Yield a finding if the widest axis path is hardly wider than the arm's diameter plus clearance."""
    if paths.required_distance <= 0.0:
        return
    widest = paths.widest(_NARROW * paths.required_distance)
    most = max(widest.most, widest.unbounded_excess)
    if not 0.0 < most < _NARROW * paths.required_distance:
        return
    gap = 2.0 * most
    need = 2.0 * paths.required_distance
    yield Finding(
        "too thick",
        f"{paths.who} has little clearance: no way to the goal within its length is wider than {short_length(gap)}, "
        f"narrowest {between(widest.walls)} at {at(widest.place)}, and the arm takes {short_length(need)}",
        proved=False,
        place=point(widest.place),
        measured=gap,
        allowed=need,
        obstacles=widest.walls,
        way=path_corners(widest.path),
        bounds=paths.keys({"arm.radius": paths.problem.arm.radius}),
    )


def _short(paths: AxisPaths) -> Iterator[Finding]:
    """Yield a finding if the arm is proved to be hardly longer than every wide enough axis path.

    The length of a path that was merely found is no evidence, since a shorter path may exist.
    """
    length = paths.arm.length / _SHORT
    if paths.all_longer_than(length):
        yield Finding(
            "too short",
            f"the arm has little length to spare: every way to the goal that is wide enough is longer than "
            f"{long_length(length)}, and the arm is {long_length(paths.arm.length)} long",
            proved=False,
            measured=paths.arm.length,
            allowed=length,
            bounds=paths.keys({"arm.link_length": paths.problem.arm.link_length}),
        )


def _stiff(paths: AxisPaths) -> Iterator[Finding]:
    """Yield a finding for each turn of a short axis path that the arm, at its tightest bend, can hardly follow.

    A turn by α around an inner corner with clearance h on the outside admits an arc of radius h cos(α/2) / (1 −
    cos(α/2)). Links of length l that turn by β form an arc of radius l / (2 tan(β/2)).
    """
    arm = paths.problem.arm
    path = paths.shortest
    # In space the path found may be longer than the arm and lead round another side than one that the arm can follow.
    if path is None or (path_length(path) > paths.arm.length and not paths.shortest_is_proved):
        return
    # Angles near half a turn are capped, since tangent and cosine degenerate there.
    tightest = 0.5 * arm.link_length / np.tan(0.5 * min(most_turn(arm, arm.joint_limit), 0.99 * np.pi))
    corners = simplify_polyline(path, paths.required_distance)
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        turn = angle_between(corner - before, after - corner)
        if turn < _LEAST_TURN:
            continue
        outwards = (corner - before) / np.linalg.norm(corner - before) - (after - corner) / np.linalg.norm(
            after - corner
        )
        outwards /= np.linalg.norm(outwards)
        half = np.cos(0.5 * min(turn, 0.95 * np.pi))
        radius = depth_beyond(paths.gaps, corner, outwards, paths.required_distance, arm.length) * half / (1.0 - half)
        if radius <= _STIFF * tightest:
            walls = beside(paths.gaps, corner, 0.0)[:1]
            compared = "less than" if radius < tightest else "hardly more than"
            yield Finding(
                "too stiff",
                f"a short way to the goal turns by {degrees(turn)} round {listed(walls)} at {at(corner)}, where an arc "
                f"of radius {short_length(radius)} fits, {compared} the {short_length(float(tightest))} of the arm "
                f"with every joint at its limit of {degrees(arm.joint_limit)}",
                proved=False,
                place=point(corner),
                measured=float(radius),
                allowed=float(tightest),
                obstacles=walls,
                bounds={"arm.joint_limit_deg": arm.joint_limit},
            )


def simplify_polyline(path: FloatArray, tolerance: float) -> FloatArray:
    """Return a polyline without the corners that lie near the straight lines between the others, shape (k, d) [m].

    A path shortened around an obstacle has many corners with small turns, which are merged into one. Source: D. Douglas
    and T. Peucker, Algorithms for the reduction of the number of points required to represent a digitized line, 1973.

    Args:
        path: corners of the polyline, shape (m, d) [m].
        tolerance: largest distance of removed corners from the straight lines [m].
    """
    if len(path) < 3:
        return path
    along = path[-1] - path[0]
    share = np.clip((path - path[0]) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    off = np.linalg.norm(path - path[0] - share[:, None] * along, axis=1)
    farthest = int(np.argmax(off))
    if off[farthest] <= tolerance:
        return path[[0, -1]]
    first = simplify_polyline(path[: farthest + 1], tolerance)
    return np.concatenate((first[:-1], simplify_polyline(path[farthest:], tolerance)))
