"""Clearance and tolerated errors of a plan in words, as a section of the HTML report, and as chart data."""

import re
from collections.abc import Iterator, Mapping

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import points_at
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import (
    ClearanceLimit,
    ClearanceRecord,
    JointTrajectory,
    NearPlace,
    PossibleGap,
    ShortStretch,
    Solution,
    ToleratedError,
)
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.viz.checks_section import joint_in_words
from ccm_opt.viz.document import Markup, PageUnits, coded, element, step_for

_PREFERRED_CLEARANCES_SHOWN = 4.0
"""Range of the chart of clearance over time, in multiples of the preferred clearance."""

_PLACES_ON_LINK = 33
"""Number of points of a link's axis among which the one nearest to an obstacle is searched for. Heuristic."""

_BOUNDS = {
    "start": "the start pose allows no more",
    "goal": "the goal allows no more",
    "passage": "the widest passage to the goal allows no more",
}
_LIMITS: Mapping[ClearanceLimit, str] = {
    "walls": "obstacles on the other side hold the arm where it is",
    "links": "other links hold the arm where it is",
    "joint limits": "joints are at their limits",
    "feed": "the feed axis is at the end of its range",
    "base axes": "base axes are at the end of their range",
    "goal": "the goal fixes the end of the motion",
    "via places": "goal.via fixes where the tip passes",
    "constraints": "constraints hold the arm where it is",
    "costs": "costs and soft constraints hold the arm where it is",
    "length": "more would make the motion longer than it is worth",
    "steps": "a better motion was expected, but none was certified",
    "time": "planning ended before the motion was as good as it could be",
    "smooth path": "the motion with more clearance has no smooth path that is certified",
    "path of the tip": "the arm follows the path of its tip, which the pose at the goal fixes",
    "not optimised": "the motion was not optimised",
}
_CAUSES = {
    "start": "at the start pose",
    "stop": "at a stop",
    "goal": "at the goal pose",
    "passage": "on the way",
}


_MOST_STRETCHES = 3
"""Maximum number of time intervals below the preferred clearance that are mentioned, those with the largest
shortfall."""


def clearance_sentences(room: ClearanceRecord, units: PageUnits) -> Iterator[str]:
    """Yield sentences about the clearance of a motion over time, the most important first."""
    yield _least_gap(room, units)
    worst = sorted(room.short, key=lambda part: part.nearest.gap - part.nearest.wanted)[:_MOST_STRETCHES]
    for part in sorted(worst, key=lambda part: part.begin):
        yield _short_stretch(part, units)
    left = len(room.short) - len(worst)
    if left:
        yield f"and {left} more stretch{'es' if left > 1 else ''} below the preferred clearance"
    if room.limited_by:
        yield f"on the way, {'; '.join(_LIMITS[limit] for limit in room.limited_by)}"
    if room.short and room.possible is not None and room.possible.by != "wanted gap":
        yield _bound(room.possible, units)
    if room.price is not None and room.price < 0.0:
        yield f"with the preferred clearance the motion is {-room.price:.3g} s shorter than without"
    elif room.price is not None:
        yield f"the preferred clearance costs {room.price:.3g} s"


def _least_gap(room: ClearanceRecord, units: PageUnits) -> str:
    """Return a sentence about the minimum clearance of a motion: value, time, and the two bodies."""
    near = room.nearest
    if not near.link:
        return f"least gap above {units.given(room.reach, 'm')}, the largest gap measured"
    # Without a clearance, or where another link is nearest, the gap is the distance itself.
    counted = room.clearance and not near.second_link
    beyond = f" beyond the clearance of {units.given(room.clearance, 'm')}" if counted else ""
    wanted = f" of the preferred {units.given(near.wanted, 'm')}" if near.wanted else ""
    return f"least gap {units.length(near.gap)}{wanted}{beyond}, at {near.time:.2f} s, {near.pair}"


def _short_stretch(part: ShortStretch, units: PageUnits) -> str:
    """Return a sentence about a time interval below the preferred clearance: value, times, cause, and both bodies."""
    near = part.nearest
    gap = f"{units.length(near.gap)} of the preferred {units.given(near.wanted, 'm')}"
    times = f"{part.begin:.2f} to {part.end:.2f} s"
    return f"clearance {gap} from {times}, {_CAUSES[part.cause]}, {near.pair}"


def _bound(possible: PossibleGap, units: PageUnits) -> str:
    """Return a sentence about the upper bound on the clearance of any motion that solves the problem."""
    most = units.length(possible.value)
    if possible.walls:
        one, other = possible.walls
        return f"the passage between '{one}' and '{other}' allows at most {most} on either side"
    return f"no motion can keep more than {most}: {_BOUNDS.get(possible.by, 'no more is preferred')}"


def clearance_section(room: ClearanceRecord | None, units: PageUnits) -> Markup | None:
    """Return the section of the report about clearance; None if clearance was not measured.

    Args:
        room: clearance of the motion over time.
        units: units of the page.
    """
    if room is None:
        return None
    first, *others = clearance_sentences(room, units)
    sentences = [element("li", f"{_capitalised(sentence)}.") for sentence in others]
    return element(
        "section",
        element("h2", "Clearance"),
        element("p", f"{_capitalised(first)}."),
        element("figure", id="gaps"),
        element("ul", *sentences) if sentences else None,
    )


def nearest_mark(solution: Solution, units: PageUnits) -> dict[str, object] | None:
    """Return position and text of the mark for the minimum clearance in the report's scene; None if nothing is near."""
    room = solution.room
    if room is None or not room.nearest.link:
        return None
    place = least_gap_place(solution.problem, solution.trajectory, room.nearest)
    return {"place": [float(value) for value in place], "words": next(clearance_sentences(room, units))}


def least_gap_place(problem: Problem, trajectory: JointTrajectory, near: NearPlace) -> FloatArray:
    """Return the place of a motion's minimum clearance: between the bodies in the plane, on the arm's axis in space.

    Args:
        problem: the problem, which gives arm and obstacles.
        trajectory: the motion.
        near: time and bodies of the minimum clearance.

    Returns:
        The place, shape (d,) with d = 2 or 3 [m].
    """
    points = problem.arm.joint_positions_at(points_at(trajectory.positions, trajectory.time, near.time))
    if problem.dimension == 3:
        return _nearest_on_axis(problem, points, near)
    first = shapely.LineString(points[near.link - 1 : near.link + 1])
    if near.second_link:
        second: shapely.Geometry = shapely.LineString(points[near.second_link - 1 : near.second_link + 1])
    else:
        second = next(wall.core for wall in problem.workspace.walls if wall.name == near.obstacle)
    middle: FloatArray = shapely.get_coordinates(shapely.shortest_line(first, second)).mean(axis=0)
    return middle


def _nearest_on_axis(problem: Problem, points: FloatArray, near: NearPlace) -> FloatArray:
    """Return the point of a link's axis at which the link is nearest to the other body, shape (3,) [m].

    Args:
        problem: the problem, which gives the obstacles in space.
        points: positions of joints and tip, shape (n + 1, 3) [m].
        near: bodies of the minimum clearance.
    """
    # A gap of the tool is shown at the last link.
    link = min(near.link, problem.arm.links)
    start, end = points[link - 1 : link + 1]
    along = start + np.linspace(0.0, 1.0, _PLACES_ON_LINK)[:, None] * (end - start)
    if near.second_link:
        second = min(near.second_link, problem.arm.links)
        other = points[second - 1 : second + 1]
        across = other[1] - other[0]
        share = np.clip((along - other[0]) @ across / max(float(across @ across), 1e-300), 0.0, 1.0)
        away = np.linalg.norm(along - other[0] - share[:, None] * across, axis=1)
    else:
        soup = problem.workspace.triangle_soup
        own = soup.triangles[soup.owner == soup.names.index(near.obstacle)]
        reach = near.gap + 2.0 * float(np.max(problem.arm.radii)) + problem.workspace.clearance
        low, high = along.min(axis=0) - reach, along.max(axis=0) + reach
        beside = np.all((own.max(axis=1) > low) & (own.min(axis=1) < high), axis=1)
        tree = SurfaceTree.from_triangles(TriangleSoup.joined([(near.obstacle, own[beside], 0.0)]))
        away = tree.distances(np.stack((along, along), axis=1), 10.0 * reach)
    return np.asarray(along[np.argmin(away)])


def _capitalised(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


_WRONG = {
    "joints": "every joint off by",
    "link lengths": "every link length off by",
    "base heading": "base turned by",
    "base position": "base displaced by",
    "walls": "every wall closer by",
    "payload": "mass at the tip",
    "friction": "friction in every joint",
}
_TIME = re.compile(r" at t = (\d+(?:\.\d+)?) s")


def tolerated_error_words(error: ToleratedError, units: PageUnits, *, in_space: bool) -> tuple[str, str, str]:
    """Return a tolerated error as texts: its kind, its maximum size, and the check that limits it with time.

    Args:
        error: the tolerated error, with the check that limits it.
        units: units of the page or table.
        in_space: whether joints have two bend angles, which have separate names.
    """
    where = _TIME.sub(lambda time: f" at {float(time[1]):.2f} s", error.where)
    least = "" if error.limited else "≥ "
    return (
        _WRONG.get(error.name, error.name),
        least + units.shown(error.size, error.unit, error.size),
        joint_in_words(where, in_space=in_space),
    )


def gap_data(room: ClearanceRecord) -> dict[str, object]:
    """Return the clearance of a motion over time as data for the report's chart; lengths [m], times [s].

    Args:
        room: clearance of the motion over time.
    """
    gaps = np.concatenate((room.wall_gaps, room.self_gaps))
    step = step_for(gaps)
    near = room.nearest
    return {
        "time": coded(room.time, 1e-5),
        "walls": coded(room.wall_gaps, step),
        "itself": coded(room.self_gaps, step),
        "wanted": room.wanted,
        "clearance": room.clearance,
        "reach": room.reach,
        "highest": chart_top(room),
        "nearest": {"gap": near.gap, "time": near.time, "pair": near.pair, "itself": bool(near.second_link)}
        if near.link
        else None,
    }


def chart_top(room: ClearanceRecord) -> float:
    """Return the clearance at the top of the chart of clearance over time [m].

    It is a multiple of the preferred or the minimum clearance, reduced to just above the largest clearance of the
    motion and kept below the search distance, at which recorded clearances are capped.
    """
    # The record caps gaps at its search distance; capped values are not shown as if they were gaps.
    largest = 1.1 * float(room.gaps.max())
    shown = max(_PREFERRED_CLEARANCES_SHOWN * room.wanted, 2.0 * float(room.gaps.min())) if room.wanted else room.reach
    return max(min(shown, largest, 0.98 * room.reach), 1.5 * room.wanted, 1e-3 * room.reach)
