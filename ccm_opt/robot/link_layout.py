"""Where the links of an arm lie along it, which of them belong to its mount, and which pairs may collide."""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import ROUNDING, BoolArray, FloatArray, IntArray
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.tool import BARE, ToolLinks

NextPairs: TypeAlias = npt.NDArray[np.int32]
"""The first link from link j on that must not touch link i, for i and j, shape (links, links + 1); ``links`` if none.

C reads from it the pairs to be checked, from any link on.
"""
LINK_MARGIN_SHARE = 0.2
"""Margin that planning keeps between two links that could collide, if they are too close along the arm for the full
margin, as a fraction of the gap between them when the arm is straight. Heuristic."""


@dataclass(frozen=True, eq=False)
class Proportions:
    """Lengths, radii and joint limits of an arm with unequal links, as multiples of the arm's values.

    Attributes:
        lengths: length of each link over ``Arm.link_length``, shape (links,), with mean 1.
        radii: radius of each link over ``Arm.radius``, shape (links,), at most 1.
        limits: limit of each bend over ``Arm.joint_limit``, over ``Arm.base_limit`` for the first joint, joint by
            joint, shape (k links,) for k bends per joint, at most 1; 0 locks a bend.
        counts: number of links of each section of the problem file, for messages; empty if there are none.
    """

    lengths: FloatArray
    radii: FloatArray
    limits: FloatArray
    counts: tuple[int, ...] = ()


class LinkLayout:
    """Base class of arms: the places of links along the arm, as far as they do not depend on its pose.

    Attributes:
        links: number of links.
        link_length: mean length of the links [m].
        radius: maximum radius of the links [m].
        mount_length: length of arm, measured from the base, that may touch obstacles [m].
        self_collision: whether links that could collide must not touch.
        proportions: lengths, radii and limits that differ between links; None if all links are equal.
        tool_links: what is particular to an arm whose last links stand for its tool; None for all others.
        sections: its division into sections that bend evenly, after which its links are named; None if there are none.
    """

    links: int
    link_length: float
    radius: float
    mount_length: float
    self_collision: bool
    proportions: Proportions | None
    tool_links: ToolLinks | None
    sections: ArcSections | None

    @cached_property
    def lengths(self) -> FloatArray:
        """Length of each link, shape (links,) [m]."""
        return fixed(self.link_length * self.length_shares)

    @cached_property
    def radii(self) -> FloatArray:
        """Radius of each link, shape (links,) [m]; of links without a body, far below zero."""
        shares = np.ones(self.links) if self.proportions is None else self.proportions.radii
        radii = self.radius * shares
        if self.tool_links is not None:
            radii[self.tool_links.bare] = -BARE * self.length
        return fixed(radii)

    @cached_property
    def thinnest(self) -> float:
        """Least radius of a link that has a body [m]."""
        return float(np.min(self.radii[self.radii >= 0.0]))

    @property
    def tip_radius(self) -> float:
        """Radius of the last link [m]; 0 if it has no body."""
        return max(float(self.radii[-1]), 0.0)

    @property
    def own_link_length(self) -> float:
        """Mean length of the links, without tool links [m]."""
        if self.tool_links is None:
            return self.link_length
        return float(np.mean(self.lengths[self.tool_links.own]))

    @property
    def margin_starts(self) -> FloatArray:
        """Places where links start, from which ``link_margins`` follow, as ``place_shares``, shape (links,)."""
        return self.place_shares[:-1] if self.tool_links is None else self.tool_links.near_starts

    @property
    def margin_ends(self) -> FloatArray:
        """Places where links end, from which ``link_margins`` follow, as ``place_shares``, shape (links,)."""
        return self.place_shares[1:] if self.tool_links is None else self.tool_links.near_ends

    def link_number(self, link: int) -> int:
        """Return the number in messages, from 1, of a link given by its index, or of the link that carries it."""
        return link + 1 if self.tool_links is None else int(self.tool_links.carriers[link]) + 1

    def section_name(self, link: int) -> str:
        """Return the name of the section that bends evenly to which a link, given by its index, belongs; else ""."""
        return "" if self.sections is None else self.sections.name_at(link)

    def link_name(self, link: int) -> str:
        """Return the name in messages of a link, by its index: its number, its section, or the body it stands for."""
        if self.tool_links is not None and self.tool_links.names[link]:
            return self.tool_links.names[link]
        return self.section_name(link) or f"link {self.link_number(link)}"

    def joint_name(self, joint: int) -> str:
        """Return the name in messages of a joint: its number, its section, or the body with a corner there."""
        if self.tool_links is not None and self.tool_links.names[joint]:
            return self.tool_links.names[joint]
        return self.section_name(joint) or f"joint {self.link_number(joint)}"

    @cached_property
    def joint_places(self) -> FloatArray:
        """Arc lengths of the joints and the tip from the base, shape (links + 1,) [m]."""
        return fixed(self.link_length * self.place_shares)

    @cached_property
    def places_from_tip(self) -> FloatArray:
        """Arc lengths of the joints and the tip, measured back from the tip, shape (links + 1,) [m]."""
        return fixed(self.link_length * (self.place_shares[-1] - self.place_shares))

    @cached_property
    def link_middles(self) -> FloatArray:
        """Arc lengths from the base to the midpoints of the links, shape (links,) [m]."""
        return fixed(self.link_length * (self.place_shares[:-1] + 0.5 * self.length_shares))

    @cached_property
    def length_shares(self) -> FloatArray:
        """Length of each link over the mean length, shape (links,)."""
        return np.ones(self.links) if self.proportions is None else self.proportions.lengths

    @cached_property
    def arc_shares(self) -> FloatArray:
        """Length by which each link makes the arm longer, over the mean length: 0 for bodies beside it, (links,)."""
        if self.tool_links is None:
            return self.length_shares
        return np.where(self.tool_links.leads_on, self.length_shares, 0.0)

    @property
    def spine_lengths(self) -> FloatArray:
        """Length of each link, or of the link to which a body is fixed that makes the arm no longer, (links,) [m]."""
        if self.tool_links is None:
            return self.lengths
        own = self.lengths[self.tool_links.own][self.tool_links.carriers]
        return np.where(self.tool_links.leads_on, self.lengths, own)

    @cached_property
    def place_shares(self) -> FloatArray:
        """Arc lengths of the joints and the tip over the mean length of links, shape (links + 1,)."""
        # Sums of ones are exact, so that equal links end at multiples of their length.
        return np.concatenate(([0.0], np.cumsum(self.arc_shares)))

    @property
    def length(self) -> float:
        """Total length L = links · l [m]."""
        return self.links * self.link_length

    @cached_property
    def mount_end(self) -> tuple[int, float]:
        """Index of the link in which the mount ends, and the fraction of that link that belongs to the mount.

        The mount is the first part of the arm, which may touch obstacles. A fraction of 1 for the last link means that
        the whole arm is mount.
        """
        link = min(self.whole_mount_links, self.links - 1)
        return link, float(self.free_shares[link])

    @cached_property
    def whole_mount_links(self) -> int:
        """Number of links that belong to the mount as a whole."""
        # The small number stops rounding from placing the end of a mount of whole links on the previous link.
        shares = self.place_shares[1:]
        return int(np.searchsorted(shares, self.mount_length / self.link_length + 1e-9, side="right"))

    @property
    def mounted_links(self) -> int:
        """Number of links that belong to the mount in whole or in part; links are equal."""
        # Rounding may not place the end of a mount of whole links on the next link.
        return int(np.ceil(self.mount_length / self.link_length - 1e-9))

    @cached_property
    def free_shares(self) -> FloatArray:
        """Fraction of each link that belongs to the mount and so may touch obstacles, from 0 to 1, shape (links,)."""
        within = self.mount_length / self.link_length - self.place_shares[:-1]
        shares = np.clip(within / self.length_shares, 0.0, 1.0)
        # What rounding leaves of a link whose end is that of the mount, or adds of the one after it, is not there.
        return fixed(np.where(shares > 1.0 - 1e-9, 1.0, np.where(shares < 1e-9, 0.0, shares)))

    def exposed_links(self, points: FloatArray) -> tuple[int, FloatArray]:
        """Return the index of the first link that extends beyond the mount, and the link axes without the mount.

        The axis of a link that belongs to the mount in part is cut at the end of the mount.

        Args:
            points: joints and tip of one or more poses, shape (..., links + 1, d) [m].

        Returns:
            The index, and the two end points of the axis of each of the k links from there on, shape (..., k, 2, d)
            [m]; k = 0 if the whole arm is mount.
        """
        first, share = self.mount_end
        if share > 1.0 - ROUNDING:
            return self.links, np.zeros((*points.shape[:-2], 0, 2, points.shape[-1]))
        axes = np.empty((*points.shape[:-2], points.shape[-2] - 1 - first, 2, points.shape[-1]))
        axes[..., 0, :] = points[..., first:-1, :]
        axes[..., 1, :] = points[..., first + 1 :, :]
        axes[..., 0, 0, :] += share * (axes[..., 0, 1, :] - axes[..., 0, 0, :])
        return first, axes

    @cached_property
    def distant_links(self) -> BoolArray:
        """Mask of the pairs of links i < j far enough apart along the arm to collide, shape (links, links).

        At least two links and a length of π r must lie between them, where r is the maximum radius from link i to link
        j; closer ones count as neighbours around a bend.
        """
        if self.tool_links is not None:
            return self.tool_links.distant
        number = np.arange(self.links)
        distant = number >= number[:, None] + 3
        for i in range(self.links - 3):
            between = self.place_shares[i + 3 : -1] - self.place_shares[i + 1]
            thickest = np.maximum.accumulate(self.radii[i:])[3:] / self.link_length
            distant[i, i + 3 :] = between >= np.pi * thickest - 1e-9
        return fixed(distant)

    @cached_property
    def distant_pairs(self) -> tuple[IntArray, IntArray]:
        """Pairs of links i < j far enough apart along the arm to collide, as two arrays of indices, shape (p,)."""
        first, second = np.nonzero(self.distant_links)
        return first, second

    @property
    def self_pairs(self) -> tuple[IntArray, IntArray]:
        """Indices i and j > i of the p pairs of links that must not touch each other, two arrays of shape (p,).

        They are all pairs that are far enough apart along the arm, or none if self-collision is switched off.
        """
        if self.self_collision:
            return self.distant_pairs
        none = np.zeros(0, dtype=np.intp)
        return none, none

    @cached_property
    def next_self_pairs(self) -> NextPairs:
        """The next pairs of links that must not touch each other; there are none if self-collision is switched off."""
        following = np.full((self.links, self.links + 1), self.links, dtype=np.int32)
        if self.self_collision:
            following[:, :-1][self.distant_links] = self.distant_pairs[1]
        return fixed(np.minimum.accumulate(following[:, ::-1], axis=1)[:, ::-1].copy())

    def link_margins(self, first: IntArray, second: IntArray, margin: float) -> FloatArray:
        """Return the gap that planning keeps between the surfaces of each of p pairs of links, shape (p,) [m].

        Links that are close together along the arm cannot keep the full margin around a tight bend. So the gap is the
        margin or, if smaller, the fraction ``LINK_MARGIN_SHARE`` of the gap between the two when the arm is straight.

        Args:
            first: indices of the links nearer to the base, shape (p,).
            second: indices of the links farther from the base, shape (p,).
            margin: full margin, which planning keeps from walls [m].
        """
        between = self.link_length * (self.margin_starts[second] - self.margin_ends[first])
        between = between - (self.radii[first] + self.radii[second])
        return np.clip(LINK_MARGIN_SHARE * between, 0.0, margin)


_Values = TypeVar("_Values", FloatArray, BoolArray, NextPairs)


def fixed(values: _Values) -> _Values:
    """Make an array read-only, and return it."""
    values.flags.writeable = False
    return values
