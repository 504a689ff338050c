"""Checks that the links of an arm stay clear of each other at all times."""

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.problem.solution import Check, NearPlace
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.tool import ToolLinks
from ccm_opt.verification.base_motion import lengths_of
from ccm_opt.verification.chain_motion import ChainMotion, TimeIntervals
from ccm_opt.verification.consistency import UNIT, distance_rounding
from ccm_opt.verification.drives import section_of
from ccm_opt.verification.gap_proof import (
    BLOCK,
    Measured,
    Nearest,
    Pairs,
    Verdict,
    least_allowed_gap,
    prove_gaps,
)
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def segment_distances(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return the distances between N segments ab and N segments cd; a segment may be a single point.

    The squared distance is convex in the positions along both segments, so its minimum is either inside both segments
    or at an end of one of them.

    Args:
        a: starts of the first segments, shape (N, 2) or (N, 3) [m].
        b: ends of the first segments, shape as for `a` [m].
        c: starts of the second segments, shape as for `a` [m].
        d: ends of the second segments, shape as for `a` [m].

    Returns:
        The distances, shape (N,) [m]; 0 for segments that cross in the plane.
    """
    ends = ((a, c, d), (b, c, d), (c, a, b), (d, a, b))
    least = np.min([_from_segment(point, start, end) for point, start, end in ends], axis=0)
    line = b - a
    other = d - c
    offset = a - c
    normal = _normal(line, other)
    square = _dot(normal, normal)
    safe = np.where(square > 0.0, square, 1.0)
    share = -_dot(_normal(offset, other), normal) / safe
    at = -_dot(_normal(offset, line), normal) / safe
    meet = (square > 0.0) & (share >= 0.0) & (share <= 1.0) & (at >= 0.0) & (at <= 1.0)
    if a.shape[1] == 2:
        # Crossing segments also have overlapping bounding boxes, unlike collinear ones that are merely close.
        low = np.maximum(np.minimum(a, b), np.minimum(c, d))
        high = np.minimum(np.maximum(a, b), np.maximum(c, d))
        least[meet & np.all(low <= high, axis=1)] = 0.0
        return np.asarray(np.sqrt(least))
    inside = np.flatnonzero(meet)
    between = offset[inside] + share[inside, None] * line[inside] - at[inside, None] * other[inside]
    least[inside] = np.minimum(least[inside], _dot(between, between))
    return np.asarray(np.sqrt(least))


def _from_segment(point: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the squared distances of N points from one segment each, shape (N,) [m²]."""
    line = end - start
    away = point - start
    square = np.maximum(_dot(line, line), np.finfo(np.float64).tiny)
    away -= np.clip(_dot(away, line) / square, 0.0, 1.0)[:, None] * line
    return _dot(away, away)


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("pd,pd->p", first, second))


def _normal(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the cross products of N pairs of vectors, shape (N, 3); in the plane, their z components, shape (N, 1)."""
    if first.shape[1] == 2:
        return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])[:, None]
    return np.cross(first, second)


def far_along_arm(arm: Arm) -> BoolArray:
    """Return a mask of the pairs of links i < j that must stay apart, shape (links, links).

    At least two links, of a total length of at least π r, lie between the two; r is the greatest radius from link i to
    link j. ``Arm.distant_links`` implements the same rule; the verifier deliberately does not use it.
    """
    if arm.tool_links is not None:
        return arm.tool_links.distant
    # Links closer along the arm than two links, or than π r, the tightest half turn of an arm of radius r, are
    # unavoidably close in space.
    starts = np.concatenate(([0.0], np.cumsum(arm.lengths)))
    far = np.zeros((arm.links, arm.links), dtype=bool)
    thickest = np.array(arm.radii)  # from each link to the one that lies `apart` links beyond it
    for apart in range(1, arm.links):
        thickest = np.maximum(thickest[:-1], arm.radii[apart:])
        if apart > 2:
            # The small number keeps rounding from counting one link too few.
            between = starts[apart:-1] - starts[1:-apart] + 1e-9 * arm.link_length
            np.fill_diagonal(far[:, apart:], between >= np.pi * thickest)
    return far


def link_number(arm: Arm, link: int) -> int:
    """Return the number of a link, from 1; for a part of a body that of the link that carries it."""
    return link + 1 if arm.tool_links is None else int(arm.tool_links.carriers[link]) + 1


def link_word(arm: Arm, link: int) -> str:
    """Return the name of a link in messages, which for a part of a body is that of the body."""
    name = "" if arm.tool_links is None else arm.tool_links.names[link]
    return name or section_of(arm, link) or f"link {link_number(arm, link)}"


def distant_pairs(arm: Arm) -> tuple[IntArray, IntArray]:
    """Return the first and second links of all pairs that are far enough apart along the arm to collide, each (P,)."""
    first, second = np.nonzero(far_along_arm(arm))
    return first, second


def check_self_collision(motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION) -> Check:
    """Check that links far apart along the arm never touch and, in space, that links nearer along the arm do not cross.

    The worst value is the least gap between the surfaces of links far apart along the arm [m].
    """
    # In the plane, neighbouring links may fold past each other in depth.
    crossing = "" if motion.arm.dimension == 2 else crossing_near_links(motion, settings)
    verdict = nearest_links(motion, settings)
    if verdict is None:
        where = crossing or "the arm is too short to meet itself"
        return Check("self-collision", np.inf, 0.0, "m", where, passed=not crossing)
    near = verdict.nearest
    arm = motion.arm
    place = NearPlace(
        near.gap,
        0.0,
        near.time,
        link_number(arm, near.link),
        second_link=link_number(arm, near.other),
        name=link_word(arm, near.link),
        second_name=link_word(arm, near.other),
    )
    pair = f"{place.pair} at t = {near.time:.4f} s"
    joined = ": " if motion.arm.dimension == 2 else "; "
    where = joined.join(part for part in (pair, verdict.remark, crossing) if part)
    passed = verdict.proved and not crossing
    return Check("self-collision", near.gap, 0.0, "m", where, passed=passed, place=place)


def nearest_links(motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION) -> Verdict | None:
    """Return the verdict on whether links far apart along the arm stay clear; None if the arm has no such links."""
    arm = motion.arm
    if len(distant_pairs(arm)[0]) == 0:
        return None
    thinnest = 2.0 * arm.thinnest
    return LinkProof(motion, arm.radii).prove(least_allowed_gap(0.0, thinnest, settings), settings)


class LinkProof:
    """A proof, for all times of a motion, that links of given radii keep a gap.

    Args:
        motion: motion of the arm.
        radii: radius of each link, shape (links,) [m].
    """

    def __init__(self, motion: ChainMotion, radii: FloatArray) -> None:
        self.motion = motion
        self.radii = radii
        # The positions of both links are subject to rounding.
        self._length_loss = 2.0 * motion.rounding + distance_rounding(motion.size)

    def prove(self, least: float, settings: VerificationSettings, nearest: Nearest | None = None) -> Verdict:
        """Prove a gap of at least ``least`` [m] between links far apart along the arm; see ``prove_gaps``."""
        first, second = distant_pairs(self.motion.arm)
        blocks = TimeIntervals.blocks(len(self.motion.time), BLOCK)
        pairs = Pairs.in_all(len(blocks), first, second)
        return prove_gaps(self.motion, blocks, pairs, self.measure, least, settings, nearest=nearest)

    def measure(
        self, intervals: TimeIntervals, poses: FloatArray, pairs: Pairs, cutoff: FloatArray | float
    ) -> Measured:
        """Return bounds on the gaps of P pairs of links over time intervals.

        Args:
            intervals: S time intervals.
            poses: positions of joints and tip at mid-interval, shape (S, links + 1, d) [m].
            pairs: the pairs of links, each with its time interval.
            cutoff: gap above which bounds may be rough; a number or of shape (P,) [m].
        """
        motion = self.motion
        k, i, j = pairs.interval, pairs.link, pairs.other
        travels = motion.travels(intervals)
        travel = np.maximum(travels[k, i], travels[k, i + 1]) + np.maximum(travels[k, j], travels[k, j + 1])
        # The nearest points of two links are each at most half a link from the midpoint.
        middles = 0.5 * (poses[:, 1:] + poses[:, :-1])
        most = lengths_of(middles[k, i] - middles[k, j])
        thick = self.radii.take(i) + self.radii.take(j)
        taken = (
            thick
            + self._length_loss
            + motion.deviation_bounds(intervals, k, i)
            + motion.deviation_bounds(intervals, k, j)
        )
        lengths = motion.longest_links
        low = most - 0.5 * (lengths.take(i) + lengths.take(j)) * (1.0 + 1e-9) - taken
        exact = low - travel < cutoff
        k, i, j = k[exact], i[exact], j[exact]
        most[exact] = segment_distances(poses[k, i], poses[k, i + 1], poses[k, j], poses[k, j + 1])
        low[exact] = (most - taken)[exact]
        travel[exact] = np.minimum(travel[exact], relative_travels(motion, intervals, travels, pairs.where(exact)))
        return Measured(low - travel, most - thick, travel, exact)


def relative_travels(motion: ChainMotion, intervals: TimeIntervals, travels: FloatArray, pairs: Pairs) -> FloatArray:
    """Return upper bounds on how much the distances of P link pairs fall below those at mid-interval, shape (P,) [m].

    Within a step, motion common to both links does not count. In the frame of the first link, which preserves
    distances, each joint k between the links only adds its own rotation ψ_k, times the length of the arm from there to
    the end of the second link.

    Args:
        motion: motion of the arm.
        intervals: S time intervals.
        travels: bounds on the distances of joints and tip from their mid-interval positions, shape (S, links + 1) [m].
        pairs: the P pairs of links, each with its time interval.
    """
    k, i, j = pairs.interval, pairs.link, pairs.other
    relative = np.full(len(k), np.inf)
    within = np.flatnonzero((intervals.high - intervals.low)[k] <= 1.0)
    if len(within):
        chords = motion.poses(intervals.high) - motion.poses(intervals.low)
        arc_excess = 2.0 * travels - lengths_of(chords)
        at, first, second = k[within], i[within], j[within]
        apart = np.zeros(len(within))
        for one in (first, first + 1):
            for other in (second, second + 1):
                chord = lengths_of(chords[at, one] - chords[at, other])
                apart = np.maximum(apart, 0.5 * (chord + arc_excess[at, one] + arc_excess[at, other]))
        relative[within] = apart
    return np.asarray(np.minimum(relative, travels_in_frame(motion, intervals, k, i, j)))


def travels_in_frame(
    motion: ChainMotion, intervals: TimeIntervals, k: IntArray, i: IntArray, j: IntArray
) -> FloatArray:
    """Return bounds on the travel of links from mid-interval in the frames of links nearer to the base, (P,) [m].

    Args:
        motion: motion of the arm.
        intervals: S time intervals.
        k: indices of the time intervals, shape (P,).
        i: indices of the links nearer to the base, shape (P,).
        j: indices of the moving links, shape (P,).
    """
    arm = motion.arm
    turns = [motion.turned(at) for at in (intervals.low, intervals.middle, intervals.high)]
    turned = np.maximum(turns[1] - turns[0], turns[2] - turns[1])
    # Arc lengths in mean lengths of links.
    place = np.concatenate(([0.0], np.cumsum(motion.longest_links / arm.link_length)))
    number = place[:-1] + 1.0
    plain = np.cumsum(turned, axis=1)
    weighted = np.cumsum(number * turned, axis=1)
    # Subtracting cumulative sums loses digits, so the bound includes the possible rounding error.
    rounding = 8.0 * (arm.links + len(motion.time)) * UNIT * arm.links * turns[2].sum(axis=1)
    between = (place[j + 1] + 1.0) * (plain[k, j] - plain[k, i]) - (weighted[k, j] - weighted[k, i])
    travels = arm.link_length * (between + rounding[k])
    if arm.sections is not None:
        # Joints i to j + 1 also change the lengths of links i to j, each of two links, which moves both links.
        grown = np.concatenate((np.zeros((len(turned), 1)), np.cumsum(motion.leg_rates * turned, axis=1)), axis=1)
        travels = travels + 4.0 * (grown[k, np.minimum(j + 2, arm.links)] - grown[k, i]) * (1.0 + 1e-9)
    return np.asarray(travels)


def link_gaps(arm: Arm, poses: FloatArray, reach: float) -> tuple[Pairs, FloatArray]:
    """Return all pairs of links far apart along the arm whose gap is at most `reach`, with their gaps.

    Some pairs with larger gaps are among them, since the search compares only midpoints.

    Args:
        arm: the arm.
        poses: positions of joints and tip in N poses, shape (N, links + 1, d) [m].
        reach: largest gap of interest [m].

    Returns:
        The P pairs, with indices of poses instead of time intervals, and the gaps between their surfaces, shape (P,)
        [m].
    """
    first, second = distant_pairs(arm)
    middles = 0.5 * (poses[:, 1:] + poses[:, :-1])
    farthest = float(np.max(lengths_of(np.diff(poses, axis=1)), initial=0.0)) * (1.0 + 1e-9) + reach + 2.0 * arm.radius
    pose, number = np.nonzero(lengths_of(middles[:, first] - middles[:, second]) <= farthest)
    pairs = Pairs(pose, first[number], second[number])
    k, i, j = pairs.interval, pairs.link, pairs.other
    gap = segment_distances(poses[k, i], poses[k, i + 1], poses[k, j], poses[k, j + 1])
    gap -= arm.radii.take(i) + arm.radii.take(j)
    return pairs, gap


def _turns_of_bodies(arm: Arm, bodies: ToolLinks) -> FloatArray:
    """Return bounds on the constant turns from a link to each part of a body on it, and from there on to the next link.

    Both are 0 for the arm's own links, between which the parts of bodies are left out of a polygon; shape (2, links).
    """
    turns = np.abs(bodies.turns) if arm.dimension == 2 else np.arccos(np.clip(bodies.turns[:, 0, 0], -1.0, 1.0))
    into, on = np.zeros((2, arm.links))
    for link in range(1, arm.links):
        if not bodies.own[link]:
            into[link] = into[link - 1] + turns[link]
    for link in range(arm.links - 2, 0, -1):
        if not bodies.own[link]:
            on[link] = on[link + 1] + turns[link + 1]
    return np.stack((into, on))


def crossing_near_links(motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION) -> str:
    """Return a description of two links, near each other along the arm, that cross; empty if none do.

    Such links share no joint but are too close along the arm to be checked for distance. If their axes meet, they close
    a polygon, whose total turning is at least 2 π (Fenchel); all but π of it comes from the bends between them. Where
    these bends sum to less than π, which is almost always, nothing needs to be proved.

    Args:
        motion: motion of the arm.
        settings: settings of the verifier, with lengths in metres.

    Returns:
        A description of the links and the time, or a remark that the links may cross if the proof was given up.
    """
    links = motion.arm.links
    bends = np.abs(motion.positions[:, motion.arm.coordinates.bends]).reshape(len(motion.time), links, -1).sum(axis=2)
    bare, carrier = np.zeros(links, dtype=bool), np.arange(links)
    fixed = np.zeros((2, links))
    if (bodies := motion.arm.tool_links) is not None:
        bare, carrier = bodies.bare, bodies.carriers
        fixed = _turns_of_bodies(motion.arm, bodies)
    total = np.concatenate((np.zeros((len(bends), 1)), np.cumsum(bends, axis=1)), axis=1)
    found = [np.zeros((3, 0), dtype=np.intp)]
    far = far_along_arm(motion.arm)
    for apart in range(2, links):
        if np.diagonal(far, apart).all():
            continue
        between = total[:, 1 + apart :] - total[:, 1:-apart] + (fixed[0, apart:] + fixed[1, :-apart])
        # Magnitudes of bends are convex in time between samples, so their maximum is at a sample.
        interval, link = np.nonzero(np.maximum(between[:-1], between[1:]) >= np.pi - settings.half_turn_rounding)
        # What is fixed to one link does not move against it.
        moves = carrier[link] != carrier[link + apart]
        close = moves & ~(far[link, link + apart] | bare[link] | bare[link + apart])
        interval, link = interval[close], link[close]
        found.append(np.stack((interval, link, link + apart)))
    interval, first, second = np.concatenate(found, axis=1)
    if len(interval) == 0:
        return ""
    kept, number = np.unique(interval, return_inverse=True)
    intervals = TimeIntervals(kept.astype(np.float64), kept + 1.0)
    measure = LinkProof(motion, np.zeros(links)).measure
    verdict = prove_gaps(motion, intervals, Pairs(number, first, second), measure, settings.touch, settings)
    if verdict.proved:
        return ""
    near = verdict.nearest
    does = "may cross" if verdict.remark else "crosses"
    return f"{link_word(motion.arm, near.link)} {does} {link_word(motion.arm, near.other)} at t = {near.time:.4f} s"
