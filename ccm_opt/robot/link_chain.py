"""What arms in the plane and in space have in common: equal links, a mount, and an axis that carries the base."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import ROUNDING, BoolArray, FloatArray, IntArray
from ccm_opt.errors import ProblemError
from ccm_opt.robot.link_bodies import DEFAULT_LINK_MARGINS, LinkMarginSettings

HELD_TOLERANCE = ROUNDING
"""A joint as near as this to the hole counts as having passed it [m]."""


@dataclass(frozen=True)
class Feed:
    """A linear axis along the base heading that carries the base through a guide tube; distances from ``Arm.base`` [m].

    Attributes:
        low: least position of the base on the axis.
        high: greatest position.
        hole: where the guide tube ends; joints that have not passed it are held straight.
    """

    low: float
    high: float
    hole: float


class LinkChain:
    """What follows from the measures of a row of equal links; the kinds of arms, frozen dataclasses, hold them.

    The attributes are those of ``Arm`` and ``SpaceArm``.
    """

    links: int
    link_length: float
    radius: float
    base: FloatArray
    self_collision: bool
    mount_length: float
    feed: Feed | None
    stray: float

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point: 2 in the plane, 3 in space."""
        return len(self.base)

    @property
    def length(self) -> float:
        """Total length L = links · l [m]."""
        return self.links * self.link_length

    @property
    def base_axes(self) -> tuple[Feed, ...]:
        """The axes that carry the base, in the order of their coordinates; none when it is fixed."""
        return () if self.feed is None else (self.feed,)

    @property
    def base_range(self) -> tuple[float, float]:
        """How far the base is carried along its heading at least and at most [m]; 0 and 0 when it is fixed."""
        return sum(axis.low for axis in self.base_axes), sum(axis.high for axis in self.base_axes)

    @property
    def hole(self) -> float:
        """Distance from ``base`` at which the last guide tube of the base ends [m]; −∞ when there is none."""
        return max((axis.hole for axis in self.base_axes), default=-np.inf)

    def held(self, feed: FloatArray | float) -> BoolArray:
        """Which joints a guide tube of the base still holds straight, shape (..., links), boolean; none without one.

        Args:
            feed: position of the base on its feed axis, shape (...) [m].
        """
        along = np.asarray(feed)[..., None] + self.link_length * np.arange(self.links)
        held: BoolArray = along < self.hole - HELD_TOLERANCE
        return held

    def levers_to(self, at: float | None) -> FloatArray:
        """How much of every link lies between the base and a point of the arm, shape (links,) [m].

        Args:
            at: arc length of the point from the base [m]; that of the tip when None.

        Raises:
            ProblemError: the arm is not so long.
        """
        length = self.length if at is None else at
        if not 0.0 <= length <= self.length * (1.0 + ROUNDING):
            raise ProblemError(f"a point of the arm must be from 0 to {self.length:g} m along it, got {length:g} m")
        before = self.link_length * np.arange(self.links)
        return np.clip(length - before, 0.0, self.link_length)

    @property
    def mount_end(self) -> tuple[int, float]:
        """Link on which the mount ends, and where on it as a share in [0, 1]; share 1 of the last is the whole arm."""
        length = self.mount_length / self.link_length
        # The small number keeps a mount of whole links from ending on the link before by rounding.
        link = min(int(length + 1e-9), self.links - 1)
        return link, min(max(length - link, 0.0), 1.0)

    def exposed_links(self, points: FloatArray) -> tuple[int, FloatArray]:
        """Index of the first link beyond the mount, and the axes of the links from its end on.

        Args:
            points: joints and tip of one pose or of several, shape (..., links + 1, d) [m].

        Returns:
            The index, and axes of shape (..., k, 2, d) [m]; none where the whole arm is mount.
        """
        first, share = self.mount_end
        if share > 1.0 - ROUNDING:
            return self.links, np.zeros((*points.shape[:-2], 0, 2, points.shape[-1]))
        axes = np.stack((points[..., first:-1, :], points[..., first + 1 :, :]), axis=-2)
        axes[..., 0, 0, :] += share * (axes[..., 0, 1, :] - axes[..., 0, 0, :])
        return first, axes

    @property
    def first_self_pair(self) -> int:
        """Least difference j − i of the indices of links whose axes must keep two radii apart.

        Links are neighbours round a bend unless ``(|i − j| − 1) l ≥ max(2 l, π r)``.
        """
        reach = max(2.0 * self.link_length, np.pi * self.radius)
        return int(np.ceil(reach / self.link_length - 1e-9)) + 1

    @property
    def distant_pairs(self) -> tuple[IntArray, IntArray]:
        """Pairs (i, j), i < j, of links so far apart along the arm that they can meet, each of shape (p,)."""
        first, second = np.triu_indices(self.links, self.first_self_pair)
        return first, second

    @property
    def self_pairs(self) -> tuple[IntArray, IntArray]:
        """Pairs of links that must keep two radii apart, the distant ones; none when links may meet."""
        if self.self_collision:
            return self.distant_pairs
        none = np.zeros(0, dtype=np.intp)
        return none, none

    def link_margins(
        self,
        first: IntArray,
        second: IntArray,
        margin: float,
        settings: LinkMarginSettings = DEFAULT_LINK_MARGINS,
    ) -> FloatArray:
        """Gap that planning keeps between the surfaces of distant links, shape (p,) [m].

        Links that are not far apart along the arm cannot keep the whole margin round a tight bend: they keep a share of
        what the links between them leave at full stretch.

        Args:
            first: links nearer to the base, shape (p,).
            second: the others, shape (p,).
            margin: that planning keeps from walls [m].
            settings: the share that is kept.
        """
        between = (second - first - 1) * self.link_length - 2.0 * self.radius
        return np.clip(settings.share * between, 0.0, margin)

    def room_for_errors(self, links: IntArray) -> FloatArray:
        """Room that planning leaves beyond contact for errors of joints, where some links lie between, shape (p,) [m].

        An error at one joint after the other, the first one first, moves a point on a circle about that joint, whose
        radius is at most the length of arm between: l for the last joint, 2 l for the one before, and so on.

        Args:
            links: number of links from the first joint to the end of the link that moves, that link included, shape
                (p,): all up to it against a wall, those that turn against each other for two links.
        """
        return np.asarray(0.5 * self.stray * self.link_length**2 * links * (links + 1))
