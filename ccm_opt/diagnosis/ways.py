"""Whether there is a way to the goal that is wide enough and short enough; if not, what is in the way."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Finding
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.length_words import place as at
from ccm_opt.core.polyline import leg_lengths
from ccm_opt.diagnosis.contact import contact_at_tips
from ccm_opt.diagnosis.gaps import Gaps, beside, depth_beyond
from ccm_opt.diagnosis.keyed_poses import TipPlace
from ccm_opt.diagnosis.ranking import degrees, diameter_words, listed, point
from ccm_opt.diagnosis.reach import angle_between, most_turn, within_reach
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm

_DETOUR = 1e-3
"""A way longer than the straight line by less than this share of it is a matter of reach alone. Taste."""
_NARROW = 1.5
"""A gap narrower than this many diameters is told as tight, though it is not proved too narrow. Taste."""
_SHORT = 1.08
"""An arm shorter than this multiple of the route is told likewise. Taste."""
_STIFF = 1.25
"""A turn with less room than this multiple of what the tightest bend needs is told likewise. Taste."""
_LEAST_TURN = 0.3490658503988659
"""Turns of a route below this are not told [rad]. Taste: 20°."""
_SPANNED = 0.99
"""A way so much narrower than another is told beside it. Taste."""


@dataclass(frozen=True, eq=False)
class WidestWay:
    """The widest way that is no longer than the arm, as far as it is known.

    Attributes:
        most: no such way keeps more distance from everything [m]; 0 where there is none for an arm of any width.
        exact: whether one is known that keeps hardly less.
        closed: whether there is none that deserves the name, however long.
        place: where it is narrowest, shape (d,) [m].
        walls: names of the obstacles that are nearest there, the nearest first.
        of_any_length: what the widest way keeps that may be longer than the arm, where that is known [m].
        way: corners of a short one of those that keep as much as is known, shape (m, d) [m]; None where none was found.
    """

    most: float
    exact: bool
    closed: bool
    place: FloatArray
    walls: tuple[str, ...]
    unbounded_excess: float = 0.0
    way: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Ways(ABC):
    """Ways of an arm's axis from its base, or where it is fed to, to the tolerance of a goal of the tip.

    Attributes:
        problem: what was asked.
        place: the goal.
        until: when nothing more is looked at.
        shortest_is_proved: whether no way that is wide enough is shorter than the shortest.
        fed_from: where ways of a fed arm begin.
    """

    shortest_is_proved: ClassVar[bool]
    fed_from: ClassVar[str]
    problem: Problem
    place: TipPlace
    until: Deadline

    @property
    def begin(self) -> str:
        """Where ways begin, in words, where that is not the base."""
        return "" if self.problem.arm.feed is None else f" from {self.fed_from}"

    @property
    @abstractmethod
    def arm(self) -> Arm:
        """The arm that has to be long enough; of one on a feed axis perhaps what reaches beyond its hole."""

    @property
    @abstractmethod
    def gaps(self) -> Gaps:
        """Distances from everything."""

    @property
    @abstractmethod
    def room(self) -> float:
        """Distance that the axis needs from everything [m]."""

    @property
    @abstractmethod
    def closed(self) -> bool:
        """Whether it is proved that no way is wide and short enough."""

    @property
    @abstractmethod
    def closed_to_short_arms(self) -> bool:
        """Whether that may be due to the arm's length alone."""

    @property
    @abstractmethod
    def shortest(self) -> FloatArray | None:
        """Corners of a short way that is wide enough, perhaps too long, shape (m, d) [m]; None where none is known."""

    @property
    @abstractmethod
    def least(self) -> float:
        """Length of that way, to the edge of the goal's tolerance [m]."""

    @abstractmethod
    def widest(self, most: float) -> WidestWay:
        """Return the widest way that keeps at most so much distance [m]."""

    @abstractmethod
    def bound(self, known: float) -> float:
        """Return the distance that no way keeps more than, at most the room, where some way keeps a known one [m]."""

    @abstractmethod
    def opening(self, place: FloatArray, *, closed: bool) -> tuple[str, ...]:
        """Return the obstacles without any one of which there is a way, those most to the point first.

        Args:
            place: where the way is closed, or has to turn, shape (d,) [m].
            closed: whether there is none that deserves the name, so that other places may be as much to the point.
        """

    def blocking_place(self, name: str, place: FloatArray) -> FloatArray:
        """Return where ways lead through an obstacle that closes them, (d,) [m].

        A place beside it where that is unknown.
        """
        del name
        return place

    @abstractmethod
    def length_remedies(self) -> dict[str, float]:
        """Return what would do, by keys, where all ways are too long [SI]."""


def tip_ways(problem: Problem, until: Deadline) -> Iterator[Ways]:
    """Yield the ways to every goal of the tip, those looked at no longer than until a deadline."""
    # One of the two is needed at a time, and most problems need neither.
    if problem.dimension == 2:
        from ccm_opt.diagnosis.passages import passages  # noqa: PLC0415

        yield from passages(problem, until)
    else:
        from ccm_opt.diagnosis.axis_ways import axis_ways  # noqa: PLC0415

        yield from axis_ways(problem, until)


def wide_and_short_enough(problem: Problem, until: Deadline) -> Iterator[Finding]:
    """Yield the goals of the tip without a way that is wide and short enough."""
    for ways in _closed_ways(problem, until):
        yield _too_long(ways) if ways.shortest is not None and ways.least > ways.arm.length else _too_thick(ways)


def any_way_closed(problem: Problem, until: Deadline) -> bool:
    """Return whether to some goal of the tip there is no such way, which takes far less than to say what closes it."""
    return next(_closed_ways(problem, until), None) is not None


def _closed_ways(problem: Problem, until: Deadline) -> Iterator[Ways]:
    # Where the tip cannot be at all, or is out of reach, that is what is said.
    touched = {finding.key for finding in contact_at_tips(problem)}
    far = {finding.key for finding in within_reach(problem)}
    for ways in tip_ways(problem, until):
        key = ways.place.key
        if key in touched or not ways.closed:
            continue
        if key not in far or not ways.closed_to_short_arms or _is_detour(ways):
            yield ways


def _is_detour(ways: Ways) -> bool:
    """Return whether the shortest way is known and longer than the straight one, which is a matter of reach."""
    straight = float(np.linalg.norm(ways.place.goal.position - ways.arm.base)) - ways.place.tolerances.position
    return ways.shortest_is_proved and ways.least > (1.0 + _DETOUR) * straight


def way_length(way: FloatArray) -> float:
    """Return the length of a way [m]."""
    return float(leg_lengths(way).sum())


def way_corners(way: FloatArray | None) -> tuple[tuple[float, ...], ...]:
    """Return a way as a finding keeps it."""
    return () if way is None else tuple(point(place) for place in way)


def _too_long(ways: Ways) -> Finding:
    """Return all ways that are wide enough are longer than the arm, or than what it has beyond its hole."""
    arm = ways.arm
    way = ways.shortest
    assert way is not None  # noqa: S101 - said by who asks
    corner = _farthest_off(way)
    turns = simplified(way, ways.room)[1:-1]
    walls = tuple(dict.fromkeys(name for turn in turns for name in beside(ways.gaps, turn, 0.0)[:1]))
    round_what = f" round {listed(walls)}" if walls else ""
    lacking = f"{long_length(ways.least - arm.length)} too short; the shortest way"
    if not ways.shortest_is_proved:
        lacking = "too short: no way that is wide enough is as short as it; the shortest that was found"
    only = "the arm is only" if arm.length == ways.problem.arm.length else "beyond the hole the arm reaches only"
    return Finding(
        "too short",
        f"{ways.place.key}: the arm is {lacking}{ways.begin} to the goal{round_what} is {long_length(ways.least)} "
        f"long; {only} {long_length(arm.length)}{' long' * only.endswith('is only')}",
        key=ways.place.key,
        place=point(corner),
        measured=ways.least,
        allowed=arm.length,
        obstacles=tuple(dict.fromkeys((*ways.opening(corner, closed=False), *walls))),
        way=way_corners(way),
        bounds=ways.length_remedies(),
    )


def _farthest_off(way: FloatArray) -> FloatArray:
    """Return the corner of a way that is farthest from the straight line between its ends, shape (d,) [m]."""
    along = way[-1] - way[0]
    along = along / max(float(np.linalg.norm(along)), 1e-300)
    off = way - way[0]
    aside = np.linalg.norm(off - np.outer(off @ along, along), axis=1)
    return np.asarray(way[int(np.argmax(aside))])


def _too_thick(ways: Ways) -> Finding:
    """Return no way is wide enough: the widest there is, or none for an arm of any width."""
    widest = ways.widest(ways.room)
    opened = ways.opening(widest.place, closed=widest.closed)
    arm = ways.problem.arm
    clearance = ways.problem.workspace.clearance
    bounds = {}
    if widest.closed:
        who = opened[:3] or widest.walls
        if opened:
            widest = replace(widest, place=ways.blocking_place(opened[0], widest.place))
        thin = f"{short_length(2.0 * widest.most)} in diameter" if widest.most > 0.0 else "any width"
        verb = "close" if not opened and len(who) > 1 else "closes"
        reason = (
            f"no way leads to the goal, not for an arm of {thin}; {'any of ' * (len(opened) > 1)}{listed(who)} "
            f"{verb} it off at {at(widest.place)}"
        )
        gap = 0.0
    else:
        gap = 2.0 * max(widest.most, widest.unbounded_excess)
        known = short_length(gap) if widest.exact else f"{short_length(gap)} at most"
        reason = (
            f"the arm is too thick: every way to the goal is closed to it; the widest leads through a gap of {known} "
            f"{between(widest.walls)} at {at(widest.place)}; the arm has {diameter_words(ways.problem)}"
        )
        if 0.0 < 2.0 * widest.most < _SPANNED * gap:
            within = short_length(2.0 * widest.most)
            reason += f"; of the ways that are no longer than the arm the widest leads through {within}"
        if widest.most > clearance:
            bounds["arm.radius"] = widest.most - clearance
        if widest.most > arm.radius and clearance > 0.0:
            bounds["workspace.clearance"] = widest.most - arm.radius
    return Finding(
        "blocked" if widest.closed else "too thick",
        f"{ways.place.key}: {reason}",
        key=ways.place.key,
        place=point(widest.place),
        measured=gap,
        allowed=2.0 * (arm.radius + clearance),
        obstacles=tuple(dict.fromkeys((*opened, *widest.walls))),
        way=way_corners(widest.way),
        bounds=bounds,
    )


def between(walls: tuple[str, ...]) -> str:
    """Return where a gap is: between several obstacles, or in one that has a hole."""
    return f"between {listed(walls)}" if len(walls) > 1 else f"in {listed(walls)}"


def tight_ways(problem: Problem, until: Deadline) -> tuple[Finding, ...]:
    """Return what is likely to stand in the way though it is not proved to, the tightest first."""
    found: list[Finding] = []
    for ways in tip_ways(problem, until):
        found += _narrow(ways)
        way = ways.shortest
        if way is not None:
            found += _short(ways, way)
            found += _stiff(ways, way)
    return tuple(sorted(found, key=lambda finding: (finding.measured or 0.0) / max(finding.allowed or 0.0, 1e-300)))


def _narrow(ways: Ways) -> Iterator[Finding]:
    """Yield the narrowest place of the widest way against the diameter."""
    if ways.room <= 0.0:
        return
    widest = ways.widest(_NARROW * ways.room)
    if not 0.0 < widest.most < _NARROW * ways.room:
        return
    gap = 2.0 * widest.most
    need = 2.0 * ways.room
    yield Finding(
        "too thick",
        f"the widest way leads through a gap of {short_length(gap)} at most, {between(widest.walls)} at "
        f"{at(widest.place)}, hardly wider than the arm's diameter with its clearance, {short_length(need)}",
        proved=False,
        place=point(widest.place),
        measured=gap,
        allowed=need,
        obstacles=widest.walls,
        way=way_corners(widest.way),
        bounds={"arm.radius": ways.problem.arm.radius},
    )


def _short(ways: Ways, way: FloatArray) -> Iterator[Finding]:
    """Yield the length of the shortest way that was found against the arm's."""
    length = way_length(way)
    if ways.arm.length <= _SHORT * length:
        yield Finding(
            "too short",
            f"the shortest way that was found is {long_length(length)} long, the arm of "
            f"{long_length(ways.arm.length)} has little to spare",
            proved=False,
            measured=ways.arm.length,
            allowed=length,
            bounds={"arm.link_length": ways.problem.arm.link_length},
        )


def _stiff(ways: Ways, way: FloatArray) -> Iterator[Finding]:
    """Yield the sharpest turns of that way against the tightest bend of the arm, given the room that there is.

    A turn by α round an inner corner from which the arm may be moved outwards by h leaves room for an arc of radius
    h cos(α/2) / (1 − cos(α/2)); links of length l turn by β to a radius l / (2 tan(β/2)).
    """
    arm = ways.problem.arm
    # Limits near half a turn are cut off, where tangent and cosine run away.
    tightest = 0.5 * arm.link_length / np.tan(0.5 * min(most_turn(arm, arm.joint_limit), 0.99 * np.pi))
    corners = simplified(way, ways.room)
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        turn = angle_between(corner - before, after - corner)
        if turn < _LEAST_TURN:
            continue
        outwards = (corner - before) / np.linalg.norm(corner - before) - (after - corner) / np.linalg.norm(
            after - corner
        )
        outwards /= np.linalg.norm(outwards)
        half = np.cos(0.5 * min(turn, 0.95 * np.pi))
        radius = depth_beyond(ways.gaps, corner, outwards, ways.room, arm.length) * half / (1.0 - half)
        if radius <= _STIFF * tightest:
            walls = beside(ways.gaps, corner, 0.0)[:1]
            compared = "less than" if radius < tightest else "hardly more than"
            yield Finding(
                "too stiff",
                f"the shortest way turns by {degrees(turn)} round {listed(walls)} at {at(corner)}, where there is room "
                f"for a radius of {short_length(radius)}, {compared} the {short_length(float(tightest))} of the arm "
                f"with every joint at its limit of {degrees(arm.joint_limit)}",
                proved=False,
                place=point(corner),
                measured=float(radius),
                allowed=float(tightest),
                obstacles=walls,
                bounds={"arm.joint_limit_deg": arm.joint_limit},
            )


def simplified(way: FloatArray, tolerance: float) -> FloatArray:
    """Return a way without the corners that lie near the straight lines between the others, shape (k, d) [m].

    A way pulled round something has many corners that turn a little; here they are one. Source: D. Douglas and T.
    Peucker, Algorithms for the reduction of the number of points required to represent a digitized line, 1973.

    Args:
        way: corners, shape (m, d) [m].
        tolerance: how far from the straight lines corners that are left out may be [m].
    """
    if len(way) < 3:
        return way
    along = way[-1] - way[0]
    share = np.clip((way - way[0]) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    off = np.linalg.norm(way - way[0] - share[:, None] * along, axis=1)
    farthest = int(np.argmax(off))
    if off[farthest] <= tolerance:
        return way[[0, -1]]
    first = simplified(way[: farthest + 1], tolerance)
    return np.concatenate((first[:-1], simplified(way[farthest:], tolerance)))
