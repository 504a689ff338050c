"""Whether the goal is within reach.

The guide tube holds the arm straight up to the hole, so the axis of an arm whose tip is elsewhere passes through it,
and the arm reaches no farther beyond it than the range of its feed lets it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import shapely
from scipy.optimize import brentq

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.length_words import in_metres, long_length, short_length
from ccm_opt.core.length_words import place as at
from ccm_opt.core.polyline import heading_of, wrap
from ccm_opt.diagnosis.keyed_poses import TipPlace, tip_places, whole_poses
from ccm_opt.diagnosis.ranking import degrees, listed, point
from ccm_opt.errors import Finding
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.arm import Arm


def within_reach(problem: Problem) -> Iterator[Finding]:
    """Goals of the tip that are farther from every place of the base than the arm is long."""
    arm = problem.arm
    for place in tip_places(problem):
        distance = float(shapely.distance(_base_places(arm), shapely.Point(place.goal.position)))
        least = distance - place.tolerances.position
        if least > arm.length + ROUNDING:
            bounds = {"arm.link_length": least / arm.links, **_feed_that_reaches(arm, place)}
            yield out_of_reach(place.key, place.goal.position, distance, place.tolerances.position, arm.length, bounds)


def out_of_reach(
    key: str, goal: FloatArray, distance: float, tolerance: float, length: float, bounds: Mapping[str, float]
) -> Finding:
    """Return the finding of a goal that is farther from every place of the base than the arm is long.

    Args:
        key: of the goal in the problem file.
        goal: its place, shape (2,) or (3,) [m].
        distance: from the base [m].
        tolerance: of the goal's position [m].
        length: of the arm [m].
        bounds: values that would do, by their keys [m].
    """
    least = distance - tolerance
    # Distances are told to a millimetre: a tolerance that shows there belongs to the sum.
    tolerated = f" less {long_length(tolerance)} of tolerance" if in_metres(tolerance) >= 5e-4 else ""
    return Finding(
        "too short",
        f"{key}: out of reach, the arm is {long_length(least - length)} too short; the goal is "
        f"{long_length(distance)} from the base{tolerated}; the arm is only {long_length(length)} long",
        key=key,
        place=point(goal),
        measured=least,
        allowed=length,
        bounds=bounds,
    )


def _feed_that_reaches(arm: Arm, place: TipPlace) -> dict[str, float]:
    """The least upper end of the feed axis from which the arm reaches a goal [m]; nothing where none does."""
    if arm.feed is None:
        return {}
    towards = place.goal.position - arm.base
    along = float(towards @ arm.direction)
    aside = float(np.hypot(*(towards - along * arm.direction)))
    reach = arm.length + place.tolerances.position
    if aside > reach or along < arm.feed.high:
        return {}
    return {"arm.feed.range": along - float(np.sqrt(reach**2 - aside**2))}


def within_joint_limits(problem: Problem) -> Iterator[Finding]:
    """Poses at which a joint is beyond its limit."""
    arm = problem.arm
    for pose in whole_poses(problem):
        bends = np.abs(arm.bends(pose.headings))
        joint = int(np.argmax(bends - arm.bend_limits))
        if bends[joint] - arm.bend_limits[joint] <= ROUNDING:
            continue
        key = "arm.joint_limit_deg" if joint else "arm.base_limit_deg"
        yield Finding(
            "joint limit",
            f"{pose.key}: {pose.name} bends joint {joint + 1} by {np.rad2deg(bends[joint]):.2f}°, its limit is "
            f"{np.rad2deg(arm.bend_limits[joint]):.2f}°",
            key=pose.key,
            proved=bool(np.max(bends - arm.bend_limits) > pose.bend_play + ROUNDING),
            measured=float(bends[joint]),
            allowed=float(arm.bend_limits[joint]),
            unit="rad",
            bounds={key: float(np.max(bends[1:]) if joint else bends[0])},
        )


def supple_enough(problem: Problem) -> Iterator[Finding]:
    """Goals of the tip that the joints cannot turn to; only for a base that stands still."""
    for place in tip_places(problem):
        yield from _turned_far_enough(problem.arm, place)
        yield from _curled_enough(problem.arm, place)


def _turned_far_enough(arm: Arm, place: TipPlace) -> Iterator[Finding]:
    """The tip's heading, and the direction of the goal, lie within the sum of all bends.

    The mean of the links' headings, weighted by length, points from base to tip only if some link heads to either
    side of that direction; so from some joint on the bends add up to the turn from there to the tip's heading.
    """
    towards = place.goal.position - arm.base
    distance = float(np.hypot(*towards))
    bends = (arm.links - 1) * arm.joint_limit
    direction = heading_of(towards) if distance > place.tolerances.position else None
    # The tip may be anywhere in the tolerance, so the goal may be seen in another direction by that.
    aside = float(np.arcsin(min(place.tolerances.position / max(distance, 1e-300), 1.0)))
    heading = place.goal.heading
    if heading is not None:
        turn = _turn(heading - arm.base_heading) - place.tolerances.heading
        yield from _short_of_turn(arm, place, "from the base's heading to the goal's", turn, bends + arm.base_limit)
    if direction is not None:
        turn = _turn(direction - arm.base_heading) - aside
        yield from _short_of_turn(arm, place, "from the base's heading towards the goal", turn, bends + arm.base_limit)
    if heading is not None and direction is not None:
        turn = _turn(heading - direction) - aside - place.tolerances.heading
        yield from _short_of_turn(arm, place, "from the way to the goal to its heading", turn, bends)


def _turn(angle: float) -> float:
    """The angle the short way round, without its sign [rad]."""
    return abs(wrap(angle))


def _short_of_turn(arm: Arm, place: TipPlace, what: str, turn: float, most: float) -> Iterator[Finding]:
    """A turn that is more than all joints together can make, with the limits that would do [rad]."""
    if turn <= most + ROUNDING:
        return
    base = most - (arm.links - 1) * arm.joint_limit
    bounds = {"arm.joint_limit_deg": (turn - base) / (arm.links - 1)}
    if base:
        bounds["arm.base_limit_deg"] = arm.base_limit + turn - most
    yield cannot_turn_enough(place.key, place.goal.position, what, turn, most, bounds)


def _curled_enough(arm: Arm, place: TipPlace) -> Iterator[Finding]:
    """The goal is not nearer to the base than the tightest arc brings the tip (Cauchy's arm lemma, Schur's theorem)."""
    distance = float(np.hypot(*(place.goal.position - arm.base))) + place.tolerances.position
    nearest = least_chord(arm.links, arm.link_length, arm.joint_limit)
    if distance >= nearest - ROUNDING:
        return
    limit = brentq(
        lambda bend: least_chord(arm.links, arm.link_length, bend) - distance, arm.joint_limit, 2.0 * np.pi / arm.links
    )
    needed = {"arm.joint_limit_deg": float(limit)}
    yield cannot_curl_up(place.key, place.goal.position, distance, arm.joint_limit, nearest, needed)


def cannot_turn_enough(
    key: str, goal: FloatArray, what: str, turn: float, most: float, bounds: Mapping[str, float]
) -> Finding:
    """A turn that is more than all joints together can make.

    Args:
        key: of the goal in the problem file.
        goal: its place, shape (2,) or (3,) [m].
        what: from where to where the arm would have to turn.
        turn: by how much [rad].
        most: that the joints can make together [rad].
        bounds: limits that would do, by their keys [rad].
    """
    return Finding(
        "too stiff",
        f"{key}: the arm cannot turn enough: {degrees(turn)} {what}, all joints together turn by {degrees(most)}",
        key=key,
        place=point(goal),
        measured=turn,
        allowed=most,
        unit="rad",
        bounds=bounds,
    )


def cannot_curl_up(
    key: str, goal: FloatArray, distance: float, limit: float, nearest: float, bounds: Mapping[str, float]
) -> Finding:
    """A goal nearer to the base than the tip can come.

    Args:
        key: of the goal in the problem file.
        goal: its place, shape (2,) or (3,) [m].
        distance: from the base, with what is tolerated [m].
        limit: of the joints [rad].
        nearest: that the tip comes with every joint at its limit [m].
        bounds: limits that would do, by their keys [rad].
    """
    return Finding(
        "too stiff",
        f"{key}: the arm cannot curl up enough; the goal is {long_length(distance)} from the base; with "
        f"every joint at its limit of {degrees(limit)} the tip comes no nearer than {long_length(nearest)}",
        key=key,
        place=point(goal),
        measured=distance,
        allowed=nearest,
        bounds=bounds,
    )


def tight_turn(
    way: str, turn: float, walls: tuple[str, ...], corner: FloatArray, room: float, tightest: float, limit: float
) -> Finding:
    """Return the finding of a turn with hardly the room for the arm's tightest bend, or with less.

    Args:
        way: on which it is, in words.
        turn: by how much [rad].
        walls: round which.
        corner: where, shape (2,) or (3,) [m].
        room: radius for which there is room [m].
        tightest: radius to which the arm bends with every joint at its limit [m].
        limit: of the joints [rad].
    """
    compared = "less than" if room < tightest else "hardly more than"
    return Finding(
        "too stiff",
        f"{way} turns by {degrees(turn)} round {listed(walls)} at {at(corner)}, where there is room for a radius of "
        f"{short_length(room)}, {compared} the {short_length(tightest)} of the arm with every joint at its limit of "
        f"{degrees(limit)}",
        proved=False,
        place=point(corner),
        measured=room,
        allowed=tightest,
        obstacles=walls,
        bounds={"arm.joint_limit_deg": limit},
    )


def least_chord(links: int, length: float, bend: float) -> float:
    """The least distance from base to tip of links whose bends are at most so large [m].

    Of all chains of equal links whose bends do not exceed ``bend`` the regular arc has the shortest chord, as long as
    arc and chord together are convex (Cauchy's arm lemma; Schur's theorem for curves): n bend ≤ 2π. It is
    l sin(n bend / 2) / sin(bend / 2).

    Args:
        links: n.
        length: of one link [m].
        bend: most bend of a joint [rad].
    """
    if links * bend >= 2.0 * np.pi:
        return 0.0
    return length * links if bend <= 0.0 else length * float(np.sin(0.5 * links * bend) / np.sin(0.5 * bend))


def _base_places(arm: Arm) -> shapely.Geometry:
    """All places of the base: the stretch over which it is carried, of no length when it is fixed."""
    return shapely.LineString([arm.base + where * arm.direction for where in arm.base_range])


def beyond_hole(problem: Problem, place: TipPlace) -> Problem | None:
    """The problem of an arm that begins at the hole, fed in as far as can be, with one goal for the tip.

    Args:
        problem: of an arm with a feed axis.
        place: of its goals.

    Returns:
        None where the tip may be in the tube, or the base beyond it.
    """
    arm = problem.arm
    feed = arm.feed
    if feed is None or feed.high > feed.hole:
        return None
    hole = arm.base + feed.hole * arm.direction
    towards = place.goal.position - hole
    along = float(towards @ arm.direction)
    aside = float(np.hypot(*(towards - along * arm.direction)))
    reach = arm.length + feed.high - feed.hole
    in_tube = along <= place.tolerances.position and aside <= place.tolerances.position + ROUNDING
    if in_tube or reach <= 0.0:
        return None
    fixed = replace(arm, feed=None, base=hole, link_length=reach / arm.links)
    limits = replace(problem.limits, feed_velocity=None, feed_acceleration=None)
    straight = JointPose(np.zeros(arm.links))
    return replace(
        problem, arm=fixed, limits=limits, start=straight, goal=place.goal, tolerances=place.tolerances, stops=()
    )
