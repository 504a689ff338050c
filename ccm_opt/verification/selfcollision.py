"""Clearance of the links from each other, at all times."""

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem.solution import Check, NearPlace
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import ChainMotion, TimeStretches, lengths_of
from ccm_opt.verification.consistency import UNIT, distance_rounding
from ccm_opt.verification.stretch_proof import (
    BLOCK,
    Measured,
    Nearest,
    Pairs,
    Verdict,
    least_allowed_gap,
    prove_stretches,
)
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def segment_distances(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return the distances between segments ab and cd; a segment may be a single point.

    The squared distance is convex in both shares: either it is least inside of both, or on an end of one of them.

    Args:
        a: shape (N, 2) or (N, 3) [m]; likewise b, c, d.
        b: other end of the first segments.
        c: one end of the second segments.
        d: other end of the second segments.

    Returns:
        Shape (N,) [m]; 0 where they cross in the plane.
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
        # They cross where their boxes meet too; of those in line, which are but near each other, these do not.
        low = np.maximum(np.minimum(a, b), np.minimum(c, d))
        high = np.minimum(np.maximum(a, b), np.maximum(c, d))
        least[meet & np.all(low <= high, axis=1)] = 0.0
        return np.asarray(np.sqrt(least))
    inside = np.flatnonzero(meet)
    between = offset[inside] + share[inside, None] * line[inside] - at[inside, None] * other[inside]
    least[inside] = np.minimum(least[inside], _dot(between, between))
    return np.asarray(np.sqrt(least))


def _from_segment(point: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the squared distances of points from segments, shape (N,) [m²]."""
    line = end - start
    away = point - start
    square = np.maximum(_dot(line, line), np.finfo(np.float64).tiny)
    away -= np.clip(_dot(away, line) / square, 0.0, 1.0)[:, None] * line
    return _dot(away, away)


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("pd,pd->p", first, second))


def _normal(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the cross products; in the plane their one component that is not zero, shape (N, 1)."""
    if first.shape[1] == 2:
        return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])[:, None]
    return np.cross(first, second)


def first_distant(arm: Arm) -> int:
    """Return the least j − i of links that must keep apart: the least d with (d − 1) l ≥ max(2 l, π r).

    ``Arm.first_self_pair`` says the same; the verifier counts for itself, on purpose.
    """
    # Links this near along the arm cannot help being near in space: two lengths of a link, or π r, the tightest half
    # turn that an arm of radius r can make.
    reach = max(2.0 * arm.link_length, np.pi * arm.radius)
    apart = 1
    # The factor keeps rounding from counting one link too many.
    while (apart - 1) * arm.link_length < reach * (1.0 - 1e-12):
        apart += 1
    return apart


def check_self_collision(motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION) -> Check:
    """Check that links far apart along the arm never touch, and in space that nearer ones do not cross.

    The gap is between their surfaces.
    """
    # Links of an arm in the plane that are near each other may fold past each other in depth.
    crossing = "" if motion.arm.dimension == 2 else crossing_near_links(motion, settings)
    verdict = nearest_links(motion, settings)
    if verdict is None:
        where = crossing or "the arm is too short to meet itself"
        return Check("self-collision", np.inf, 0.0, "m", where, passed=not crossing)
    near = verdict.nearest
    pair = f"link {near.link + 1} to link {near.other + 1} at t = {near.time:.4f} s"
    place = NearPlace(near.gap, 0.0, near.time, near.link + 1, second_link=near.other + 1)
    joined = ": " if motion.arm.dimension == 2 else "; "
    where = joined.join(part for part in (pair, verdict.remark, crossing) if part)
    passed = verdict.proved and not crossing
    return Check("self-collision", near.gap, 0.0, "m", where, passed=passed, place=place)


def nearest_links(motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION) -> Verdict | None:
    """Return whether distant links keep apart, with their nearest approach.

    None for an arm too short to meet itself.
    """
    arm = motion.arm
    if first_distant(arm) >= arm.links:
        return None
    proof = LinkProof(motion, 2.0 * arm.radius)
    return proof.prove(least_allowed_gap(0.0, proof.thickness, settings), settings)


class LinkProof:
    """Proves that the axes of pairs of links keep a gap beyond a thickness.

    Args:
        motion: of the arm.
        thickness: distance of axes that counts as no gap [m].
    """

    def __init__(self, motion: ChainMotion, thickness: float) -> None:
        self.motion = motion
        self.thickness = thickness
        # Both links are off by what their places are.
        self._lost = 2.0 * motion.rounding + distance_rounding(motion.size)

    def prove(self, least: float, settings: VerificationSettings, nearest: Nearest | None = None) -> Verdict:
        """Prove that all distant links keep a gap; arguments as for ``prove_stretches``."""
        first, second = np.triu_indices(self.motion.arm.links, first_distant(self.motion.arm))
        blocks = TimeStretches.blocks(len(self.motion.time), BLOCK)
        pairs = Pairs.in_all(len(blocks), first, second)
        return prove_stretches(self.motion, blocks, pairs, self.measure, least, settings, nearest=nearest)

    def measure(
        self, stretches: TimeStretches, poses: FloatArray, pairs: Pairs, cutoff: FloatArray | float
    ) -> Measured:
        """Return what is known of the gaps of pairs.

        Beyond the cutoff, one number or of shape (P,) [m], not exactly.
        """
        motion = self.motion
        k, i, j = pairs.stretch, pairs.link, pairs.other
        travels = motion.travels(stretches)
        travel = np.maximum(travels[k, i], travels[k, i + 1]) + np.maximum(travels[k, j], travels[k, j + 1])
        # Middles of links are at most half a link each from the places where the links are nearest.
        middles = 0.5 * (poses[:, 1:] + poses[:, :-1])
        most = lengths_of(middles[k, i] - middles[k, j])
        taken = self.thickness + self._lost + motion.off(stretches, k, i) + motion.off(stretches, k, j)
        low = most - motion.arm.link_length * (1.0 + 1e-9) - taken
        exact = low - travel < cutoff
        k, i, j = k[exact], i[exact], j[exact]
        most[exact] = segment_distances(poses[k, i], poses[k, i + 1], poses[k, j], poses[k, j + 1])
        low[exact] = (most - taken)[exact]
        travel[exact] = np.minimum(travel[exact], relative_travels(motion, stretches, travels, pairs.where(exact)))
        return Measured(low - travel, most - self.thickness, travel, exact)


def relative_travels(motion: ChainMotion, stretches: TimeStretches, travels: FloatArray, pairs: Pairs) -> FloatArray:
    """Return how much nearer two links may come than they are at the middle, shape (P,) [m].

    Within an interval what both do alike does not count. Seen in the frame of the first link, which leaves distances
    as they are, a joint k between turns what is beyond it by its own turn ψ_k alone: l Σ (j − k + 1) ψ_k.

    Args:
        motion: of the arm.
        stretches: of time.
        travels: how far each joint goes from the middle of each, shape (S, links + 1) [m].
        pairs: of links.
    """
    k, i, j = pairs.stretch, pairs.link, pairs.other
    relative = np.full(len(k), np.inf)
    within = np.flatnonzero((stretches.high - stretches.low)[k] <= 1.0)
    if len(within):
        chords = motion.poses(stretches.high) - motion.poses(stretches.low)
        bows = 2.0 * travels - lengths_of(chords)
        at, first, second = k[within], i[within], j[within]
        apart = np.zeros(len(within))
        for one in (first, first + 1):
            for other in (second, second + 1):
                chord = lengths_of(chords[at, one] - chords[at, other])
                apart = np.maximum(apart, 0.5 * (chord + bows[at, one] + bows[at, other]))
        relative[within] = apart
    return np.asarray(np.minimum(relative, travels_in_frame(motion, stretches, k, i, j)))


def travels_in_frame(
    motion: ChainMotion, stretches: TimeStretches, k: IntArray, i: IntArray, j: IntArray
) -> FloatArray:
    """How far links go from where they are at the middle as links nearer to the base see them at most, shape (P,) [m].

    Args:
        motion: of the arm.
        stretches: of time.
        k: numbers of the stretches, shape (P,).
        i: of the links nearer to the base.
        j: of the others.
    """
    arm = motion.arm
    turns = [motion.turned(at) for at in (stretches.low, stretches.middle, stretches.high)]
    turned = np.maximum(turns[1] - turns[0], turns[2] - turns[1])
    number = np.arange(1.0, arm.links + 1.0)
    plain = np.cumsum(turned, axis=1)
    weighted = np.cumsum(number * turned, axis=1)
    # Running sums lose digits when they are subtracted; what they can have lost is added to the bound.
    rounding = 8.0 * (arm.links + len(motion.time)) * UNIT * arm.links * turns[2].sum(axis=1)
    between = (j + 2.0) * (plain[k, j] - plain[k, i]) - (weighted[k, j] - weighted[k, i])
    return np.asarray(arm.link_length * (between + rounding[k]))


def link_gaps(arm: Arm, poses: FloatArray, reach: float) -> tuple[Pairs, FloatArray]:
    """Return the pairs of distant links that may have their surfaces within a reach of each other, and few others.

    Args:
        arm: the arm.
        poses: joint and tip positions, shape (N, links + 1, d) [m].
        reach: [m].

    Returns:
        The pairs, their stretches being the numbers of the poses, and the gaps between their surfaces, shape (P,) [m].
    """
    first, second = np.triu_indices(arm.links, first_distant(arm))
    middles = 0.5 * (poses[:, 1:] + poses[:, :-1])
    farthest = arm.link_length * (1.0 + 1e-9) + reach + 2.0 * arm.radius
    pose, number = np.nonzero(lengths_of(middles[:, first] - middles[:, second]) <= farthest)
    pairs = Pairs(pose, first[number], second[number])
    k, i, j = pairs.stretch, pairs.link, pairs.other
    gap = segment_distances(poses[k, i], poses[k, i + 1], poses[k, j], poses[k, j + 1]) - 2.0 * arm.radius
    return pairs, gap


def crossing_near_links(motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION) -> str:
    """Return where two links cross that share no joint and are too near along the arm to be kept apart.

    Empty if none do.

    Axes that meet close a polygon, which turns by 2 π at least (Fenchel), of which the bends between them are all but
    half a turn: where these add up to less than π nothing is to be proved. That is how it is almost always.

    Args:
        motion: of the arm.
        settings: with lengths in metres.

    Returns:
        The links and the time in words; where the proof is given up, that they may cross.
    """
    links = motion.arm.links
    bends = np.abs(motion.positions[:, motion.arm.coordinates.bends]).reshape(len(motion.time), links, -1).sum(axis=2)
    total = np.concatenate((np.zeros((len(bends), 1)), np.cumsum(bends, axis=1)), axis=1)
    found = [np.zeros((3, 0), dtype=np.intp)]
    for apart in range(2, min(first_distant(motion.arm), links)):
        between = total[:, 1 + apart :] - total[:, 1:-apart]
        # Sizes of bends are convex in time between samples, so that they are greatest at one of these.
        interval, link = np.nonzero(np.maximum(between[:-1], between[1:]) >= np.pi - settings.half_turn_rounding)
        found.append(np.stack((interval, link, link + apart)))
    interval, first, second = np.concatenate(found, axis=1)
    if len(interval) == 0:
        return ""
    kept, stretch = np.unique(interval, return_inverse=True)
    stretches = TimeStretches(kept.astype(np.float64), kept + 1.0)
    measure = LinkProof(motion, 0.0).measure
    verdict = prove_stretches(motion, stretches, Pairs(stretch, first, second), measure, settings.touch, settings)
    if verdict.proved:
        return ""
    near = verdict.nearest
    does = "may cross" if verdict.remark else "crosses"
    return f"link {near.link + 1} {does} link {near.other + 1} at t = {near.time:.4f} s"
