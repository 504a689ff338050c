"""Errors of joints, links, base, walls and loads, and their numbers.

Errors are made one joint after the other, the first one first: what is beyond a joint is turned about it as a whole, in
the shape that it has without errors. So a point P moves by at most Σ ψ_i |P − P_i| over the joints i before it, with
the turns ψ_i of the joints. In the plane ψ is the error δ of the bend. In space a joint whose two bends are off by at
most δ turns by ψ = 2 acos(cos² ½ δ) ≤ √2 δ about some axis, for its two axes are at right angles. The sum is convex in
P, and so greatest at an end of a link.

Along a direction n a point moves by less. A product of turns differs from one plus their sum by at most half the square
of the sum of their sizes, so that with the links t_k, which the joints up to k turn,

    n · (P' − P)  ≤  Σ ψ_i |n × (P − P_i)|  +  ½ Σ_k |t_k| (Σ_{i ≤ k} ψ_i)².

A link and an edge, a triangle or another link are parted by a plane with any normal n, on one side of which the ends of
the one stay, and on the other the corners of the other. Either of them may be taken to be the one that moves: errors
leave it to the observer whether they move the arm against what stands still, or that against a link.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem.solution import Check, SurvivedError
from ccm_opt.robot.arm import Arm
from ccm_opt.verification.chain_motion import lengths_of
from ccm_opt.verification.stretch_proof import Pairs

ErrorName = Literal["joints", "base heading", "link lengths", "base position", "walls"]


@dataclass(frozen=True)
class ErrorModel:
    """How much everything may be off when the error is one unit.

    Attributes:
        name: what is wrong.
        unit: of the error, "rad" or "m".
        turns: of the base's heading and of every joint, shape (links + 1,) [rad a unit].
        stretch: of the length of every link [m a unit].
        shift: of the whole arm against the walls, in any direction [m a unit].
        feed: of the base along its feed axis [m a unit].
        with_itself: whether distances within the arm change.
    """

    name: ErrorName
    unit: str
    turns: FloatArray
    stretch: float = 0.0
    shift: float = 0.0
    feed: float = 0.0
    with_itself: bool = True

    @property
    def moves_base(self) -> float:
        """How far the base is off at most [m a unit]."""
        return self.shift + self.feed


def joint_errors(arm: Arm) -> ErrorModel:
    """Return every joint is off by as much as the unit, and the base on a feed axis by a link's length times that."""
    turns = np.append(0.0, np.ones(arm.links))
    feed = arm.link_length * len(arm.base_axes)
    return ErrorModel("joints", "rad", turns, feed=feed)


def error_models(arm: Arm) -> dict[ErrorName, ErrorModel]:
    """Return the everything that may be wrong with the geometry, by its name.

    They are the joints; every link longer or shorter by as much as the unit, each by itself; the arm turned about its
    base, or beside its place in any direction; and every wall nearer to the arm by as much, the certified least gap.
    """
    still = np.zeros(arm.links + 1)
    models = (
        joint_errors(arm),
        ErrorModel("link lengths", "m", still, stretch=1.0),
        ErrorModel("base heading", "rad", np.append(1.0, np.zeros(arm.links)), with_itself=False),
        ErrorModel("base position", "m", still, shift=1.0, with_itself=False),
        ErrorModel("walls", "m", still, shift=1.0, with_itself=False),
    )
    return {model.name: model for model in models}


@dataclass(frozen=True)
class ToleranceSettings:
    """Numbers of the search for the largest errors that a motion survives.

    Attributes:
        precision: share by which the certified error may stay below the least one that the bound refuses at some
            pose. Taste.
        least: errors below this count as none [rad, m]. Derived: far below what the verifier tells apart.
        largest_turn: errors of angles that may turn the tip by more than this, all together, are not looked at [rad].
            Taste: bounds are tight up to some 0.2 rad, and an arm so far off follows no plan.
        largest_length: the same of lengths, as a share of the arm's length. Taste.
        time_share: share of the time left that a search with such room may take. Taste.
        least_time: that a search is given in any case [s]. Taste.
    """

    precision: float = 2e-3
    least: float = 1e-7
    largest_turn: float = 1.2
    largest_length: float = 0.25
    time_share: float = 0.4
    least_time: float = 1.0


DEFAULT_TOLERANCE = ToleranceSettings()
"""What is used unless others are given."""


def largest_error(arm: Arm, model: ErrorModel, settings: ToleranceSettings = DEFAULT_TOLERANCE) -> float:
    """Return the errors above this are not looked at [unit]."""
    turned = float(np.sum(model.turns))
    return settings.largest_turn / turned if turned > 0.0 else settings.largest_length * arm.length


NAME = "survived joint error"
"""Of the check."""


def check_of(asked: float, survived: SurvivedError) -> Check:
    """Return the check of an error that is known already, against the one asked for [rad]."""
    # What lies beyond is not looked at, so a problem that asks for more is refused.
    passed = survived.size >= asked
    return Check(NAME, survived.size, asked, "rad", survived.where, passed=passed)


_TURNS = {1: 1.0, 2: float(np.sqrt(2.0))}
"""Turn of a joint for errors of one unit of all of its bends, by how many it has."""
_MOST_NUMBERS = 2_000_000
"""Of an array of distances between joints; more poses than have so many are looked at in parts."""


@dataclass(frozen=True, eq=False)
class Chains:
    """Stretches of the arm between what is looked at and what stands still, of pairs.

    Attributes:
        stretch: numbers of the stretches of time, shape (P,).
        first: numbers of the first joints that move anything, shape (P,).
        last: numbers of the last joints, shape (P,).
        fixed: whether what stands still is the world, so that the base may be off, too.
    """

    stretch: IntArray
    first: IntArray
    last: IntArray
    fixed: bool


@dataclass(frozen=True, eq=False)
class Reaches:
    """How far errors move points along directions at most, each array of shape (P, e).

    Attributes:
        middle: in proportion to the error, at the middle of a stretch of time [m a unit].
        during: the same throughout the stretch [m a unit].
        bow: in proportion to its square [m a unit²].
    """

    middle: FloatArray
    during: FloatArray
    bow: FloatArray


def survived(gap: FloatArray, lever: FloatArray, bow: FloatArray | float = 0.0) -> FloatArray:
    """Return the error e at which lever e + bow e² is the gap [unit]; negative where the gap is [m]."""
    root = np.sqrt(lever**2 + 4.0 * bow * np.maximum(gap, 0.0))
    return np.asarray(2.0 * gap / np.maximum(lever + root, np.finfo(np.float64).tiny ** 0.5))


@dataclass(frozen=True, eq=False)
class ErrorLevers:
    """Levers of errors in stretches of time.

    Attributes:
        arm: the arm.
        model: what may be wrong.
        inside: a joint has no error where it is farther than this inside the guide tube [m].
    """

    arm: Arm
    model: ErrorModel
    inside: float

    def of_pairs(self, poses: FloatArray, travels: FloatArray, pairs: Pairs, *, of_links: bool) -> FloatArray:
        """How far the links of pairs move at most, against the scene or the links nearer to the base, (P,) [m a unit].

        Args:
            poses: base, joints and tip, shape (S, links + 1, d) [m].
            travels: how far each of them goes from there at most, shape (S, links + 1) [m]; zero for the poses alone.
            pairs: whose stretches are numbers of poses.
            of_links: whether they are pairs of links, of which the second moves against the first.
        """
        levers = np.empty(len(pairs))
        for begin, which in self._parts(len(poses), pairs):
            sums, from_base = self._sums(poses[begin], travels[begin])
            pose, link = pairs.stretch[which] - begin.start, pairs.link[which]
            last = pairs.other[which] if of_links else link
            near, far = sums[pose, last, last + 1], sums[pose, last + 1, last + 1]
            if of_links:
                near, far = near - sums[pose, last, link + 1], far - sums[pose, last + 1, link + 1]
                levers[which] = np.maximum(near, far) + self.model.stretch * (last - link + 1)
            else:
                about_base = self.model.turns[0] * np.maximum(from_base[pose, link], from_base[pose, link + 1])
                moved = np.maximum(near, far) + about_base + self.model.stretch * (link + 1)
                levers[which] = moved + self.model.moves_base
        return levers

    @property
    def greatest(self) -> float:
        """The greatest lever that any pose of the arm may have [m a unit]."""
        arm = self.arm
        model = self.model
        turned = arm.link_length * float(np.sum(self._turns * np.arange(arm.links, 0, -1)))
        about_base = model.turns[0] * (arm.length + max(map(abs, arm.base_range)))
        return float(turned + about_base + model.stretch * arm.links + model.moves_base)

    @property
    def _turns(self) -> FloatArray:
        """Turns of the joints, shape (links,) [rad a unit]."""
        return _TURNS[self.arm.coordinates.bends_a_joint] * self.model.turns[1:]

    def _parts(self, poses: int, pairs: Pairs) -> list[tuple[slice, IntArray]]:
        size = max(_MOST_NUMBERS // (self.arm.links + 1) ** 2, 1)
        return [
            (slice(begin, begin + size), np.flatnonzero((pairs.stretch >= begin) & (pairs.stretch < begin + size)))
            for begin in range(0, poses, size)
        ]

    def _sums(self, poses: FloatArray, travels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Σ ψ_i |P_p − P_i| over the joints i before m that may be off, (S, p, m), and |P_p − base|, (S, p) [m]."""
        arm = self.arm
        apart = np.linalg.norm(poses[:, :, None] - poses[:, None, :-1], axis=3)
        apart += travels[:, :, None] + travels[:, None, :-1]
        # No two joints are farther apart than the arm between them is long.
        number = np.arange(arm.links + 1)
        apart = np.minimum(apart, arm.link_length * np.abs(number[:, None] - number[:-1]))
        apart *= (self._turns * self._free(poses, travels))[:, None]
        sums = np.concatenate((np.zeros((*apart.shape[:2], 1)), np.cumsum(apart, axis=2)), axis=2)
        return sums, np.linalg.norm(poses - arm.base, axis=2) + travels

    def _free(self, poses: FloatArray, travels: FloatArray) -> FloatArray:
        """Return the 1 for joints that no guide tube holds, 0 for the others, shape (S, links)."""
        arm = self.arm
        if not arm.base_axes:
            return np.ones((len(poses), arm.links))
        carried = (poses[:, 0] - arm.base) @ arm.direction + travels[:, 0]
        out = carried[:, None] + arm.link_length * np.arange(arm.links) - arm.hole
        return np.asarray((out >= -self.inside).astype(np.float64))

    def along(
        self,
        poses: FloatArray,
        travels: FloatArray,
        chains: Chains,
        points: FloatArray,
        moved: FloatArray,
        normals: FloatArray,
        *,
        outwards: bool,
    ) -> Reaches:
        """Return how far errors move points along directions.

        Args:
            poses: as for ``of_pairs``.
            travels: likewise.
            chains: the joints between the points and what stands still.
            points: at the middles of the stretches, shape (P, e, d) [m].
            moved: how far they go from there, shape (P,) [m].
            normals: unit vectors, shape (P, d).
            outwards: whether the points are those of the last links; else they are seen from these, and stand still or
                are those of the first.
        """
        arm, model = self.arm, self.model
        pose = poses[chains.stretch]
        number = np.arange(arm.links)
        on = (number >= chains.first[:, None]) & (number <= chains.last[:, None])
        turns = self._turns * self._free(poses, travels)[chains.stretch] * on
        joint_travels = travels[chains.stretch]

        middle = np.einsum("pn,pen->pe", turns, _off(points[:, :, None] - pose[:, None, :-1], normals))
        gone = np.einsum("pn,pn->p", turns, joint_travels[:, :-1]) + moved * np.sum(turns, axis=1)
        if model.stretch:
            lies = np.abs(np.einsum("pnd,pd->pn", np.diff(pose, axis=1), normals)) / arm.link_length
            turning = (joint_travels[:, 1:] + joint_travels[:, :-1]) / arm.link_length
            # The length of the first link moves its own ends against each other.
            own = number == chains.first[:, None] - 1
            grows = model.stretch * (on if chains.fixed else on | own)
            middle = middle + np.sum(grows * lies, axis=1)[:, None]
            gone = gone + np.sum(grows * np.minimum(turning, 1.0), axis=1)

        sums = np.cumsum(turns, axis=1) if outwards else np.cumsum(turns[:, ::-1], axis=1)[:, ::-1]
        heading = model.turns[0] if chains.fixed else 0.0
        bow = 0.5 * arm.link_length * np.sum(on * (sums + heading) ** 2, axis=1)[:, None]
        if chains.fixed:
            about_base = points - arm.base
            middle = middle + heading * _off(about_base, normals) + model.shift
            middle = middle + model.feed * np.abs(normals @ arm.direction)[:, None]
            gone = gone + heading * moved
            carried = max(map(abs, arm.base_range))
            if outwards:
                bow = bow + 0.5 * heading**2 * carried
            else:
                whole = heading + np.sum(turns, axis=1)[:, None]
                bow = bow + 0.5 * whole**2 * (lengths_of(about_base) + 2.0 * carried)
        return Reaches(middle, middle + gone[:, None], np.broadcast_to(bow, middle.shape))


def _off(vectors: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the lengths of what vectors (P, …, d) have across directions (P, d), shape (P, …)."""
    along = normals.reshape(len(normals), *(1 for _ in vectors.shape[1:-1]), normals.shape[-1])
    heights = np.sum(vectors * along, axis=-1, keepdims=True)
    return lengths_of(vectors - heights * along)


def moved_by_joint_errors(arm: Arm, points: FloatArray, size: float, inside: float = 0.0) -> FloatArray:
    """Return how far errors of the joints move each link of a pose at most, shape (links,) [m].

    Args:
        arm: the arm.
        points: base, joints and tip, shape (links + 1, d) [m].
        size: of the error of every bend [rad].
        inside: as for ``ErrorLevers``.
    """
    links = np.arange(arm.links)
    pairs = Pairs(np.zeros_like(links), links, links)
    levers = ErrorLevers(arm, joint_errors(arm), inside)
    return size * levers.of_pairs(points[None], np.zeros((1, arm.links + 1)), pairs, of_links=False)
