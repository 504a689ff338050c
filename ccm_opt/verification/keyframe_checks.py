"""Whether the keyframes that are reported with a motion belong to it, and the curves that are reported with them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

_KEYFRAME_SHARE = 1.0 / 3.0
"""Share of the second difference of its keyframes by which a motion may pass one of them. Derived: twice the sixth of a
uniform cubic B-spline; 0.23 was seen beside clamped ends."""
_CLAMPED_SHARE = 0.0225
"""Share of the second difference of the third keyframe by which a motion may pass the second one besides, and likewise
at the end. Derived: twice t³ / 6 at t = 0.407, where a clamped uniform cubic B-spline of even steps passes its second
control point."""
_CURVE_MATCH = 1e-6
"""Difference of a reported curve from that of its keyframe, as a share of the greatest curvature, that is rounding.
Derived: a least-squares fit of some twenty numbers keeps some ten digits."""
_FOLLOWED_CURVE = 0.05
"""Difference of a link's heading from that of a curve that was planned first [rad]. Taste: the paper's planner samples
headings, and was seen to miss 0.02 in segments that it has nearly shrunk away."""

_FEW = 64
"""Pieces of a motion that are looked at first for the next keyframe."""


def check_keyframes(
    arm: Arm,
    trajectory: JointTrajectory,
    keyframes: FloatArray,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> Check:
    """Check that a motion passes its keyframes in order, and ends at the last of them.

    A uniform cubic B-spline with the keyframes as control points passes each at a sixth of its second difference; near
    the ends, where knots are clamped, at a little more, and once its legs are halved at less.

    Args:
        arm: the arm.
        trajectory: the motion.
        keyframes: of all coordinates, shape (K, c) [rad, m].
        settings: of the verifier.
    """
    name = "keyframes against motion"
    if len(keyframes) == 0:
        return Check(name, np.inf, 0.0, "rad", "there are none", passed=False)
    # On the axes that carry the base a link's length counts like a radian.
    scale = np.where(np.arange(keyframes.shape[1]) < arm.coordinates.joints, 1.0, 1.0 / arm.link_length)
    wanted = keyframes * scale
    allowed = np.full(len(wanted), settings.start_tolerance)
    bent = np.linalg.norm(wanted[2:] - 2.0 * wanted[1:-1] + wanted[:-2], axis=1)
    allowed[1:-1] += _KEYFRAME_SHARE * bent
    if len(bent) > 1:
        # Beside a clamped end the fourth control point, and with it what the third bends, counts by t³ / 6, and a path
        # of even steps is beside the second at t = 0.42.
        allowed[[1, -2]] += _CLAMPED_SHARE * bent[[1, -2]]
    path = _Chain(trajectory.positions * scale)
    # A motion that was given a new goal on its way has keyframes from the stop on alone.
    rests = (0, *trajectory.stops)
    piece = min(rests, key=lambda rest: float(np.linalg.norm(path.points[rest] - wanted[0])))
    worst = (0.0, 1.0, "")
    for number, (keyframe, most) in enumerate(zip(wanted, allowed.tolist(), strict=True), start=1):
        found, least = path.first_near(keyframe, piece if number < len(wanted) else len(path.points) - 2, most)
        # The first piece that is near enough leaves most of the motion to the keyframes that follow.
        piece = found if least <= most else piece
        worst = max(worst, (least, most, f"keyframe {number}"), key=lambda met: met[0] / met[1])
    return Check(name, worst[0], worst[1], "rad", worst[2], passed=worst[0] <= worst[1])


@dataclass(frozen=True)
class _Chain:
    """Straight pieces through points, shape (T, c)."""

    points: FloatArray

    @cached_property
    def _pieces(self) -> tuple[FloatArray, FloatArray]:
        """The pieces, shape (T − 1, c), and the squares of their lengths."""
        pieces = np.diff(self.points, axis=0)
        return pieces, np.maximum(np.einsum("tc,tc->t", pieces, pieces), np.finfo(np.float64).tiny)

    def first_near(self, point: FloatArray, first: int, most: float) -> tuple[int, float]:
        """The first piece, from one of them on, that is no farther from a point than so much, and how far it is.

        Where there is none it is the nearest of these pieces.
        """
        nearest = (first, np.inf)
        count = _FEW
        while first < len(self.points) - 1:
            away = self._distances(point, slice(first, first + count))
            near = np.flatnonzero(away <= most)
            k = int(near[0] if len(near) else np.argmin(away))
            if away[k] < nearest[1]:
                nearest = (first + k, float(away[k]))
            if len(near):
                break
            first += count
            # Most keyframes are passed soon after the one before.
            count *= 2
        return nearest

    def _distances(self, point: FloatArray, some: slice) -> FloatArray:
        """Distances of a point from some pieces, shape (n,)."""
        pieces, squares = (values[some] for values in self._pieces)
        away = point - self.points[:-1][some]
        along = np.clip(np.einsum("tc,tc->t", away, pieces) / squares, 0.0, 1.0)
        return np.asarray(np.linalg.norm(away - along[:, None] * pieces, axis=1))


def check_nearest_curves(curves: Sequence[Configuration], wanted: Sequence[Configuration]) -> Check:
    """Check that curves are those which come nearest to the keyframes.

    Args:
        curves: behind the keyframes, as they are reported.
        wanted: the same made from the keyframes.

    Returns:
        The check; its worst value is a share of the greatest curvature, or of a radian.
    """
    name = "curves against keyframes"
    if [len(curve.segments) for curve in curves] != [len(curve.segments) for curve in wanted]:
        return Check(name, np.inf, 0.0, "", f"{len(curves)} curves for {len(wanted)} keyframes", passed=False)
    steepest = max(float(np.max(np.abs(part.curvature))) for curve in wanted for part in curve.segments)
    # A straight curve has no size of its own; half a turn over the arm stands for it.
    size = max(steepest, np.pi / wanted[0].length)
    errors = [_difference(ours, theirs, size) for ours, theirs in zip(curves, wanted, strict=True)]
    k = int(np.argmax(errors))
    passed = errors[k] <= _CURVE_MATCH
    return Check(name, errors[k], _CURVE_MATCH, "", f"curve {k + 1}", passed=passed)


def check_followed_curves(arm: Arm, curves: Sequence[Configuration], keyframes: FloatArray) -> Check:
    """Check that an arm follows its curves, where these were planned first.

    Headings of links are the mean headings of their curve, and what the start's mapping adds to them all along.

    Args:
        arm: the arm.
        curves: behind the keyframes, as they are reported.
        keyframes: of all coordinates, shape (K, c) [rad, m].
    """
    name = "curves against keyframes"
    if len(curves) != len(keyframes):
        return Check(name, np.inf, 0.0, "rad", f"{len(curves)} curves for {len(keyframes)} keyframes", passed=False)
    headings = arm.base_heading + np.cumsum(keyframes[:, arm.coordinates.bends], axis=1)
    added = headings - np.array([_mean_headings(arm, curve) for curve in curves])
    errors = np.max(np.abs(added - added[0]), axis=1)
    k = int(np.argmax(errors))
    worst = float(errors[k])
    return Check(name, worst, _FOLLOWED_CURVE, "rad", f"curve {k + 1}", passed=worst <= _FOLLOWED_CURVE)


def _mean_headings(arm: Arm, curve: Configuration) -> FloatArray:
    """Mean headings of a curve over the arm's links, shape (links,) [rad]."""
    of_links = np.linspace(0.0, curve.length, arm.links + 1)
    ends = np.union1d(curve.breakpoints, of_links)
    # Between breakpoints headings are quartics, which three Gauss points integrate exactly.
    nodes, weights = np.polynomial.legendre.leggauss(3)
    half = 0.5 * np.diff(ends)
    middle = ends[:-1] + half
    headings = curve.heading_at((middle[:, None] + half[:, None] * nodes).ravel()).reshape(-1, 3)
    turned = np.concatenate(([0.0], np.cumsum(half * (headings @ weights))))
    return np.asarray(np.diff(np.interp(of_links, ends, turned)) / np.diff(of_links))


def _difference(ours: Configuration, theirs: Configuration, size: float) -> float:
    """The greatest difference of headings at the base [rad], and of curvatures, lengths and knots as shares."""
    found = [abs(ours.base_heading - theirs.base_heading)]
    for part, other in zip(ours.segments, theirs.segments, strict=True):
        found.append(float(np.max(np.abs(part.curvature - other.curvature))) / size)
        found.append(abs(part.length - other.length) / other.length)
        found.append(float(np.max(np.abs(np.subtract(part.knots, other.knots)))))
    return max(found)
