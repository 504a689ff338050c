"""What the trees are extended towards: random poses of a link space, drawn many at once."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.connect.heading_tree import HeadingTree
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.settings.connect_settings import ConnectSettings

_RANK = 1e-6
"""Singular values below this share of the largest count as none."""


@dataclass(frozen=True)
class TargetDraws:
    """Draws targets in the link space of a motion.

    Attributes:
        arm: the arm.
        projector: takes changes of link headings to those that the coordinates can make, shape (links, links).
        offsets: link headings of the space where all coordinates but the blended one are 0, at the start and at a goal
            of the whole arm, each of shape (links,) [rad].
        limits: bounds of the bends that are drawn, shape (links,) [rad].
        base: least and greatest bend of the first joint that is drawn [rad].
        settings: numbers.
    """

    arm: Arm
    projector: FloatArray
    offsets: tuple[FloatArray, FloatArray]
    limits: FloatArray
    base: tuple[float, float]
    settings: ConnectSettings

    @property
    def longest(self) -> float:
        """Longest extension, the mean turn of the links [rad]."""
        few = self.arm.links <= self.settings.few_links
        return self.settings.range if few else self.settings.smooth_range

    @classmethod
    def within(
        cls, space: LinkSpace, ends: list[FloatArray], curve_columns: int, share: float, settings: ConnectSettings
    ) -> "TargetDraws":
        """Draws between known ends.

        Args:
            space: the link space, perhaps with a coordinate that blends a goal in.
            ends: link headings of the start and, of a goal for the whole arm, of the goal, each of shape (links,).
            curve_columns: coordinates of the curve alone.
            share: of the joint limits that is used; a bend that an end has is allowed in any case.
            settings: numbers.
        """
        arm = space.arm
        curve = space.matrix[:, :curve_columns]
        projector = curve @ np.linalg.pinv(curve, rcond=_RANK)
        blended = space.offset + space.matrix[:, curve_columns:].sum(axis=1)

        bends = np.array([arm.bends(end) for end in ends])
        limits = np.maximum(share * arm.bend_limits, np.abs(bends).max(axis=0))
        # A base that turns further winds the arm round itself.
        low = max(-limits[0], float(bends[:, 0].min()) - settings.winding)
        high = min(limits[0], float(bends[:, 0].max()) + settings.winding)
        return cls(arm, projector, (space.offset, blended), limits, (low, high), settings)

    def draw(self, rng: np.random.Generator, count: int, tree: HeadingTree, other: HeadingTree) -> FloatArray:
        """Link headings of targets for the extension of a tree, shape (count, links) [rad]; the other attracts."""
        settings = self.settings
        targets = self.shapes(rng, count)
        kind = rng.random(count)
        bumped = np.flatnonzero(kind < settings.bumped)
        targets[bumped] = self._bumped(rng, tree.nodes[rng.integers(len(tree), size=len(bumped))])
        if len(other):
            attracted = np.flatnonzero(kind > 1.0 - settings.attracted)
            targets[attracted] = other.nodes[rng.integers(len(other), size=len(attracted))]
        return targets

    def within_limits(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """How far straight motions stay within the limits of the bends, as shares of the whole, shape (m,)."""
        bends = self.arm.bends(start)
        change = self.arm.bends(end) - bends
        bound = np.where(change > 0.0, self.limits, -self.limits)
        moving = np.abs(change) > 0.0
        share = np.where(moving, (bound - bends) / np.where(moving, change, 1.0), 1.0)
        within: FloatArray = np.clip(share.min(axis=1), 0.0, 1.0)
        return within

    def shapes(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Link headings of random shapes, shape (count, links) [rad]."""
        arm = self.arm
        settings = self.settings
        if arm.links <= settings.few_links:
            bends = rng.uniform(-self.limits, self.limits, (count, arm.links))
        else:
            # Independent bends of many links would crumple the arm; smooth ones stretch through the room.
            most = np.minimum(self.limits, settings.turning / arm.links)
            knots = rng.uniform(-1.0, 1.0, (count, settings.knots))
            at = np.linspace(0.0, settings.knots - 1.0, arm.links)
            left = np.minimum(at.astype(np.intp), settings.knots - 2)
            bends = most * (knots[:, left] + (at - left) * (knots[:, left + 1] - knots[:, left]))
        bends[:, 0] = rng.uniform(*self.base, count)
        return self._in_space(rng, arm.headings(bends))

    def _bumped(self, rng: np.random.Generator, headings: FloatArray) -> FloatArray:
        """Poses with the bend of one joint changed, or of many links a stretch of the arm turned aside."""
        arm = self.arm
        count = len(headings)
        turn = rng.normal(0.0, self.settings.bump, (count, 1))
        at = rng.uniform(0.0, 1.0, (count, 1))
        along = (np.arange(arm.links) + 0.5) / arm.links
        if arm.links <= self.settings.few_links:
            return self._clipped(headings + turn * (along >= at))
        width = rng.uniform(*self.settings.bump_widths, (count, 1))
        bumped = headings + turn * np.exp(-(((along - at) / width) ** 2))
        return self._in_space(rng, bumped)

    def _clipped(self, headings: FloatArray) -> FloatArray:
        bends = np.clip(self.arm.bends(headings), -self.limits, self.limits)
        return self.arm.headings(bends)

    def _in_space(self, rng: np.random.Generator, headings: FloatArray) -> FloatArray:
        """The poses of the space nearest to given ones, with a random share of the goal's offset blended in."""
        share = rng.random((len(headings), 1))
        offset = self.offsets[0] + share * (self.offsets[1] - self.offsets[0])
        return offset + (headings - offset) @ self.projector.T
