"""Checks between links."""

import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.problem.solution import Check, NearPlace
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

from .gap_proof import Evaluate, Nearest, Pairs, Verdict, least_allowed_gap, prove_apart
from .link_motion import ChainMotion, Nodes
from .rounding import UNIT, distance_rounding

_PAIR_PROBES = 24
"""Poses at which all pairs of links are measured first, likewise. Heuristic."""

CHUNK = 65_536
"""Pairs handled at a time, so that the intermediate arrays stay in the processor's cache."""


def segment_distances(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Distances between segments ab and cd; a segment may be a single point.

    Two segments of the plane either cross or are nearest at an end of one of them (Ericson, Real-Time
    Collision Detection, section 5.1.9).

    Args:
        a: shape (N, 2) [m]; likewise b, c, d.
        b: other end of the first segments.
        c: one end of the second segments.
        d: other end of the second segments.

    Returns:
        Shape (N,) [m]; 0 where they cross.
    """
    parts = [
        _chunk_distances(a[k : k + CHUNK], b[k : k + CHUNK], c[k : k + CHUNK], d[k : k + CHUNK])
        for k in range(0, len(a), CHUNK)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _chunk_distances(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    least = _end_to_segment(a, c, d)
    np.minimum(least, _end_to_segment(b, c, d), out=least)
    np.minimum(least, _end_to_segment(c, a, b), out=least)
    np.minimum(least, _end_to_segment(d, a, b), out=least)
    # Segments that cross have ends that may all be far away, so crossing is asked for apart.
    return np.where(_cross(a, b, c, d), 0.0, np.sqrt(least))


def _end_to_segment(p: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Squared distance from points to segments."""
    ux = b[:, 0] - a[:, 0]
    uy = b[:, 1] - a[:, 1]
    wx = p[:, 0] - a[:, 0]
    wy = p[:, 1] - a[:, 1]
    # The least positive number stands in for the squared length of a segment that is a point.
    t = np.clip((wx * ux + wy * uy) / np.maximum(ux * ux + uy * uy, np.finfo(np.float64).tiny), 0.0, 1.0)
    # From the foot of the perpendicular, or the nearer end, to the point.
    wx -= t * ux
    wy -= t * uy
    return np.asarray(wx * wx + wy * wy)


def _cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Whether the segments cross in their interiors; a mere touch shows in the end distances."""
    # The ends of each segment lie on opposite sides of the other one.
    opposite = (_side(a, b, c) * _side(a, b, d) < 0.0) & (_side(c, d, a) * _side(c, d, b) < 0.0)
    return np.asarray(opposite & _boxes_meet(a, b, c, d))


def _boxes_meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> BoolArray:
    """Whether the boxes around the segments meet; those of collinear ones, whose sides are but rounding, do not."""
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    return np.asarray(np.all(low <= high, axis=1))


def _side(a: FloatArray, b: FloatArray, p: FloatArray) -> FloatArray:
    return np.asarray(
        (b[:, 0] - a[:, 0]) * (p[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (p[:, 0] - a[:, 0]),
    )


def min_index_gap(arm: Arm) -> int:
    """Least j − i of links that must keep apart: the least d with (d − 1) l ≥ max(2 l, π r).

    ``Arm.distant_links`` says the same; the verifier counts for itself, on purpose.
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
    """Check that links far apart along the arm never touch; the gap is between their surfaces."""
    verdict = nearest_links(motion, settings)
    if verdict is None:
        return Check("self-collision", np.inf, 0.0, "m", "the arm is too short to meet itself", passed=True)
    near = verdict.nearest
    where = f"link {near.link + 1} to link {near.other + 1} at t = {near.time:.4f} s"
    where = f"{where}: {verdict.remark}" if verdict.remark else where
    place = NearPlace(near.gap, 0.0, near.time, near.link + 1, second_link=near.other + 1)
    return Check("self-collision", near.gap, 0.0, "m", where, passed=verdict.proved, place=place)


def nearest_links(motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION) -> Verdict | None:
    """Whether distant links keep apart, with their nearest approach; None for an arm too short to meet itself."""
    return None if min_index_gap(motion.arm) >= motion.arm.links else _prove(motion, settings)


def _prove(motion: ChainMotion, settings: VerificationSettings) -> Verdict:
    arm = motion.arm
    thickness = 2.0 * arm.radius
    least = least_allowed_gap(0.0, thickness, settings)

    # Both links are off by what their places are.
    lost = 2.0 * motion.rounding + distance_rounding(motion.size)

    def evaluate(nodes: Nodes, pairs: Pairs, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        k = pairs.node
        i = pairs.link
        j = pairs.other
        interval = nodes.interval[k]
        off = motion.off[interval, i] + motion.off[interval, j]
        travel = nodes.half[k] * relative_travel(motion, interval, i, j)
        return self_distances(arm, poses, pairs) - off - lost, travel

    nodes = motion.whole
    nearest = _probe(motion, evaluate, nodes, _PAIR_PROBES)
    # Links that are farther apart than this at the middle of an interval come no nearer than the nearest known pair.
    look = thickness + max(least, min(nearest.gap, arm.link_length)) + 2.0 * (lost + float(np.max(motion.off)))
    # To the ends of an interval, half of it away, the links between the two turn by half of what they turn in all.
    pairs = _candidates(arm, motion.poses(nodes), 0.5 * motion.turned, look)
    return prove_apart(motion, pairs, evaluate, least, nearest, settings)


def relative_travel(motion: ChainMotion, k: np.ndarray, i: np.ndarray, j: np.ndarray) -> FloatArray:
    """Bound on how far points of link j move, seen from link i, over the interval's length [m].

    Seen in world axes only the links i to j turn: l Σ_{k=i..j} |Δφ_k|. Seen in the frame of link i, which leaves
    distances as they are, link k has turned by the bends between: l Σ_{k=i+1..j} (j − k + 1) |Δb_k|. Take the less.
    """
    turned = motion.turned[k, j + 1] - motion.turned[k, i]
    bent = motion.bent[k, j + 1] - motion.bent[k, i + 1]
    # Σ (j − k + 1) |Δb_k| by two running sums: (j + 2) Σ |Δb_k| − Σ (k + 1) |Δb_k|, as joints count from 1 in the
    # weights and from 0 in the sum.
    weighted = motion.bent_weighted[k, j + 1] - motion.bent_weighted[k, i + 1]
    # Running sums lose digits when they are subtracted; what they can have lost is added to the bound.
    count = motion.arm.links + 2
    rounding = 4.0 * count * UNIT * (count * motion.bent[k, -1] + motion.bent_weighted[k, -1])
    return np.asarray(motion.arm.link_length * (np.minimum(turned, (j + 2) * bent - weighted) + rounding))


def self_distances(arm: Arm, poses: FloatArray, pairs: Pairs) -> FloatArray:
    """Gaps between the surfaces of pairs of links, shape (P,) [m]."""
    k = pairs.node
    i = pairs.link
    j = pairs.other
    distance = segment_distances(poses[k, i], poses[k, i + 1], poses[k, j], poses[k, j + 1])
    return np.asarray(distance - 2.0 * arm.radius)


def _candidates(arm: Arm, poses: FloatArray, turned: FloatArray, look: float) -> Pairs:
    """Pairs whose links' middles are near enough for the pair to matter around a pose.

    Args:
        arm: with distant links.
        poses: joint and tip positions, shape (N, links + 1, 2) [m].
        turned: running sum of what the links turn around a pose, shape (N, links + 1) [rad].
        look: distance of two axes that matters [m].
    """
    middles = 0.5 * (poses[:, 1:] + poses[:, :-1])
    x = np.ascontiguousarray(middles[..., 0])
    y = np.ascontiguousarray(middles[..., 1])
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for apart in range(min_index_gap(arm), arm.links):
        dx = x[:, apart:] - x[:, :-apart]
        dy = y[:, apart:] - y[:, :-apart]
        travel = arm.link_length * (turned[:, apart + 1 :] - turned[:, : -apart - 1])
        # Middles of links are at most half a link each from the places where the links are nearest.
        reach = arm.link_length * (1.0 + 1e-9) + look + travel
        node, first = np.nonzero(dx * dx + dy * dy <= reach * reach)
        found.append((node, first, first + apart))
    node, first, second = (np.concatenate(column) for column in zip(*found, strict=True))
    return Pairs(node, first, second)


def _probe(motion: ChainMotion, evaluate: Evaluate, nodes: Nodes, probes: int) -> Nearest:
    """The nearest pair at a few poses spread over the motion: no proof, but a bound on the least gap."""
    # All pairs at a few poses, rather than a few pairs at all poses: any of them may be the nearest.
    first, second = np.triu_indices(motion.arm.links, min_index_gap(motion.arm))
    chosen = np.unique(np.linspace(0, len(nodes) - 1, min(probes, len(nodes))).astype(int))
    few = nodes.take(chosen)
    count = len(first)
    pairs = Pairs(np.repeat(np.arange(len(few)), count), np.tile(first, len(few)), np.tile(second, len(few)))
    gap, _ = evaluate(few, pairs, motion.poses(few))
    best = int(np.argmin(gap))
    return Nearest(
        float(gap[best]), int(pairs.link[best]), int(pairs.other[best]), motion.when(few, int(pairs.node[best]))
    )
