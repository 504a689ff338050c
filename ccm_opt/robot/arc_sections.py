"""Sections of an arm that bend evenly: arcs of constant curvature, each driven by two bends, as tendons drive them.

In the plane each is driven by one bend, and the same holds without the bends about y.

A section of length L is divided into n equal arcs. Each is the vertex of its two tangents: a joint in the middle, which
turns by the rotation vector (0, b, a) in the frame of the link before it. A link consists of the tangents of two
successive arcs, and the first and the last link of one, so that the first joint, at the base, does not bend. All arcs
of a section bend alike, by an n-th of the section's two bends. So the bends of the joints are C d, with the bends d of
the sections (the drives) and a constant matrix C; the ends of all arcs, with their directions, are those of the true
section, whatever its bends, and between them the arc is within h (1 − cos x) / (2 x) of its tangents, for its length h
and half of its turn x. The tangents are tan(x) / x times as long as half the arc. Where a body is fixed to the end of
an arc, the link is divided there: the joint between its two parts does not bend.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.robot.couplings import DriveCoupling

DEVIATION_SHARE = 0.1
"""Greatest distance of true arcs from links, as a fraction of the radius, for which sections are divided into links by
default. Heuristic: planning takes longer with more links, and keeps that distance from obstacles."""
_MOST_ARCS = 100
MOST_ARC_TURN = 0.5 * np.pi
"""Greatest turn of an arc [rad]; the tangents of one that turns by π do not meet."""


@dataclass(frozen=True)
class Tendons:
    """Tendons that bend a section, evenly spread about the arm's axis; they run from the base to the section's end.

    Attributes:
        radius: distance of the tendons from the axis [m].
        number: number of tendons.
        angle: angle of the first tendon about the axis, from left (y) towards up (z) of the straight arm [rad].
        travel: bound on how far the length of a tendon differs from that along the straight arm [m]; inf for no limit.
        speed: bound on the rate of change of the length of a tendon [m/s]; inf for no limit.
    """

    radius: float
    number: int = 3
    angle: float = 0.0
    travel: float = np.inf
    speed: float = np.inf

    @property
    def sides(self) -> FloatArray:
        """Positions of the tendons across the axis, towards left and up, shape (number, 2) [m]."""
        angles = self.angle + 2.0 * np.pi * np.arange(self.number) / self.number
        return self.radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)


@dataclass(frozen=True, eq=False)
class ArcSections(DriveCoupling):
    """The division of an arm into sections that bend evenly.

    Attributes:
        counts: number of arcs of each section, shape (s,).
        lengths: length of each section along its axis, shape (s,) [m].
        limits: bound on the absolute value of each bend of a whole section, shape (s,) [rad].
        radii: radius of the body about the arcs at both ends of each section, between which it tapers, (s, 2) [m].
        tendons: tendons of each section, if known; empty for none.
        straight: indices of the joints that do not bend, beside the first: those at bodies, and those of links that
            stand for bodies.
        bends: bends of a joint for unit bends of its section, times the number of arcs, shape (k, m): in space 2 × 2,
            in the plane 1 × 1, and 2 × 1 for a planar arm that is planned in space.
    """

    counts: IntArray
    lengths: FloatArray
    limits: FloatArray
    radii: FloatArray
    tendons: tuple[Tendons | None, ...] = ()
    straight: tuple[int, ...] = ()
    bends: FloatArray = field(default_factory=lambda: np.eye(2))

    @property
    def bends_a_section(self) -> int:
        """Number of bends that drive each section, 1 in the plane and 2 in space."""
        return int(self.bends.shape[1])

    @property
    def links(self) -> int:
        """Number of links: one more than there are arcs, and one for each further joint that does not bend."""
        return int(np.sum(self.counts)) + 1 + len(self.straight)

    @cached_property
    def section_of_joint(self) -> IntArray:
        """Index of the section to which each joint belongs, shape (links,); −1 for those that do not bend."""
        found = np.full(self.links, -1)
        found[self._bent] = np.repeat(np.arange(len(self.counts)), self.counts)
        return found

    @cached_property
    def _bent(self) -> IntArray:
        """Indices of the joints that bend, shape (arcs,)."""
        return np.setdiff1d(np.arange(1, self.links), self.straight)

    def link_ending_at(self, section: int, arc: int) -> int:
        """Return the index of the link that lies along an arc of a section, from 0, in which it ends."""
        return int(self._bent[int(np.sum(self.counts[:section])) + arc])

    def place_of(self, link: int) -> tuple[int, float]:
        """Return the section, from 0, in whose bending arcs a link ends, and the fraction of its length there."""
        section = int(self.section_of_joint[link])
        arc = int(np.sum(self.section_of_joint[: link + 1] == section))
        return section, arc / int(self.counts[section])

    @cached_property
    def arcs(self) -> FloatArray:
        """Half of the length of the arc about each joint, and 0 for the tip, shape (links + 1,) [m]."""
        return np.append(self._each(0.5 * self.lengths / self.counts), 0.0)

    @cached_property
    def link_lengths(self) -> FloatArray:
        """Length of each link of the straight arm, shape (links,) [m]."""
        return np.asarray(self.arcs[:-1] + self.arcs[1:])

    @cached_property
    def turn_limits(self) -> FloatArray:
        """Turn of the arc about each joint with all bends at their limits, and 0 for the tip, shape (links + 1,)."""
        return np.append(self._each(np.sqrt(self.bends_a_section) * self.limits / self.counts), 0.0)

    @cached_property
    def joint_limits(self) -> FloatArray:
        """Bound on the absolute value of each of a joint's bends, 0 if it does not bend, shape (links,) [rad]."""
        return self._each(self.limits / self.counts)

    def _each(self, values: FloatArray) -> FloatArray:
        """Return for each joint the value of its section, given for all, (s,), or 0 if it does not bend, (links,)."""
        found = np.zeros(self.links)
        found[self._bent] = np.repeat(values, self.counts)
        return found

    def name_at(self, joint: int) -> str:
        """Return the name in messages of the section to which a joint, or the link behind it, belongs."""
        bending = np.flatnonzero(self.section_of_joint[joint:] >= 0)
        section = self.section_of_joint[joint + bending[0]] if len(bending) else len(self.counts) - 1
        return f"section {section + 1}"

    def link_masses(self, masses: FloatArray) -> FloatArray:
        """Return the mass of each link, half of that of the arcs at both ends, for masses of sections, (s,) [kg]."""
        half = np.append(self._each(0.5 * masses / self.counts), 0.0)
        return np.asarray(half[:-1] + half[1:])

    @property
    def drive_names(self) -> tuple[str, ...]:
        """Names of the drives, the two bends of each section, such as ``section2_b``; in the plane ``section2``."""
        kinds = ("_a", "_b") if self.bends_a_section == 2 else ("",)
        return tuple(f"section{k + 1}{bend}" for k in range(len(self.counts)) for bend in kinds)

    @property
    def drive_order(self) -> IntArray:
        """Indices of the bends of all sections about up, then about left, shape (m s,)."""
        return np.arange(self.bends_a_section * len(self.counts)).reshape(len(self.counts), -1).T.ravel()

    @property
    def drive_limits(self) -> FloatArray:
        """Bound on the absolute value of each bend of each section, shape (m s,) [rad]."""
        return np.repeat(self.limits, self.bends_a_section)

    @property
    def drive_lengths(self) -> FloatArray:
        """Length of the section of each bend, shape (m s,) [m]."""
        return np.repeat(self.lengths, self.bends_a_section)

    @property
    def drive_scales(self) -> FloatArray:
        """Change of each bend that changes the bends of the joints by a unit in all, shape (m s,)."""
        return np.repeat(np.sqrt(self.counts), self.bends_a_section)

    @cached_property
    def coupling(self) -> FloatArray:
        """Derivatives of the bends of the joints with respect to those of the sections, shape (k links, m s)."""
        shares = np.zeros((self.links, len(self.counts)))
        bent = np.flatnonzero(self.section_of_joint >= 0)
        shares[bent, self.section_of_joint[bent]] = np.repeat(1.0 / self.counts, self.counts)
        return np.asarray(np.kron(shares, self.bends), dtype=np.float64)

    def at_joints(self, values: FloatArray) -> FloatArray:
        """Return for each joint the value of its section, of values of all sections or of each, shape (s,); (links,).

        The first joint, which does not bend, has that of the second.
        """
        each = np.broadcast_to(values, self.counts.shape)
        return np.asarray(each[np.maximum(self.section_of_joint, 0)])

    def of_drives(self, values: FloatArray) -> FloatArray:
        """Return the values of the drives, shape (m s,), which all revolutes of their section have, (3 links,)."""
        first = self._bent[np.cumsum(self.counts) - self.counts]
        # The bend in the plane is the second revolute.
        return np.asarray(values.reshape(-1, 3)[first, 2 - self.bends_a_section : 2].ravel())

    def _turns(self, drives: FloatArray) -> FloatArray:
        """Return the turns of the sections towards left and up, (..., s, 2) [rad], for drives of shape (..., m s)."""
        bends = drives.reshape(*drives.shape[:-1], len(self.counts), -1)
        if self.bends_a_section == 1:
            return np.concatenate((bends, np.zeros_like(bends)), axis=-1)
        return np.asarray(bends * np.array([1.0, -1.0]))

    def curvatures(self, drives: FloatArray) -> FloatArray:
        """Return the curvature of each section for drives of shape (..., m s), shape (..., s) [1/m]."""
        return np.asarray(np.linalg.norm(self._turns(drives), axis=-1) / self.lengths)

    def azimuths(self, drives: FloatArray) -> FloatArray:
        """Return the direction in which each section bends, from left (y) towards up (z), (..., s) [rad].

        In the plane it is 0 to the left and π to the right.

        Args:
            drives: bends of the sections, shape (..., m s) [rad].
        """
        turns = self._turns(drives)
        return np.asarray(np.arctan2(turns[..., 1], turns[..., 0]))

    def tendon_lengths(self, drives: FloatArray) -> FloatArray:
        """Return the lengths of all tendons, those of the first section first, shape (..., count) [m].

        A tendon at the position p across the axis is r p · u shorter than an arc of the turn r towards u. It keeps its
        position in all sections that it runs through, whose frames follow the axis without roll.

        Args:
            drives: bends of the sections, shape (..., m s) [rad].
        """
        turned = np.cumsum(self._turns(drives), axis=-2)
        along = np.cumsum(self.lengths)
        found = [
            along[k] - turned[..., k, :] @ tendons.sides.T
            for k, tendons in enumerate(self.tendons)
            if tendons is not None
        ]
        return np.concatenate(found, axis=-1) if found else np.zeros((*drives.shape[:-1], 0))

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names of all tendons, in the order of ``tendon_lengths``, such as ``section2_tendon1``."""
        given = ((k, each) for k, each in enumerate(self.tendons, start=1) if each is not None)
        return tuple(f"section{k}_tendon{j + 1}" for k, each in given for j in range(each.number))

    @cached_property
    def tendon_slopes(self) -> FloatArray:
        """Derivatives of the lengths of all tendons by the bends of the sections, shape (count, m s) [m/rad]."""
        straight = self.tendon_lengths(np.zeros(len(self.drive_names)))
        return np.stack([self.tendon_lengths(bends) - straight for bends in np.eye(len(self.drive_names))], axis=-1)

    def of_tendons(self, name: str) -> FloatArray:
        """Return an attribute of ``Tendons`` for each tendon, shape (count,)."""
        return np.array([getattr(each, name) for each in self.tendons if each is not None for _ in range(each.number)])

    @cached_property
    def travel_rows(self) -> FloatArray:
        """Fraction of its travel that each limited tendon takes for a unit of each joint's bends, (t, k links)."""
        travel = self.of_tendons("travel")
        limited = np.isfinite(travel)
        slopes = self.tendon_slopes[limited] / travel[limited, None]
        return np.asarray(slopes @ np.linalg.pinv(self.coupling))

    def tendon_tensions(self, torques: FloatArray) -> FloatArray:
        """Return the least tensions of all tendons that give the torques of the drives, shape (..., count) [N].

        A tendon at the position p gives all sections that it runs through the torque T p towards p, so that the tendons
        of a section give it what its torque exceeds that of the next one by. Tensions are at least zero, and of those
        of a section that together bend nothing, at least one is zero.

        Args:
            torques: torques of the drives, shape (..., m s) [N m].

        Returns:
            Tensions in the order of ``tendon_lengths``; without columns unless every section has tendons.
        """
        if len(self.tendons) < len(self.counts) or None in self.tendons:
            return np.zeros((*torques.shape[:-1], 0))
        bending = self._turns(torques)
        own = bending - np.concatenate((bending[..., 1:, :], np.zeros_like(bending[..., :1, :])), axis=-2)
        found = []
        for k, tendons in enumerate(self.tendons):
            if tendons is None:
                continue
            pulled = own[..., k, :] @ np.linalg.pinv(tendons.sides.T).T
            # Of an even number, opposite ones bend nothing together; of three, all of them.
            groups = 2 if tendons.number % 2 == 0 else 1
            parts = pulled.reshape(*pulled.shape[:-1], -1, tendons.number // 2 if groups == 2 else 1)
            found.append((parts - np.min(parts, axis=-2, keepdims=True)).reshape(pulled.shape))
        return np.concatenate(found, axis=-1)

    def tangents(self, turns: FloatArray, lengths: FloatArray) -> FloatArray:
        """Return the length of each link, along tangents of arcs that turn by angles, shape (..., links) [m].

        Args:
            turns: turns of the arcs about all joints, shape (..., links) [rad].
            lengths: length of each link of the straight arm, shape (links,) [m].
        """
        half = np.maximum(0.5 * np.abs(turns), 1e-8)
        grown = self.arcs[:-1] * (np.tan(half) / half - 1.0)
        beyond = np.concatenate((grown[..., 1:], np.zeros_like(grown[..., :1])), axis=-1)
        return np.asarray(lengths + grown + beyond)

    def longest_links(self) -> FloatArray:
        """Greatest length of each link within the limits, shape (links,) [m]."""
        half = np.maximum(0.5 * self.turn_limits, 1e-8)
        legs = self.arcs * np.tan(half) / half
        return np.asarray(legs[:-1] + legs[1:])

    @cached_property
    def link_radii(self) -> FloatArray:
        """Radius of a capsule about each link that contains the body about its true arcs, −∞ for none, (links,) [m].

        It is the radius of the body, plus the greatest distance of the arcs from the link within the limits.
        """
        tapers = zip(self.radii.tolist(), self.counts.tolist(), strict=True)
        ends = [np.linspace(first, last, count + 1) for (first, last), count in tapers]
        widest = np.concatenate([np.maximum(each[:-1], each[1:]) for each in ends])
        beside = np.full(self.links + 1, -np.inf)
        beside[self._bent] = widest + arc_deviation(2.0 * self.arcs, self.turn_limits)[self._bent]
        return np.asarray(np.maximum(beside[:-1], beside[1:]))


def fitting_arcs(length: float, turn: float, radius: float) -> int:
    """Return the number of arcs of a section whose links are within a tenth of the radius of their arcs.

    Args:
        length: length of the section, in the unit of the radius.
        turn: turn of the section with all bends at their limits [rad].
        radius: radius of the section's body, above 0.
    """
    count = max(int(np.ceil(turn / MOST_ARC_TURN)), 1)
    while arc_deviation(length / count, turn / count) > DEVIATION_SHARE * radius and count < _MOST_ARCS:
        count += 1
    return count


def arc_deviation(length: FloatArray | float, turn: FloatArray | float) -> FloatArray:
    """Return the greatest distance of arcs from the two tangents at their ends [m]; it grows with the turn.

    Args:
        length: length of each arc [m].
        turn: turn of each, at most π [rad].
    """
    # R (1 − cos x) with the radius R = length / 2 x and half the turn x.
    half = 0.5 * np.asarray(turn)
    return np.asarray(0.5 * length * np.sin(0.5 * half) * np.sinc(0.5 * half / np.pi))
