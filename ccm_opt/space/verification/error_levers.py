"""How far errors move the links of an arm in space at most, for a unit of error.

Errors are made one joint after the other, the first one first: what is beyond a joint is turned about it as a whole, in
the shape that it has without errors. So a point P moves by at most Σ ψ_i |P − P_i| over the joints i before it, with
the turns ψ_i of the joints. A joint whose two bends are off by at most δ turns by ψ = 2 acos(cos² ½ δ) ≤ √2 δ about
some axis, for its two axes are at right angles. The sum is convex in P, and so greatest at an end of a link.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.space.verification.stretch_proof import StretchPairs
from ccm_opt.verification.tolerance.error_model import ErrorModel, joint_errors

_TURN = np.sqrt(2.0)
"""Turn of a joint for errors of one unit of both of its bends."""
_MOST_NUMBERS = 2_000_000
"""Of an array of distances between joints; more poses than have so many are looked at in parts."""


@dataclass(frozen=True, eq=False)
class ErrorLevers:
    """Levers of pairs in stretches of time.

    Attributes:
        arm: the arm.
        model: what may be wrong.
        inside: a joint has no error where it is farther than this inside the guide tube [m].
    """

    arm: SpaceArm
    model: ErrorModel
    inside: float

    def to_surfaces(self, poses: FloatArray, travels: FloatArray, pairs: StretchPairs) -> FloatArray:
        """How far the links of pairs move against the scene at most, shape (P,) [m a unit].

        Args:
            poses: base, joints and tip, shape (S, links + 1, 3) [m].
            travels: how far each of them goes from there at most, shape (S, links + 1) [m]; zero for the poses alone.
            pairs: whose stretches are numbers of poses.
        """

        def of_some(sums: FloatArray, from_base: FloatArray, pose: IntArray, link: IntArray, _: IntArray) -> FloatArray:
            model = self.model
            before = link + 1
            turned = np.maximum(sums[pose, link, before], sums[pose, link + 1, before])
            about_base = np.maximum(from_base[pose, link], from_base[pose, link + 1])
            grown = model.stretch * (link + 1)
            return np.asarray(_TURN * turned + model.turns[0] * about_base + grown + model.moves_base)

        return self._of_pairs(of_some, poses, travels, pairs)

    def to_links(self, poses: FloatArray, travels: FloatArray, pairs: StretchPairs) -> FloatArray:
        """How far the second links of pairs move against the first, nearer to the base; arguments likewise."""

        def of_some(sums: FloatArray, _: FloatArray, pose: IntArray, first: IntArray, second: IntArray) -> FloatArray:
            near = sums[pose, second, second + 1] - sums[pose, second, first + 1]
            far = sums[pose, second + 1, second + 1] - sums[pose, second + 1, first + 1]
            grown = self.model.stretch * (second - first + 1)
            return np.asarray(_TURN * np.maximum(near, far) + grown)

        return self._of_pairs(of_some, poses, travels, pairs)

    @property
    def greatest(self) -> float:
        """The greatest lever that any pose of the arm may have [m a unit]."""
        arm = self.arm
        model = self.model
        turned = arm.link_length * float(np.sum(model.turns[1:] * np.arange(arm.links, 0, -1)))
        about_base = model.turns[0] * (arm.length + max(map(abs, arm.base_range)))
        return float(_TURN * turned + about_base + model.stretch * arm.links + model.moves_base)

    def _of_pairs(
        self,
        of_some: Callable[[FloatArray, FloatArray, IntArray, IntArray, IntArray], FloatArray],
        poses: FloatArray,
        travels: FloatArray,
        pairs: StretchPairs,
    ) -> FloatArray:
        levers = np.empty(len(pairs))
        size = max(_MOST_NUMBERS // (self.arm.links + 1) ** 2, 1)
        for begin in range(0, len(poses), size):
            some = slice(begin, begin + size)
            which = (pairs.stretch >= begin) & (pairs.stretch < begin + size)
            sums, from_base = self._sums(poses[some], travels[some])
            chosen = pairs.where(which)
            levers[which] = of_some(sums, from_base, chosen.stretch - begin, chosen.link, chosen.other)
        # A lever of nought would make of every gap an endless error.
        return np.maximum(levers, np.finfo(np.float64).tiny ** 0.5)

    def _sums(self, poses: FloatArray, travels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Σ |P_p − P_i| over the joints i before m that may be off, (S, p, m), and |P_p − base|, (S, p) [m]."""
        arm = self.arm
        apart = np.linalg.norm(poses[:, :, None] - poses[:, None, :-1], axis=3)
        apart += travels[:, :, None] + travels[:, None, :-1]
        # No two joints are farther apart than the arm between them is long.
        number = np.arange(arm.links + 1)
        apart = np.minimum(apart, arm.link_length * np.abs(number[:, None] - number[:-1]))
        apart *= (self.model.turns[1:] * self._free(poses, travels))[:, None]
        sums = np.concatenate((np.zeros((*apart.shape[:2], 1)), np.cumsum(apart, axis=2)), axis=2)
        return sums, np.linalg.norm(poses - arm.base, axis=2) + travels

    def _free(self, poses: FloatArray, travels: FloatArray) -> FloatArray:
        """1 for joints that no guide tube holds, 0 for the others, shape (S, links)."""
        arm = self.arm
        if not arm.base_axes:
            return np.ones((len(poses), arm.links))
        carried = (poses[:, 0] - arm.base) @ arm.direction + travels[:, 0]
        out = carried[:, None] + arm.link_length * np.arange(arm.links) - arm.hole
        return np.asarray((out >= -self.inside).astype(np.float64))


def moved_by_joint_errors(arm: SpaceArm, points: FloatArray, size: float, inside: float = 0.0) -> FloatArray:
    """How far errors of the joints move each link of a pose at most, shape (links,) [m].

    Args:
        arm: the arm.
        points: base, joints and tip, shape (links + 1, 3) [m].
        size: of the error of every bend [rad].
        inside: as for ``ErrorLevers``.
    """
    links = np.arange(arm.links)
    pairs = StretchPairs(np.zeros_like(links), links, links)
    levers = ErrorLevers(arm, joint_errors(arm), inside)
    return size * levers.to_surfaces(points[None], np.zeros((1, arm.links + 1)), pairs)
