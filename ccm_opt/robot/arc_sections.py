"""Sections of an arm that bend evenly: arcs of constant curvature, each driven by two bends, as tendons drive them.

A section of length L is divided into n equal arcs. Each is the vertex of its two tangents: a joint in the middle, which
turns by the rotation vector (0, b, a) in the frame of the link before it. A link consists of the tangents of two
successive arcs, and the first and the last link of one, so that the first joint, at the base, does not bend. All arcs
of a section bend alike, by an n-th of the section's two bends. So the bends of the joints are C d, with the bends d of
the sections (the drives) and a constant matrix C; the ends of all arcs, with their directions, are those of the true
section, whatever its bends, and between them the arc is within h (1 − cos x) / (2 x) of its tangents, for its length h
and half of its turn x. The tangents are tan(x) / x times as long as half the arc.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray

MOST_ARC_TURN = 0.5 * np.pi
"""Greatest turn of an arc [rad]; the tangents of one that turns by π do not meet."""


@dataclass(frozen=True, eq=False)
class ArcSections:
    """The division of an arm into sections that bend evenly.

    Attributes:
        counts: number of arcs of each section, shape (s,).
        lengths: length of each section along its axis, shape (s,) [m].
        limits: bound on the absolute value of each of the two bends of a whole section, shape (s,) [rad].
        radii: radius of the body about the arcs at both ends of each section, between which it tapers, (s, 2) [m].
    """

    counts: IntArray
    lengths: FloatArray
    limits: FloatArray
    radii: FloatArray

    @property
    def links(self) -> int:
        """Number of links: one more than there are arcs."""
        return int(np.sum(self.counts)) + 1

    @cached_property
    def section_of_joint(self) -> IntArray:
        """Index of the section to which each joint belongs, shape (links,); −1 for the first, which does not bend."""
        return np.concatenate(([-1], np.repeat(np.arange(len(self.counts)), self.counts)))

    @cached_property
    def arcs(self) -> FloatArray:
        """Half of the length of the arc about each joint, and 0 for the tip, shape (links + 1,) [m]."""
        return np.concatenate(([0.0], np.repeat(0.5 * self.lengths / self.counts, self.counts), [0.0]))

    @cached_property
    def link_lengths(self) -> FloatArray:
        """Length of each link of the straight arm, shape (links,) [m]."""
        return np.asarray(self.arcs[:-1] + self.arcs[1:])

    @cached_property
    def turn_limits(self) -> FloatArray:
        """Turn of the arc about each joint with both bends at their limits, and 0 for the tip, shape (links + 1,)."""
        return np.concatenate(([0.0], np.repeat(np.sqrt(2.0) * self.limits / self.counts, self.counts), [0.0]))

    @cached_property
    def joint_limits(self) -> FloatArray:
        """Bound on the absolute value of each of a joint's two bends, 0 of the first joint, shape (links,) [rad]."""
        return np.concatenate(([0.0], np.repeat(self.limits / self.counts, self.counts)))

    @property
    def drive_names(self) -> tuple[str, ...]:
        """Names of the drives, the two bends of each section, such as ``section2_b``."""
        return tuple(f"section{k + 1}_{bend}" for k in range(len(self.counts)) for bend in "ab")

    @cached_property
    def coupling(self) -> FloatArray:
        """Derivatives of the bends of the joints with respect to those of the sections, shape (2 links, 2 s)."""
        shares = np.zeros((self.links, len(self.counts)))
        joints = np.arange(1, self.links)
        shares[joints, self.section_of_joint[1:]] = np.repeat(1.0 / self.counts, self.counts)
        return np.asarray(np.kron(shares, np.eye(2)), dtype=np.float64)

    def drives(self, bends: FloatArray) -> FloatArray:
        """Return the bends of the sections, shape (..., 2 s), nearest to bends of the joints, (..., 2 links) [rad].

        The map is linear, so it also applies to velocities and accelerations.
        """
        return np.asarray(bends @ np.linalg.pinv(self.coupling).T)

    def misfit(self, bends: FloatArray) -> float:
        """Return by how much bends of the joints, (..., 2 links), differ from the nearest of the sections, at most."""
        return float(np.max(np.abs(bends - self.drives(bends) @ self.coupling.T)))

    def longest_links(self) -> FloatArray:
        """Greatest length of each link within the limits, shape (links,) [m]."""
        half = np.maximum(0.5 * self.turn_limits, 1e-8)
        legs = self.arcs * np.tan(half) / half
        return np.asarray(legs[:-1] + legs[1:])

    @cached_property
    def link_radii(self) -> FloatArray:
        """Radius of a capsule about each link that contains the body about its true arcs, shape (links,) [m].

        It is the radius of the body, plus the greatest distance of the arcs from the link within the limits.
        """
        tapers = zip(self.radii.tolist(), self.counts.tolist(), strict=True)
        ends = [np.linspace(first, last, count + 1) for (first, last), count in tapers]
        widest = np.concatenate([np.maximum(each[:-1], each[1:]) for each in ends])
        beside = np.concatenate(([0.0], widest, [0.0])) + arc_deviation(2.0 * self.arcs, self.turn_limits)
        return np.maximum(beside[:-1], beside[1:])


def arc_deviation(length: FloatArray | float, turn: FloatArray | float) -> FloatArray:
    """Return the greatest distance of arcs from the two tangents at their ends [m]; it grows with the turn.

    Args:
        length: length of each arc [m].
        turn: turn of each, at most π [rad].
    """
    # R (1 − cos x) with the radius R = length / 2 x and half the turn x.
    half = 0.5 * np.asarray(turn)
    return np.asarray(0.5 * length * np.sin(0.5 * half) * np.sinc(0.5 * half / np.pi))
