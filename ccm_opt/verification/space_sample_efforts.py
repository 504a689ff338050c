"""Torques between samples in space, bounded.

Everything is bounded by the samples beside it and by the limits on accelerations. Vectors leave what is linear between
samples by at most an eighth of the square of the step times their second derivative.

As in the plane (``verification/sample_efforts.py``) second difference quotients are exact means of accelerations, and
what is reckoned is by how much the mean of a product may differ from the product of the means. In space a torque is a
product of three: axis, lever and force. It is theorem 16 of ``docs/theory.md``.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.checked_problem import joint_of_bend, revolutes_of_bends
from ccm_opt.verification.newton_euler import of_bends
from ccm_opt.verification.sample_efforts import (
    HoldingEfforts,
    allowed_beside,
    bounds_of_bodies,
    force_check,
    torque_check,
)
from ccm_opt.verification.space_chain_motion import LinkFrames, SpaceChainMotion
from ccm_opt.verification.stretch_proof import HatMeans
from ccm_opt.verification.verification_settings import VerificationSettings

_REFINEMENTS = 2
"""How often a bound on how fast links turn is put into itself: each makes it smaller, and the third by little."""


@dataclass(frozen=True)
class Factors:
    """Bounds on products lever × force, each array of shape (n,), the force without its mass.

    Attributes:
        shares: of the products: masses, or moments of inertia.
        longest: greatest lengths of the levers.
        bows: how far levers leave what is linear between samples.
        spread: root mean square of how far levers are from their means.
        mean: sizes of the mean forces.
        unsteady: root mean square of how far forces are from their means.
    """

    shares: FloatArray
    longest: FloatArray
    bows: FloatArray
    spread: FloatArray
    mean: FloatArray
    unsteady: FloatArray

    @property
    def error(self) -> float:
        """How far the mean of the products may be from the product of the means."""
        return float(self.shares @ (self.spread * self.unsteady + self.bows * self.mean))

    @property
    def own_spread(self) -> float:
        """Root mean square of how far the sum of the products is from its mean."""
        return float(self.shares @ (self.longest * self.unsteady + self.spread * self.mean))


@dataclass(frozen=True)
class SampleBounds:
    """Bounds around one inner sample.

    Attributes:
        problem: arm, gravity, and the limits on accelerations.
        motion: the motion.
        frames: of its samples.
        bodies: where the masses are at the samples, shape (T, links + 1, 3) [m].
        sample: number of the inner sample, from 0.
    """

    problem: Problem
    motion: SpaceChainMotion
    frames: LinkFrames
    bodies: FloatArray
    sample: int

    def of_torque(self, joint: int, bend: int, axis: FloatArray, moment: float) -> float:
        """How far the mean torque of a bend may be from the one by means [N m].

        Args:
            joint: number of the joint, from 0.
            bend: number of the bend, from 0.
            axis: about which it turns, at the three samples, shape (3, 3).
            moment: size of the mean moment about the joint [N m].
        """
        arm = self.problem.arm
        masses = self._masses_beyond(joint)
        turning = self._turning_beyond(joint)
        error = masses.error + turning.error
        # The first bend turns about an axis of the link before, which at the base stands still; the second about one
        # of its own link.
        carrier = joint if bend % 2 else joint - 1
        bow = self._eighth * float(self._curving[carrier]) if carrier >= 0 else 0.0
        stray = float(np.sqrt(self._hat.variance(axis))) + bow
        turned = bow * (moment + error) + stray * (masses.own_spread + turning.own_spread)
        spinning = float(arm.inertia_axial[joint:] @ self._curving[joint:])
        rubbing = float(of_bends(arm, arm.friction)[bend]) * float(self._accelerations[joint, bend % 2]) * self._longest
        return error + turned + spinning + rubbing + self._held(joint, axis, bow) + self._rounded(masses, bend, moment)

    def _masses_beyond(self, joint: int) -> Factors:
        arm = self.problem.arm
        lever = self._levers(joint)
        bow = self._eighth * self._bounds_beyond(joint)
        gain = self._hat.second(self.bodies[self._within, joint:])[0]
        at_all = bounds_of_bodies(arm.link_length * self._curving)[joint:]
        at_all = at_all + (self.problem.limits.feed_acceleration or 0.0)
        return Factors(
            np.append(arm.masses, arm.payload)[joint:],
            np.max(np.linalg.norm(lever, axis=2), axis=0) + bow,
            bow,
            np.sqrt(self._hat.variance(lever)) + bow,
            np.linalg.norm(gain - self.problem.simulation.gravity, axis=1),
            _unsteady(at_all, gain),
        )

    def _turning_beyond(self, joint: int) -> Factors:
        """Links that are turned: their directions stand for levers, how these are bent for forces."""
        along = self.frames.along[self._within, joint:]
        bow = self._eighth * self._curving[joint:]
        gain = self._hat.second(along)[0]
        return Factors(
            self.problem.arm.inertia_transverse[joint:],
            np.ones(len(bow)),
            bow,
            np.sqrt(self._hat.variance(along)) + bow,
            np.linalg.norm(gain, axis=1),
            _unsteady(self._curving[joint:], gain),
        )

    def _held(self, joint: int, axis: FloatArray, bow: float) -> float:
        """By how much what holds the arm still can be more between samples than at them [N m].

        The share of a limit that a plan may use grows with it.
        """
        arm = self.problem.arm
        masses = np.append(arm.masses, arm.payload)[joint:]
        moments = np.cross(np.einsum("m,kmd->kd", masses, self._levers(joint)), self.problem.simulation.gravity)
        weight = float(np.linalg.norm(self.problem.simulation.gravity))
        own = self._eighth * weight * float(masses @ self._bounds_beyond(joint))
        both = np.linalg.norm(np.diff(axis, axis=0), axis=1) * np.linalg.norm(np.diff(moments, axis=0), axis=1)
        return float(0.25 * np.max(both) + own + bow * (np.max(np.linalg.norm(moments, axis=1)) + own))

    def _rounded(self, masses: Factors, bend: int, moment: float) -> float:
        arm = self.problem.arm
        before, after = (float(step[0]) for step in self._hat.steps)
        place = self.motion.rounding
        turning = float(np.sum(arm.inertia_transverse[bend // 2 :]) + of_bends(arm, arm.rotor_inertia)[bend])
        noise = 4.0 * place / (before * after) * (float(masses.shares @ masses.longest) + turning / arm.link_length)
        # Directions are off by less than places by a link's length.
        return noise + 2.0 * place * float(masses.shares @ masses.mean) + place / arm.link_length * moment

    def _levers(self, joint: int) -> FloatArray:
        """From a joint to the masses beyond it, at the three samples, shape (3, n, 3) [m]."""
        return np.asarray(self.bodies[self._within, joint:] - self.motion.points[self._within, joint : joint + 1])

    def _bounds_beyond(self, joint: int) -> FloatArray:
        """Bounds on the second derivatives of those levers, shape (n,) [m/s²]."""
        arm = self.problem.arm
        beyond = np.where(np.arange(arm.links) >= joint, arm.link_length * self._curving, 0.0)
        return bounds_of_bodies(beyond)[joint:]

    @cached_property
    def _curving(self) -> FloatArray:
        """Bound on second derivatives of the axes of each link, which turn with it, shape (links,) [1/s²].

        ω̇ × e + ω × (ω × e) is at most |ω̇| + |ω|². How fast links turn is known by how far their axes go from sample to
        sample, but for a step times that bound, which a bound that only adds up the joints begins with.
        """
        frames = np.stack((self.frames.along, self.frames.second_axes, self.frames.across))[:, self._within]
        step = np.diff(self.motion.time[self._within])
        # |ω|² is half the sum of |ω × e|² over three axes.
        gone = np.sqrt(0.5 * np.sum(np.diff(frames, axis=1) ** 2, axis=(0, 3)))
        mean = np.max(gone / step[:, None], axis=0)
        rates = self._rates
        turn = np.cumsum(np.hypot(rates[:, 0], rates[:, 1]))
        curving = self._growth(turn) + turn**2
        for _ in range(_REFINEMENTS):
            turn = np.minimum(turn, mean + np.sqrt(1.5) * self._longest * curving)
            curving = self._growth(turn) + turn**2
        return np.asarray(curving)

    def _growth(self, turn: FloatArray) -> FloatArray:
        """Bound on angular accelerations of the links, from one on how fast they turn, shape (links,) [rad/s²]."""
        first, second = self._rates.T
        before = np.concatenate(([0.0], turn[:-1]))
        # The two axes of a joint are across each other, and turn with what carries them.
        gains = np.hypot(self._accelerations[:, 0], self._accelerations[:, 1])
        return np.cumsum(gains + first * before + second * (before + first))

    @cached_property
    def _rates(self) -> FloatArray:
        """Bounds on the rates of the bends, shape (links, 2) [rad/s]."""
        bends = self.motion.positions[self._within, : 2 * self.problem.arm.links]
        means = np.abs(np.diff(bends, axis=0)) / np.diff(self.motion.time[self._within])[:, None]
        return np.asarray(np.max(means, axis=0).reshape(-1, 2) + self._longest * self._accelerations)

    @property
    def _accelerations(self) -> FloatArray:
        """Limits of the bends, shape (links, 2) [rad/s²]."""
        return self.problem.limits.acceleration.reshape(-1, 3)[:, :2]

    @property
    def _longest(self) -> float:
        return float(np.max(np.diff(self.motion.time[self._within])))

    @property
    def _eighth(self) -> float:
        return self._longest**2 / 8.0

    @property
    def _within(self) -> slice:
        return slice(self.sample, self.sample + 3)

    @property
    def _hat(self) -> HatMeans:
        return HatMeans(self.motion.time).at(self.sample)


def _unsteady(at_all: FloatArray, mean: FloatArray) -> FloatArray:
    """Root mean square of how far vectors of bounded size are from their means (n, 3)."""
    return np.asarray(np.sqrt(np.maximum(at_all**2 - np.sum(mean**2, axis=1), 0.0)))


def check_space_sample_efforts(
    problem: Problem,
    motion: SpaceChainMotion,
    trajectory: JointTrajectory,
    holding: HoldingEfforts,
    settings: VerificationSettings,
) -> list[Check]:
    """Check the torques of the bends, and the force on a feed axis, that the samples take by themselves.

    A check holds unless every motion through the samples, with accelerations within their limits, passes the limit of
    an effort. ``worst`` is the effort by differences, ``limit`` the limit with what differences may be off.
    """
    limits = problem.limits
    if len(trajectory.time) < 3:
        return []
    checks = []
    means = SpaceSampleMeans(problem, motion)
    torques, forces = holding
    if limits.torque is not None:
        bending = revolutes_of_bends(trajectory.coordinates)
        allowed = allowed_beside(torques[:, bending], limits.torque[bending], problem)
        checks.append(_torque_check(means, trajectory, allowed, settings))
    if limits.feed_force is not None:
        for name, held in zip(trajectory.coordinates.base_names, forces.T, strict=True):
            allowed = allowed_beside(held[:, None], np.array([limits.feed_force]), problem)[:, 0]
            checks.append(force_check(name, means, trajectory.time, allowed, settings))
    return checks


def _torque_check(
    means: "SpaceSampleMeans", trajectory: JointTrajectory, allowed: FloatArray, settings: VerificationSettings
) -> Check:
    efforts = np.abs(means.torques)
    limit = allowed * (1.0 + settings.limit_tolerance)
    # The bound is worth its price only where the effort by differences passes the limit.
    for sample, bend in np.argwhere(efforts > limit):
        limit[sample, bend] += means.torque_error(int(sample), int(bend))
    coordinates = trajectory.coordinates
    time = trajectory.time
    return torque_check(efforts, limit, lambda k, j: f"{joint_of_bend(coordinates, j)} at t = {time[k + 1]:.4f} s")


@dataclass(frozen=True)
class SpaceSampleMeans:
    """Means of efforts around the inner samples, T − 2 of them, by the samples' places and times alone.

    Attributes:
        problem: arm, gravity, and the limits on accelerations.
        motion: the motion, of at least three samples.
    """

    problem: Problem
    motion: SpaceChainMotion

    @cached_property
    def torques(self) -> FloatArray:
        """Mean torques of the bends, shape (T − 2, 2 * links) [N m]."""
        arm = self.problem.arm
        hat = self._hat
        moments = self._moments
        first = np.sum(hat.mean(self._frames.first_axes) * moments, axis=2)
        second = np.sum(hat.mean(self._frames.second_axes) * moments, axis=2)
        bends = self.motion.positions[:, : 2 * arm.links]
        drives = of_bends(arm, arm.rotor_inertia) * hat.second(bends)
        drives += of_bends(arm, arm.friction) * hat.first(bends)
        return np.asarray(np.stack((first, second), axis=2).reshape(len(moments), -1) + drives)

    @property
    def force(self) -> FloatArray:
        """Mean force along the base's direction, shape (T − 2,) [N]; no lever is in it, so that it is exact."""
        return np.asarray(np.sum(self._forces, axis=1) @ self.problem.arm.direction)

    @property
    def force_errors(self) -> FloatArray:
        """What rounding can have added to the mean force, shape (T − 2,) [N]."""
        before, after = self._hat.steps
        return np.asarray(4.0 * self.motion.rounding / (before * after) * np.sum(self._masses))

    def torque_error(self, sample: int, bend: int) -> float:
        """How far a mean torque may be from the mean that every motion through the samples has [N m].

        Args:
            sample: number of an inner sample, from 0.
            bend: number of a bend, from 0.
        """
        joint = bend // 2
        axes = self._frames.second_axes if bend % 2 else self._frames.first_axes
        moment = float(np.linalg.norm(self._moments[sample, joint]))
        bounds = SampleBounds(self.problem, self.motion, self._frames, self._bodies, sample)
        return bounds.of_torque(joint, bend, axes[sample : sample + 3, joint], moment)

    @cached_property
    def _moments(self) -> FloatArray:
        """Mean moments about the joints, without what links take to spin about themselves, (T − 2, links, 3) [N m]."""
        hat = self._hat
        links = self.problem.arm.links
        forces = self._forces
        # Σ over the masses beyond joint i of (lever × force), the lever r − pᵢ, in two sums from the tip.
        own = _from_tip(np.cross(hat.mean(self._bodies), forces))[:, :links]
        beyond = _from_tip(forces)[:, :links]
        along = self._frames.along
        turning = self.problem.arm.inertia_transverse[:, None] * np.cross(hat.mean(along), hat.second(along))
        return np.asarray(own - np.cross(hat.mean(self.motion.points[:, :-1]), beyond) + _from_tip(turning))

    @cached_property
    def _forces(self) -> FloatArray:
        """Mean forces that the masses need, shape (T − 2, links + 1, 3) [N]."""
        gains = self._hat.second(self._bodies) - self.problem.simulation.gravity
        return np.asarray(self._masses[:, None] * gains)

    @property
    def _masses(self) -> FloatArray:
        """Of the links, and the payload, shape (links + 1,) [kg]."""
        return np.append(self.problem.arm.masses, self.problem.arm.payload)

    @cached_property
    def _bodies(self) -> FloatArray:
        """Where the masses are: the middles of the links, and the tip, shape (T, links + 1, 3) [m]."""
        points = self.motion.points
        return np.concatenate((0.5 * (points[:, :-1] + points[:, 1:]), points[:, -1:]), axis=1)

    @cached_property
    def _frames(self) -> LinkFrames:
        return LinkFrames.of(self.problem.arm, self.motion.positions)

    @property
    def _hat(self) -> HatMeans:
        return HatMeans(self.motion.time)


def _from_tip(values: FloatArray) -> FloatArray:
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
