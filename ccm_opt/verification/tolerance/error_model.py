"""Models of geometric errors of joints, links, base and walls, and bounds on the displacements that such errors cause.

Errors are applied joint by joint from the base: the part of the arm beyond a joint is rotated about it as a whole, in
its error-free shape. A point P thus moves by at most Σ ψ_i |P − P_i| over the joints i between base and P, where ψ_i is
the rotation of joint i. In the plane, ψ is the error δ of the bend. In space, a joint whose two bends are off by at
most δ rotates by ψ = 2 acos(cos² ½ δ) ≤ √2 δ about some axis, since its two axes are perpendicular. The sum is convex
in P, so its maximum over a link is at one of the link's ends.

Along a single direction n, a point moves less. A product of rotations differs from the identity plus their sum by at
most half the square of the sum of their angles, so with the link vectors t_k, each rotated by the joints up to k,

    n · (P' − P)  ≤  Σ ψ_i |n × (P − P_i)|  +  ½ Σ_k |t_k| (Σ_{i ≤ k} ψ_i)².

A link is separated from an edge, a triangle or another link by a plane with any normal n if the ends of the link stay
on one side and the corners of the other body on the other. Either body may be regarded as the one that errors move,
since only relative motion matters.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem.solution import Check, ToleratedError
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.base_motion import lengths_of
from ccm_opt.verification.gap_proof import Pairs

ErrorName = Literal["joints", "base heading", "link lengths", "base position", "walls"]


@dataclass(frozen=True)
class ErrorModel:
    """Magnitudes of the errors of each part of the arm, per unit of the error under study.

    Attributes:
        name: kind of the error.
        unit: unit of the error, "rad" or "m".
        turns: errors of the base heading and of every joint, shape (links + 1,) [rad per unit].
        elongation: error of the length of every link [m per unit].
        shift: displacement of the whole arm relative to the walls, in any direction [m per unit].
        feed: displacement of the base along its feed axis [m per unit].
        with_itself: whether distances between parts of the arm change.
    """

    name: ErrorName
    unit: str
    turns: FloatArray
    elongation: float = 0.0
    shift: float = 0.0
    feed: float = 0.0
    with_itself: bool = True

    @property
    def moves_base(self) -> float:
        """Bound on the displacement of the base per unit of the error [m per unit]."""
        return self.shift + self.feed


def joint_errors(arm: Arm) -> ErrorModel:
    """Return the error model of the joints: one unit per joint, and one unit times a link's length for the feed."""
    turns = np.append(0.0, np.ones(arm.links))
    feed = arm.link_length * len(arm.base_axes)
    return ErrorModel("joints", "rad", turns, feed=feed)


def error_models(arm: Arm) -> dict[ErrorName, ErrorModel]:
    """Return the models of all geometric errors, by name.

    The models cover errors of the joints; of the lengths of the links, each independently; of the base heading; of the
    base position in any direction; and of the walls, each nearer to the arm by the error. The tolerated error of the
    walls is the certified least gap.
    """
    still = np.zeros(arm.links + 1)
    models = (
        joint_errors(arm),
        ErrorModel("link lengths", "m", still, elongation=1.0),
        ErrorModel("base heading", "rad", np.append(1.0, np.zeros(arm.links)), with_itself=False),
        ErrorModel("base position", "m", still, shift=1.0, with_itself=False),
        ErrorModel("walls", "m", still, shift=1.0, with_itself=False),
    )
    return {model.name: model for model in models}


@dataclass(frozen=True)
class ToleranceSettings:
    """Settings of the search for the largest errors that a motion tolerates.

    Attributes:
        precision: relative difference allowed between the certified error and the least error found to cause contact at
            a pose. Heuristic.
        least: errors below this count as none [rad, m]. Derived: far below the verifier's resolution.
        largest_turn: largest total rotation of the tip by angular errors that is examined [rad]. Heuristic: the bounds
            are tight up to about 0.2 rad, and an arm with larger errors follows no plan.
        largest_length: largest error of lengths that is examined, as a fraction of the arm's length. Heuristic.
        time_share: fraction of the remaining time that planning for error tolerance may take. Heuristic.
        least_time: least time granted to the search for error tolerance [s]. Heuristic.
    """

    precision: float = 2e-3
    least: float = 1e-7
    largest_turn: float = 1.2
    largest_length: float = 0.25
    time_share: float = 0.4
    least_time: float = 1.0


DEFAULT_TOLERANCE = ToleranceSettings()
"""Default settings of the search for tolerated errors."""


def largest_error(arm: Arm, model: ErrorModel, settings: ToleranceSettings = DEFAULT_TOLERANCE) -> float:
    """Return the largest error that is examined for an error model, in the unit of the model."""
    turned = float(np.sum(model.turns))
    return settings.largest_turn / turned if turned > 0.0 else settings.largest_length * arm.length


NAME = "survived joint error"
"""Name of the check of the joint error that a motion tolerates."""


def check_of(required: float, tolerated: ToleratedError) -> Check:
    """Return a check that a tolerated joint error is at least the required one [rad]."""
    # Errors above the largest examined one are not certified, so a problem that requires more is rejected.
    passed = tolerated.size >= required
    return Check(NAME, tolerated.size, required, "rad", tolerated.where, passed=passed)


_TURNS = {1: 1.0, 2: float(np.sqrt(2.0))}
"""Bound on the rotation of a joint whose bends all have an error of one unit, by the number of bends per joint."""
_MOST_NUMBERS = 2_000_000
"""Largest size of an array of distances between joints; larger sets of poses are processed in batches."""


@dataclass(frozen=True, eq=False)
class JointRanges:
    """For each of P pairs, the joints between the moving body and the body that is taken to be fixed.

    Attributes:
        interval: indices of the time intervals, shape (P,).
        first: indices of the first joints in between, shape (P,).
        last: indices of the last joints in between, shape (P,).
        fixed: whether the fixed body is the world, so that the base may have an error, too.
    """

    interval: IntArray
    first: IntArray
    last: IntArray
    fixed: bool


@dataclass(frozen=True, eq=False)
class DisplacementBounds:
    """Bounds on the distances by which an error moves e points per pair along a direction, each of shape (P, e).

    Attributes:
        at_middle: coefficient of the error at mid-interval [m per unit].
        throughout: coefficient of the error throughout the time interval [m per unit].
        quadratic: coefficient of the square of the error [m per unit²].
    """

    at_middle: FloatArray
    throughout: FloatArray
    quadratic: FloatArray


def error_at_contact(gap: FloatArray, lever: FloatArray, quadratic: FloatArray | float = 0.0) -> FloatArray:
    """Return the error e for which lever · e + quadratic · e² = gap, in its unit; negative for a negative gap."""
    root = np.sqrt(lever**2 + 4.0 * quadratic * np.maximum(gap, 0.0))
    return np.asarray(2.0 * gap / np.maximum(lever + root, np.finfo(np.float64).tiny ** 0.5))


@dataclass(frozen=True, eq=False)
class ErrorLevers:
    """Bounds on displacements per unit of a geometric error (levers), for poses or time intervals.

    Attributes:
        arm: the arm.
        model: the error model.
        inside: depth in the guide tube beyond which a joint has no error [m].
    """

    arm: Arm
    model: ErrorModel
    inside: float

    def of_pairs(self, poses: FloatArray, travels: FloatArray, pairs: Pairs, *, of_links: bool) -> FloatArray:
        """Return bounds on the displacement of links relative to the scene or to other links, shape (P,) [m per unit].

        Args:
            poses: positions of joints, base first, and tip in S poses, shape (S, links + 1, d) [m].
            travels: bounds on the distances of joints and tip from these positions, shape (S, links + 1) [m]; 0 for
                poses.
            pairs: P pairs with indices of poses instead of time intervals.
            of_links: whether the pairs are pairs of links, of which the second, farther from the base, moves relative
                to the first.
        """
        levers = np.empty(len(pairs))
        for begin, which in self._parts(len(poses), pairs):
            sums, from_base = self._sums(poses[begin], travels[begin])
            pose, link = pairs.interval[which] - begin.start, pairs.link[which]
            last = pairs.other[which] if of_links else link
            near, far = sums[pose, last, last + 1], sums[pose, last + 1, last + 1]
            if of_links:
                near, far = near - sums[pose, last, link + 1], far - sums[pose, last + 1, link + 1]
                levers[which] = np.maximum(near, far) + self.model.elongation * (last - link + 1)
            else:
                about_base = self.model.turns[0] * np.maximum(from_base[pose, link], from_base[pose, link + 1])
                moved = np.maximum(near, far) + about_base + self.model.elongation * (link + 1)
                levers[which] = moved + self.model.moves_base
        return levers

    @property
    def greatest(self) -> float:
        """Bound on the displacement of any point of the arm, in any pose, per unit of the error [m per unit]."""
        arm = self.arm
        model = self.model
        turned = float(np.sum(self._turns * arm.places_from_tip[:-1]))
        about_base = model.turns[0] * (arm.length + max(map(abs, arm.base_range)))
        return float(turned + about_base + model.elongation * arm.links + model.moves_base)

    @property
    def _turns(self) -> FloatArray:
        """Bounds on the rotations of the joints per unit of the error, shape (links,) [rad per unit]."""
        return _TURNS[self.arm.coordinates.bends_a_joint] * self.model.turns[1:]

    def _parts(self, poses: int, pairs: Pairs) -> list[tuple[slice, IntArray]]:
        size = max(_MOST_NUMBERS // (self.arm.links + 1) ** 2, 1)
        return [
            (slice(begin, begin + size), np.flatnonzero((pairs.interval >= begin) & (pairs.interval < begin + size)))
            for begin in range(0, poses, size)
        ]

    def _sums(self, poses: FloatArray, travels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return sums Σ ψ_i |P_p − P_i| of lever arms, and distances |P_p − base|.

        The sums, shape (S, p, m) [m per unit], are over the joints i < m that may have errors; distances have shape (S,
        p) [m].
        """
        arm = self.arm
        apart = np.linalg.norm(poses[:, :, None] - poses[:, None, :-1], axis=3)
        apart += travels[:, :, None] + travels[:, None, :-1]
        # The distance of two joints is at most the length of the arm between them.
        place = arm.joint_places
        apart = np.minimum(apart, np.abs(place[:, None] - place[:-1]))
        apart *= (self._turns * self._outside_tube(poses, travels))[:, None]
        sums = np.concatenate((np.zeros((*apart.shape[:2], 1)), np.cumsum(apart, axis=2)), axis=2)
        return sums, np.linalg.norm(poses - arm.base, axis=2) + travels

    def _outside_tube(self, poses: FloatArray, travels: FloatArray) -> FloatArray:
        """Return 1 for joints outside the guide tube and 0 for joints held straight by the tube, shape (S, links)."""
        arm = self.arm
        if not arm.base_axes:
            return np.ones((len(poses), arm.links))
        base_displacement = (poses[:, 0] - arm.base) @ arm.direction + travels[:, 0]
        out = base_displacement[:, None] + arm.joint_places[:-1] - arm.hole
        return np.asarray((out >= -self.inside).astype(np.float64))

    def along(
        self,
        poses: FloatArray,
        travels: FloatArray,
        joint_ranges: JointRanges,
        points: FloatArray,
        moved: FloatArray,
        normals: FloatArray,
        *,
        outwards: bool,
    ) -> DisplacementBounds:
        """Return bounds on the distances by which errors move points along directions, for P pairs of bodies.

        Args:
            poses: positions of joints and tip, as for ``of_pairs``.
            travels: bounds on the travel of joints and tip, as for ``of_pairs``.
            joint_ranges: the joints between the points and the body that is taken to be fixed.
            points: e points per pair at mid-interval, shape (P, e, d) [m].
            moved: bounds on the distances of the points from these positions during the time interval, shape (P,) [m].
            normals: directions as unit vectors, shape (P, d).
            outwards: whether the points belong to the last links; if not, the last links are taken to be fixed, and the
                points belong to the scene or to the first links.
        """
        arm, model = self.arm, self.model
        pose = poses[joint_ranges.interval]
        number = np.arange(arm.links)
        on = (number >= joint_ranges.first[:, None]) & (number <= joint_ranges.last[:, None])
        turns = self._turns * self._outside_tube(poses, travels)[joint_ranges.interval] * on
        joint_travels = travels[joint_ranges.interval]

        middle = np.einsum("pn,pen->pe", turns, _distance_from_line(points[:, :, None] - pose[:, None, :-1], normals))
        travel = np.einsum("pn,pn->p", turns, joint_travels[:, :-1]) + moved * np.sum(turns, axis=1)
        if model.elongation:
            lies = np.abs(np.einsum("pnd,pd->pn", np.diff(pose, axis=1), normals)) / arm.lengths
            turning = (joint_travels[:, 1:] + joint_travels[:, :-1]) / arm.lengths
            # An error of the first link's length moves its own ends relative to each other.
            own = number == joint_ranges.first[:, None] - 1
            grows = model.elongation * (on if joint_ranges.fixed else on | own)
            middle = middle + np.sum(grows * lies, axis=1)[:, None]
            travel = travel + np.sum(grows * np.minimum(turning, 1.0), axis=1)

        sums = np.cumsum(turns, axis=1) if outwards else np.cumsum(turns[:, ::-1], axis=1)[:, ::-1]
        heading = model.turns[0] if joint_ranges.fixed else 0.0
        quadratic = 0.5 * np.sum(on * arm.lengths * (sums + heading) ** 2, axis=1)[:, None]
        if joint_ranges.fixed:
            about_base = points - arm.base
            middle = middle + heading * _distance_from_line(about_base, normals) + model.shift
            middle = middle + model.feed * np.abs(normals @ arm.direction)[:, None]
            travel = travel + heading * moved
            base_displacement = max(map(abs, arm.base_range))
            if outwards:
                quadratic = quadratic + 0.5 * heading**2 * base_displacement
            else:
                whole = heading + np.sum(turns, axis=1)[:, None]
                quadratic = quadratic + 0.5 * whole**2 * (lengths_of(about_base) + 2.0 * base_displacement)
        return DisplacementBounds(middle, middle + travel[:, None], np.broadcast_to(quadratic, middle.shape))


def _distance_from_line(vectors: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the lengths of vectors (P, …, d) after projection onto the planes normal to directions (P, d), (P, …)."""
    along = normals.reshape(len(normals), *(1 for _ in vectors.shape[1:-1]), normals.shape[-1])
    heights = np.sum(vectors * along, axis=-1, keepdims=True)
    return lengths_of(vectors - heights * along)


def moved_by_joint_errors(arm: Arm, points: FloatArray, size: float) -> FloatArray:
    """Return bounds on the distances by which joint errors displace the links of a pose, shape (links,) [m].

    Args:
        arm: the arm.
        points: positions of joints, base first, and tip, shape (links + 1, d) [m].
        size: error of every bend [rad].
    """
    links = np.arange(arm.links)
    pairs = Pairs(np.zeros_like(links), links, links)
    levers = ErrorLevers(arm, joint_errors(arm), 0.0)
    return size * levers.of_pairs(points[None], np.zeros((1, arm.links + 1)), pairs, of_links=False)
