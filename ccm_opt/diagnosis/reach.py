"""Checks of whether length and joint limits alone let an arm reach its goals, regardless of obstacles."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import brentq

from ccm_opt.core.arrays import ROUNDING, FloatArray
from ccm_opt.core.errors import Finding
from ccm_opt.core.length_words import in_metres, long_length
from ccm_opt.diagnosis.contact import touching_overlap
from ccm_opt.diagnosis.named_goals import NamedTipGoal, named_poses, named_tip_goals
from ccm_opt.diagnosis.ranking import degrees, point
from ccm_opt.diagnosis.sections import longer_sections, section_at, sections_of, with_section
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm

_DIRECTIONS = 1000
"""Number of directions over the sphere along which the arm's shortfall is evaluated. Heuristic: 6° apart."""
_REFINEMENTS = 8
"""Number of refinements around the direction of greatest shortfall, each at half the spacing. Heuristic: to 0.1°."""
_DIRECTIONS_NEAR = 50
"""Number of directions evaluated per refinement. Heuristic."""


def within_reach(problem: Problem) -> Iterator[Finding]:
    """Yield a finding per tip goal that is farther from all positions of the base than the arm is long."""
    arm = problem.arm
    for place in named_tip_goals(problem):
        goal = place.goal.position
        distance = _from_base(arm, goal)
        least = distance - place.tolerances.position
        if least <= arm.length + ROUNDING:
            continue
        # Distances are reported to a millimetre; a tolerance of that size has to be mentioned for the sum to match.
        shown = in_metres(place.tolerances.position) >= 5e-4
        tolerated = f" less {long_length(place.tolerances.position)} of tolerance" if shown else ""
        yield Finding(
            "too short",
            f"{place.key}: out of reach: the arm is {long_length(least - arm.length)} too short; the goal is "
            f"{long_length(distance)} from the base{tolerated}; the arm is only {long_length(arm.length)} long",
            key=place.key,
            place=point(goal),
            measured=least,
            allowed=arm.length,
            bounds={**longer_sections(arm, least - arm.length), **_feed_that_reaches(arm, place)},
        )


def nearest_base(arm: Arm, place: FloatArray) -> FloatArray:
    """Return the position of the base on its axis that is nearest to a point (d,), shape (d,) [m]."""
    low, high = arm.base_range
    along = float(np.clip((place - arm.base) @ arm.direction, low, high))
    return np.asarray(arm.base + along * arm.direction)


def _from_base(arm: Arm, place: FloatArray) -> float:
    """Return the distance of a point from the nearest position of the base [m]."""
    return float(np.linalg.norm(place - nearest_base(arm, place)))


def _feed_that_reaches(arm: Arm, place: NamedTipGoal) -> dict[str, float]:
    """Return, by key, the least upper feed limit with which the arm reaches a goal [m]; empty if none does."""
    if arm.feed is None:
        return {}
    towards = place.goal.position - arm.base
    along = float(towards @ arm.direction)
    aside = float(np.linalg.norm(towards - along * arm.direction))
    reach = arm.length + place.tolerances.position
    if aside > reach or along < arm.feed.high:
        return {}
    return {"arm.feed.range": along - float(np.sqrt(reach**2 - aside**2))}


def within_joint_limits(problem: Problem) -> Iterator[Finding]:
    """Yield a finding per required pose in which a bend is beyond its limit."""
    arm = problem.arm
    limits = arm.bend_limits
    a_joint = arm.coordinates.bends_a_joint
    for pose in named_poses(problem):
        bends = np.abs(pose.q[arm.coordinates.bends])
        worst = int(np.argmax(bends - limits))
        if bends[worst] - limits[worst] <= ROUNDING:
            continue
        joint = worst // a_joint
        key = _limit_key(arm, joint) if joint else "arm.base_limit_deg"
        yield Finding(
            "joint limit",
            f"{pose.key}: {pose.name} bends joint {joint + 1} by {np.rad2deg(bends[worst]):.2f}°, but its limit is "
            f"{np.rad2deg(limits[worst]):.2f}°",
            key=pose.key,
            proved=bool(np.max(bends - limits) > pose.bend_tolerance + ROUNDING),
            measured=float(bends[worst]),
            allowed=float(limits[worst]),
            unit="rad",
            bounds={
                key: float(np.max(bends[a_joint:] if joint and arm.proportions is None else bends[worst : worst + 1]))
            },
        )


def _limit_key(arm: Arm, joint: int) -> str:
    """Return the key of the limit of a joint (index from 0) other than the first."""
    return "arm.joint_limit_deg" if arm.proportions is None else section_at(arm, joint).key("joint_limit_deg")


def within_bend_limits(problem: Problem) -> Iterator[Finding]:
    """Yield a finding per tip goal that the joint limits put out of reach."""
    arm = problem.arm
    for place in named_tip_goals(problem):
        turned = list(_turned_far_enough(arm, place))
        yield from turned
        # The theorem by which an arm curls up least takes its links to be equal.
        curled = [] if arm.base_axes or arm.proportions is not None else list(_can_curl(arm, place))
        yield from curled
        near = _from_base(arm, place.goal.position) - place.tolerances.position <= arm.length
        if near and not turned and not curled:
            yield from _both_at_once(arm, place)


def most_turn(arm: Arm, limit: float) -> float:
    """Return the largest angle between consecutive links if each bend of their joint has a given limit [rad].

    With two bends a and b, the next link points along (cos a cos b, sin a cos b, −sin b) in the frame of the preceding
    link, so the angle is arccos (cos a cos b). For limits up to a right angle, it is largest with both bends at the
    limit; beyond, with one of them zero.
    """
    if arm.coordinates.bends_a_joint > 1 and limit <= 0.5 * np.pi:
        return float(np.arccos(np.cos(limit) ** 2))
    return float(min(limit, np.pi))


def joint_turns(arm: Arm) -> FloatArray:
    """Return the largest angle between the links before and beyond each joint, shape (links,) [rad]."""
    if arm.proportions is None:
        return np.append(most_turn(arm, arm.base_limit), np.full(arm.links - 1, most_turn(arm, arm.joint_limit)))
    limits = arm.bend_limits.reshape(arm.links, -1)
    greatest = np.minimum(np.max(limits, axis=1), np.pi)
    both = np.arccos(np.prod(np.cos(np.minimum(limits, 0.5 * np.pi)), axis=1))
    return np.asarray(np.where(greatest <= 0.5 * np.pi, both, greatest))


def least_limit(arm: Arm, turn: float) -> float:
    """Return the least limit of each bend with which a joint can turn by an angle [rad]; inverts ``most_turn``."""
    if arm.coordinates.bends_a_joint > 1 and turn <= 0.5 * np.pi:
        return float(np.arccos(np.sqrt(np.cos(turn))))
    return turn


def _turned_far_enough(arm: Arm, place: NamedTipGoal) -> Iterator[Finding]:
    """Yield a finding if the goal, or its direction, requires more turning than all joints together allow.

    The directions of the links form a chain on the unit sphere whose steps are the joint angles, and the direction from
    base to tip is a positive combination of these directions. A chain shorter than π lies within half its length of its
    midpoint, in a convex cap, so the direction from base to tip is no farther than the chain's length from either end.
    """
    towards = place.goal.position - arm.base
    distance = float(np.linalg.norm(towards))
    base = float(joint_turns(arm)[0])
    tip = place.goal.direction
    if tip is not None:
        turn = angle_between(tip, arm.direction) - place.tolerances.heading
        yield from _insufficient_turn(arm, place, "from the base's direction to the goal's", turn, base)
    # For a fed base, the direction towards the goal is not fixed.
    if arm.base_axes or distance <= place.tolerances.position:
        return
    # The tip may be anywhere within its tolerance, which changes the direction towards it by up to this angle.
    aside = float(np.arcsin(min(place.tolerances.position / distance, 1.0)))
    turn = angle_between(towards, arm.direction) - aside
    yield from _insufficient_turn(arm, place, "from the base's direction towards the goal", turn, base)
    if tip is not None:
        turn = angle_between(towards, tip) - aside - place.tolerances.heading
        yield from _insufficient_turn(arm, place, "from the line to the goal to the direction at the goal", turn, 0.0)


def angle_between(one: FloatArray, other: FloatArray) -> float:
    """Return the angle between two vectors of any length [rad]."""
    one = one / np.linalg.norm(one)
    other = other / np.linalg.norm(other)
    return 2.0 * float(np.arctan2(np.linalg.norm(one - other), np.linalg.norm(one + other)))


def _insufficient_turn(arm: Arm, place: NamedTipGoal, what: str, turn: float, base: float) -> Iterator[Finding]:
    """Yield a finding if a required turn exceeds the sum of all joint limits, with the limits that would suffice.

    Args:
        arm: the arm.
        place: the goal.
        what: phrase for the two directions between which the arm has to turn.
        turn: required turn [rad].
        base: largest turn of the first joint; 0 if it does not contribute [rad].
    """
    turns = joint_turns(arm)
    beyond = float(np.sum(turns[1:])) if arm.proportions is not None else (arm.links - 1) * float(turns[1])
    most = beyond + base
    if turn <= most + ROUNDING:
        return
    bounds = _limits_that_turn(arm, turn - most)
    if base:
        bounds["arm.base_limit_deg"] = least_limit(arm, min(base + turn - most, np.pi))
    yield Finding(
        "too stiff",
        f"{place.key}: the arm cannot turn enough: it takes {degrees(turn)} {what}, but all joints together turn by "
        f"{degrees(most)} at most",
        key=place.key,
        place=point(place.goal.position),
        measured=turn,
        allowed=most,
        unit="rad",
        bounds=bounds,
    )


def _limits_that_turn(arm: Arm, lacking: float) -> dict[str, float]:
    """Return by key the joint limits with which all joints but the first turn farther by an angle [rad] in all."""
    turns = joint_turns(arm)
    if arm.proportions is None:
        return {"arm.joint_limit_deg": least_limit(arm, float(turns[1]) + lacking / (arm.links - 1))}
    found = {}
    for section in sections_of(arm):
        own = turns[max(section.first, 1) : section.end]
        count = int(np.sum(own > 0.0))
        if count and (needed := float(np.max(own)) + lacking / count) < np.pi:
            found[section.key("joint_limit_deg")] = least_limit(arm, needed)
    return found


def _can_curl(arm: Arm, place: NamedTipGoal) -> Iterator[Finding]:
    """Yield a finding if the goal is nearer to the base than the tip can come with all bends at their limits.

    The bound is Schur's theorem for polygons.
    """
    distance = _from_base(arm, place.goal.position) + place.tolerances.position
    most = most_turn(arm, arm.joint_limit)
    nearest = least_chord(arm.links, arm.link_length, most)
    if distance >= nearest - ROUNDING:
        return
    turn = brentq(lambda bend: least_chord(arm.links, arm.link_length, bend) - distance, most, 2.0 * np.pi / arm.links)
    yield Finding(
        "too stiff",
        f"{place.key}: the arm cannot curl up enough: the goal is {long_length(distance)} from the base, but with "
        f"every joint at its limit of {degrees(arm.joint_limit)} the tip comes no nearer than {long_length(nearest)}",
        key=place.key,
        place=point(place.goal.position),
        measured=distance,
        allowed=nearest,
        bounds={"arm.joint_limit_deg": least_limit(arm, float(turn))},
    )


def least_chord(links: int, length: float, bend: float) -> float:
    """Return the least distance from base to tip of a chain of equal links with limited bends [m].

    Of all chains of equal links with bends of at most ``bend``, the regular arc has the shortest chord, as long as arc
    and chord together are convex, n bend ≤ 2π (Cauchy's arm lemma; Schur's theorem for curves). The length of this
    chord is l sin(n bend / 2) / sin(bend / 2).

    Args:
        links: number of links n.
        length: length l of one link [m].
        bend: largest bend of a joint [rad].
    """
    if links * bend >= 2.0 * np.pi:
        return 0.0
    return length * links if bend <= 0.0 else length * float(np.sin(0.5 * links * bend) / np.sin(0.5 * bend))


@dataclass(frozen=True)
class TurnCaps:
    """Bounds on an arm's extent from two cones in which each link's direction lies.

    One cone is about the base's direction, the other about the goal's if it has one.

    Attributes:
        arm: the arm.
        place: the tip goal, with or without a direction.
    """

    arm: Arm
    place: NamedTipGoal

    def farthest(self, directions: FloatArray) -> FloatArray:
        """Return upper bounds on the arm's extent from base to tip along directions (k, d), shape (k,) [m].

        The direction of link i differs from the base's by at most the angles of the joints up to link i, and from the
        tip's by at most those of the joints beyond. It thus lies in two cones, and along w the link of length l extends
        by at most l cos β, where β is the larger of the angles by which w is outside the cones.
        """
        arm = self.arm
        turns = joint_turns(arm)
        before = np.cumsum(turns)
        outside = _angles(directions, arm.direction)[:, None] - before
        if self.place.goal.direction is not None:
            after = self.place.tolerances.heading + np.append(np.cumsum(turns[:0:-1])[::-1], 0.0)
            outside = np.maximum(outside, _angles(directions, self.place.goal.direction)[:, None] - after)
        return np.asarray(np.cos(np.clip(outside, 0.0, np.pi)) @ arm.lengths)

    def missing(self, directions: FloatArray) -> FloatArray:
        """Return the arm's shortfall from the goal along directions (k, d), for the best base position, (k,) [m]."""
        arm = self.arm
        ends = arm.base + np.outer(arm.base_range, arm.direction)
        needed = ((self.place.goal.position - ends) @ directions.T).min(axis=0)
        return np.asarray(needed - self.place.tolerances.position - self.farthest(directions))

    def worst(self) -> tuple[float, FloatArray]:
        """Return the greatest shortfall found over all directions [m], and the direction (d,) in which it occurs."""
        dimension = self.arm.dimension
        directions = spread_directions(_DIRECTIONS, dimension)
        best = directions[int(np.argmax(self.missing(directions)))]
        # The search need not be exhaustive, since a positive shortfall along any direction is a proof.
        spread = 4.0 / np.sqrt(_DIRECTIONS)
        for _ in range(_REFINEMENTS):
            near = best + spread * spread_directions(_DIRECTIONS_NEAR, dimension)
            near = np.concatenate((best[None], near / np.linalg.norm(near, axis=1, keepdims=True)))
            best = near[int(np.argmax(self.missing(near)))]
            spread *= 0.5
        return float(self.missing(best[None])[0]), best


def _angles(directions: FloatArray, direction: FloatArray) -> FloatArray:
    unit = direction / np.linalg.norm(direction)
    return np.asarray(np.arccos(np.clip(directions @ unit, -1.0, 1.0)))


def spread_directions(count: int, dimension: int) -> FloatArray:
    """Return unit vectors spread evenly over the circle or the sphere, shape (k, d).

    On the circle they have equal angles; on the sphere they lie on a golden-ratio spiral.

    Args:
        count: number of directions on the sphere; on the circle, fewer have a similar spacing.
        dimension: 2 for the circle, 3 for the sphere.
    """
    if dimension == 2:
        turn = 2.0 * np.pi * np.arange(np.ceil(np.sqrt(np.pi * count))) / np.ceil(np.sqrt(np.pi * count))
        return np.column_stack((np.cos(turn), np.sin(turn)))
    number = np.arange(count) + 0.5
    height = 1.0 - 2.0 * number / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    aside = np.sqrt(1.0 - height**2)
    return np.column_stack((aside * np.cos(turn), aside * np.sin(turn), height))


def _both_at_once(arm: Arm, place: NamedTipGoal) -> Iterator[Finding]:
    """Yield a finding if the goal lies outside the convex hull of the tip positions that joint limits allow."""
    missing, direction = TurnCaps(arm, place).worst()
    if missing <= touching_overlap(arm):
        return
    reached = "with its direction " if place.goal.direction is not None else ""
    sharpest = degrees(float(np.max(joint_turns(arm)[1:])))
    yield Finding(
        "too stiff",
        f"{place.key}: the arm cannot turn to the goal {reached}within its length: it is {long_length(missing)} too "
        f"short, since a joint turns by {sharpest} at most",
        key=place.key,
        place=point(place.goal.position),
        measured=missing,
        allowed=0.0,
        bounds=_limits_that_reach(arm, place, direction),
    )


def _limits_that_reach(arm: Arm, place: NamedTipGoal, direction: FloatArray) -> dict[str, float]:
    """Return, by key, the least value of each arm parameter with which the arm reaches the goal along a direction (d,).

    Parameters that cannot remove the shortfall alone are left out.
    """

    def missing(changed: Arm) -> float:
        return float(TurnCaps(changed, place).missing(direction[None])[0])

    def least(changed: Callable[[float], Arm], low: float, high: float) -> float | None:
        if missing(changed(high)) > 0.0:
            return None
        return float(brentq(lambda value: missing(changed(value)), low, high, rtol=1e-6))

    found = {
        "arm.joint_limit_deg": least(lambda value: replace(arm, joint_limit=value), arm.joint_limit, np.pi),
        "arm.base_limit_deg": least(
            lambda value: replace(arm, base_limit=value), arm.base_limit, max(np.pi, arm.base_limit)
        ),
        "arm.link_length": least(
            lambda value: replace(arm, link_length=value), arm.link_length, 10.0 * arm.link_length
        ),
    }
    if arm.proportions is not None:
        found = {"arm.base_limit_deg": found["arm.base_limit_deg"]}
        for section in sections_of(arm):
            limits = arm.bend_limits.reshape(arm.links, -1)[max(section.first, 1) : section.end]
            given = {
                "link_length": float(arm.lengths[section.first]),
                "joint_limit_deg": float(np.max(limits, initial=0.0)),
            }
            for key, value in given.items():
                most = 10.0 if key == "link_length" else np.pi / max(value, 1e-300)
                factor = None
                if value > 0.0 and most > 1.0:
                    factor = least(partial(with_section, arm, section, key), 1.0, most)
                found[section.key(key)] = None if factor is None else factor * value
    return {key: value for key, value in found.items() if value is not None}
