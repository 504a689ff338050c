"""Checks of efforts that the samples' positions and times alone require, whatever happens between the samples.

A plan may use the fraction σ of the limits on velocity, acceleration, jerk and effort of all drives. Where holding the
arm still takes the fraction h of an effort limit, the effort may use max(σ, h + ½ σ (1 − h)) of it.
``robot.coordinates`` implements the same rule; the verifier deliberately does not use that code.

The second difference quotient of a position is the mean of its acceleration over the two steps around a sample,
weighted by the hat function w that peaks at the sample and vanishes at its neighbours. A moment is a product of a lever
and a force, so its mean differs from the product of the means; that difference is bounded here. What exceeds the bound
is a mean effort that *every* motion through the samples requires, so its peak effort is at least as great.

Theorems, assumptions and proofs are in ``docs/guarantees.md``: theorem 9 for the plane, where all joint axes are
parallel, and theorem 16 for space, where a torque is a product of axis, lever and force. All bounds follow from the
neighbouring samples and the acceleration limits. Vectors deviate from linear interpolation between samples by at most
an eighth of the square of the step times their second derivative.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.verification.attached_masses import PointMasses, all_masses, mass_links
from ccm_opt.verification.base_motion import cross
from ccm_opt.verification.chain_motion import ChainMotion, LinkFrames, bend_pairs
from ccm_opt.verification.drives import bend_revolutes, check_worst, describe_bend_joints, sample_words
from ccm_opt.verification.limits import allowed_share
from ccm_opt.verification.newton_euler import from_tip
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

_REFINEMENTS = 2
"""Number of iterations that tighten the bound on link rates; a third would hardly change the bound."""


@dataclass(frozen=True)
class HatMeans:
    """Means around the T − 2 inner samples, weighted by a hat function, of values given at all samples, shape (T, …).

    The weight of an inner sample is 1 at that sample and falls linearly to 0 at both of its neighbours.

    Attributes:
        time: times of the samples, shape (T,) [s].
    """

    time: FloatArray

    @property
    def steps(self) -> tuple[FloatArray, FloatArray]:
        """Durations of the time steps before and after each inner sample, each of shape (T − 2,) [s]."""
        step = np.diff(self.time)
        return step[:-1], step[1:]

    def mean(self, values: FloatArray) -> FloatArray:
        """Return the weighted means of values that are linear between samples, shape (T − 2, …)."""
        before, after = self._beside(values)
        change = after * (values[2:] - values[1:-1]) + before * (values[:-2] - values[1:-1])
        return np.asarray(values[1:-1] + change / (3.0 * (before + after)))

    def first(self, values: FloatArray) -> FloatArray:
        """Return the weighted means of first derivatives, which are mean rates over both steps, shape (T − 2, …)."""
        before, after = self._beside(values)
        return np.asarray((values[2:] - values[:-2]) / (before + after))

    def second(self, values: FloatArray) -> FloatArray:
        """Return the second difference quotients, which equal the weighted means of second derivatives, (T − 2, …)."""
        before, after = self._beside(values)
        rates = np.diff(values, axis=0)
        return np.asarray(2.0 * (rates[1:] / after - rates[:-1] / before) / (before + after))

    def at(self, sample: int) -> "HatMeans":
        """Return an object for the weighted means around a single inner sample, whose index counts from 0."""
        return HatMeans(self.time[sample : sample + 3])

    def variance(self, values: FloatArray) -> FloatArray:
        """Return bounds on the mean square deviation of vectors from their weighted means, shape (…).

        This applies only to the means around a single inner sample, so the vectors are given at three samples: (3, …,
        d).
        """
        before, after = (float(step[0]) for step in self.steps)
        # The square is convex, so linear interpolation between samples is an upper bound.
        weights = np.array([before, 2.0 * (before + after), after]) / (3.0 * (before + after))
        away = np.sum((values - self.mean(values)) ** 2, axis=-1)
        return np.asarray(np.tensordot(weights, away, axes=1))

    def _beside(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        before, after = (step.reshape(-1, *[1] * (values.ndim - 1)) for step in self.steps)
        return before, after


def check_sample_efforts(
    problem: Problem,
    motion: ChainMotion,
    trajectory: JointTrajectory,
    holding: FloatArray,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check the bend torques and feed forces that the positions and times of the samples alone require.

    A check fails only if every motion through the samples, with accelerations within their limits, exceeds an effort
    limit. The worst value is the effort from difference quotients; the limit includes the possible error of that
    effort.

    Args:
        problem: the problem that the motion is to solve.
        motion: the motion, linear between its T samples.
        trajectory: the same motion, with the layout of its coordinates.
        holding: efforts of all drives that hold the arm still at the samples, shape (T, drives) [N m, N].
        settings: the tolerance of limits.
    """
    limits = problem.limits
    time = trajectory.time
    # The bounds on the error are those of a base that does not turn, of links of constant lengths, and of one drive a
    # bend.
    if len(time) < 3 or problem.arm.carrier or problem.arm.drives is not None:
        return []
    checks = []
    means = SampleMeans(problem, motion)
    layout = trajectory.coordinates
    if limits.torque is not None:
        bending = bend_revolutes(layout)
        allowed = _allowed_beside(holding[:, bending], limits.torque[bending], problem)
        efforts = np.abs(means.torques)
        limit = allowed * (1.0 + settings.limit_tolerance)
        # The error bound is costly, so it is computed only where the effort exceeds the limit.
        for sample, bend in np.argwhere(efforts > limit):
            limit[sample, bend] += means.torque_error(int(sample), int(bend))
        where = sample_words(time[1:], describe_bend_joints(layout))
        checks.append(check_worst("joint torque of the samples", "N m", efforts, limit, where))
    if limits.feed_force is not None:
        allowed = _allowed_beside(holding[:, layout.revolutes :], np.array(limits.feed_force), problem)
        limit = allowed * (1.0 + settings.limit_tolerance) + means.force_errors[:, None]
        for name, bound in zip(layout.base_names, limit.T, strict=True):
            checks.append(check_worst(f"{name} force of the samples", "N", means.force, bound, sample_words(time[1:])))
    return checks


def _allowed_beside(held: FloatArray, limit: FloatArray, problem: Problem) -> FloatArray:
    """Return the greatest effort allowed in the two steps around each inner sample, shape (T − 2, N) [N m or N].

    Args:
        held: efforts of N drives that hold the arm still at the samples, shape (T, N).
        limit: effort limit of each drive, shape (N,), or common to all drives.
        problem: the problem, which sets the fraction of the limits that plans may use.
    """
    allowed = limit * allowed_share(np.minimum(np.abs(held) / limit, 1.0), problem.planner.effort_share)
    return np.asarray(np.maximum(np.maximum(allowed[:-2], allowed[1:-1]), allowed[2:]))


@dataclass(frozen=True)
class SampleMeans:
    """Mean efforts around the T − 2 inner samples, computed from the positions and times of the samples alone.

    Attributes:
        problem: the problem, with arm, gravity and acceleration limits.
        motion: the motion, with T ≥ 3 samples.
    """

    problem: Problem
    motion: ChainMotion

    @cached_property
    def torques(self) -> FloatArray:
        """Mean torques of the revolutes that bend the arm, shape (T − 2, bends) [N m]."""
        arm = self.problem.arm
        hat = self._hat
        axes = (self._frames.first_axes, self._frames.second_axes)
        pairs = bend_pairs(arm, self.motion.positions)
        torques = np.zeros((len(pairs) - 2, *pairs.shape[1:]))
        bending = bend_revolutes(arm.coordinates)
        for revolute in np.unique(bending % 3):
            torques[..., revolute] = np.einsum("tld,tld->tl", hat.mean(axes[revolute]), self._moments)
        torques += _of_bends(arm.rotor_inertia, arm.links) * hat.second(pairs)
        torques += _of_bends(arm.friction, arm.links) * hat.first(pairs)
        return np.asarray(torques[:, bending // 3, bending % 3])

    @property
    def force(self) -> FloatArray:
        """Mean force along the base's direction, shape (T − 2,) [N]; exact, as no lever arms enter."""
        return np.asarray(np.sum(self._forces, axis=1) @ self.problem.arm.base_rotation[:, 0])

    @property
    def force_errors(self) -> FloatArray:
        """Bound on the rounding error of the mean force, shape (T − 2,) [N]."""
        before, after = self._hat.steps
        return np.asarray(4.0 * self.motion.rounding / (before * after) * np.sum(self._masses))

    def torque_error(self, sample: int, bend: int) -> float:
        """Return a bound on the difference of a mean torque from that of any motion through the samples [N m].

        Args:
            sample: index of an inner sample, from 0.
            bend: index of a bend, from 0.
        """
        joint, revolute = divmod(int(bend_revolutes(self.problem.arm.coordinates)[bend]), 3)
        axes = (self._frames.first_axes, self._frames.second_axes)[revolute]
        moment = float(np.linalg.norm(self._moments[sample, joint]))
        bounds = SampleBounds(self.problem, self.motion, self._frames, self._bodies, sample)
        return bounds.of_torque(joint, revolute, axes[sample : sample + 3, joint], moment)

    @cached_property
    def _moments(self) -> FloatArray:
        """Mean moments about the joints, shape (T − 2, links, 3) [N m].

        The moments that spin links about their own axes are not included.
        """
        hat = self._hat
        arm = self.problem.arm
        forces = self._forces
        # Σ over the masses beyond joint i of lever × force, with lever r − pᵢ, as two sums from the tip.
        own = from_tip(self._by_link(cross(hat.mean(self._bodies), forces)))[:, : arm.links]
        beyond = from_tip(self._by_link(forces))[:, : arm.links]
        joints = arm.embedded(self.motion.points[:, :-1])
        moments = own - cross(hat.mean(joints), beyond)
        if arm.dimension == 2:
            # All links turn about one direction, so their mean angular accelerations are exact.
            turned = np.cumsum(bend_pairs(arm, self.motion.positions)[..., 1], axis=1)
            turning = hat.second(turned)[..., None] * arm.base_rotation[:, 1]
        else:
            turning = cross(hat.mean(self._frames.along), hat.second(self._frames.along))
        return np.asarray(moments + from_tip(arm.inertia_transverse[:, None] * turning))

    @cached_property
    def _forces(self) -> FloatArray:
        """Mean forces that accelerate the masses and support their weight, shape (T − 2, masses, 3) [N]."""
        gains = self._hat.second(self._bodies) - self.problem.simulation.gravity
        return np.asarray(self._masses[:, None] * gains)

    def _by_link(self, values: FloatArray) -> FloatArray:
        """Add up values of the masses (T, masses, 3) by link, with the payload's last, shape (T, links + 1, 3)."""
        links = self.problem.arm.links
        summed = values[:, : links + 1].copy()
        added = values[:, links + 1 :].swapaxes(0, 1)
        np.add.at(summed.swapaxes(0, 1), mass_links(self.problem.arm)[links + 1 :], added)
        return summed

    @property
    def _masses(self) -> FloatArray:
        """Masses of the links, the payload and what is fixed to links, shape (masses,) [kg]."""
        return all_masses(self.problem.arm)

    @cached_property
    def _bodies(self) -> FloatArray:
        """Positions of the point masses, at link midpoints, the tip and what is fixed to links, (T, masses, 3) [m]."""
        points = self.motion.points
        bodies = np.concatenate((0.5 * (points[:, :-1] + points[:, 1:]), points[:, -1:]), axis=1)
        fixed = PointMasses.of(self.problem.arm)
        frames = self._frames
        left = cross(frames.across, frames.along)
        ends = self.problem.arm.embedded(points[:, 1:])[:, fixed.link]
        out = ends + fixed.turned(frames.along, left, frames.across)
        return np.concatenate((self.problem.arm.embedded(bodies), out), axis=1)

    @cached_property
    def _frames(self) -> LinkFrames:
        return LinkFrames.from_configurations(self.problem.arm, self.motion.positions)

    @property
    def _hat(self) -> HatMeans:
        return HatMeans(self.motion.time)


def _of_bends(drives: FloatArray | float, links: int) -> FloatArray:
    """Return a drive property of the first two revolutes of each ball joint, shape (links, 2)."""
    return np.broadcast_to(np.asarray(drives, dtype=np.float64), (3 * links,)).reshape(-1, 3)[:, :2]


@dataclass(frozen=True)
class Factors:
    """Bounds on n products of a lever and a force, each array of shape (n,), with forces per unit of mass or inertia.

    Attributes:
        shares: weights of the products: masses, or moments of inertia.
        longest: bounds on the lengths of the levers.
        bows: bounds on the deviation of the levers from linear interpolation between samples.
        spread: bounds on the root mean square deviation of the levers from their means.
        mean: magnitudes of the mean forces.
        unsteady: bounds on the root mean square deviation of the forces from their means.
    """

    shares: FloatArray
    longest: FloatArray
    bows: FloatArray
    spread: FloatArray
    mean: FloatArray
    unsteady: FloatArray

    @property
    def error(self) -> float:
        """Bound on the difference between the mean of all products and the product of the means, as a weighted sum."""
        return float(self.shares @ (self.spread * self.unsteady + self.bows * self.mean))

    @property
    def own_spread(self) -> float:
        """Bound on the root mean square deviation of the sum of all products from its mean."""
        return float(self.shares @ (self.longest * self.unsteady + self.spread * self.mean))


@dataclass(frozen=True)
class SampleBounds:
    """Error bounds of the mean torques around one inner sample.

    Attributes:
        problem: the problem, with arm, gravity and acceleration limits.
        motion: the motion, with T samples.
        frames: link frames at the samples.
        bodies: positions of the point masses at the samples, shape (T, masses, 3) [m].
        sample: index of the inner sample, from 0.
    """

    problem: Problem
    motion: ChainMotion
    frames: LinkFrames
    bodies: FloatArray
    sample: int

    def of_torque(self, joint: int, revolute: int, axis: FloatArray, moment: float) -> float:
        """Return a bound on the error of the mean torque of a revolute joint [N m].

        Args:
            joint: index of the ball joint, from 0.
            revolute: 0 or 1 for the ball joint's first or second revolute.
            axis: axis of the revolute at the three samples, shape (3, 3).
            moment: magnitude of the mean moment about the joint [N m].
        """
        arm = self.problem.arm
        masses = self._masses_beyond(joint)
        error = masses.error
        bow = 0.0
        turned = 0.0
        # In the plane the axes are fixed, and the mean angular accelerations of the links are exact.
        if arm.dimension == 3:
            turning = self._turning_beyond(joint)
            error += turning.error
            # The first axis belongs to the preceding link, or to the base, which is fixed; the second to the joint's
            # own link.
            carrier = joint if revolute else joint - 1
            bow = self._eighth * float(self._curving[carrier]) if carrier >= 0 else 0.0
            stray = float(np.sqrt(self._hat.variance(axis))) + bow
            turned = bow * (moment + error) + stray * (masses.own_spread + turning.own_spread)
            turned += float(arm.inertia_axial[joint:] @ self._curving[joint:])
        friction = float(_of_bends(arm.friction, arm.links)[joint, revolute])
        rubbing = friction * float(self._accelerations[joint, revolute]) * self._longest
        held = self._held(joint, axis, bow)
        return error + turned + rubbing + held + self._rounded(masses, joint, revolute, moment)

    def _masses_beyond(self, joint: int) -> Factors:
        arm = self.problem.arm
        lever = self._levers(joint)
        bow = self._eighth * self._bounds_beyond(joint)
        beyond = mass_links(arm) >= joint
        gain = self._hat.second(self.bodies[self._within][:, beyond])[0]
        at_all = self._body_bounds(arm.lengths * self._curving)[beyond]
        at_all = at_all + (self.problem.limits.feed_acceleration or 0.0)
        return Factors(
            all_masses(arm)[beyond],
            np.max(np.linalg.norm(lever, axis=2), axis=0) + bow,
            bow,
            np.sqrt(self._hat.variance(lever)) + bow,
            np.linalg.norm(gain - self.problem.simulation.gravity, axis=1),
            _unsteady(at_all, gain),
        )

    def _turning_beyond(self, joint: int) -> Factors:
        """Return factors of the moments that the rotational inertia of the links from a joint on requires.

        In these products, link directions take the place of levers, and their second derivatives that of forces.
        """
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
        """Return a bound on the excess of the holding torque between samples over that at samples [N m].

        The holding torque keeps the arm still against gravity; the allowed effort grows with it.
        """
        arm = self.problem.arm
        masses = all_masses(arm)[mass_links(arm) >= joint]
        moments = cross(np.einsum("m,kmd->kd", masses, self._levers(joint)), self.problem.simulation.gravity)
        weight = float(np.linalg.norm(self.problem.simulation.gravity))
        own = self._eighth * weight * float(masses @ self._bounds_beyond(joint))
        both = np.linalg.norm(np.diff(axis, axis=0), axis=1) * np.linalg.norm(np.diff(moments, axis=0), axis=1)
        return float(0.25 * np.max(both) + own + bow * (np.max(np.linalg.norm(moments, axis=1)) + own))

    def _rounded(self, masses: Factors, joint: int, revolute: int, moment: float) -> float:
        arm = self.problem.arm
        before, after = (float(step[0]) for step in self._hat.steps)
        place = self.motion.rounding
        rotor = float(_of_bends(arm.rotor_inertia, arm.links)[joint, revolute])
        turning = float(np.sum(arm.inertia_transverse[joint:])) + rotor
        shortest = float(np.min(arm.lengths[joint:]))
        noise = 4.0 * place / (before * after) * (float(masses.shares @ masses.longest) + turning / shortest)
        # The error of a direction is less than that of positions divided by its link's length.
        return noise + 2.0 * place * float(masses.shares @ masses.mean) + place / shortest * moment

    def _levers(self, joint: int) -> FloatArray:
        """Return the vectors from a joint to the n masses beyond it at the three samples, shape (3, n, 3) [m]."""
        joints = self.motion.points[self._within, joint : joint + 1]
        beyond = self.bodies[self._within][:, mass_links(self.problem.arm) >= joint]
        return np.asarray(beyond - self.problem.arm.embedded(joints))

    def _bounds_beyond(self, joint: int) -> FloatArray:
        """Return bounds on the second derivatives of the vectors from a joint to the n masses beyond, (n,) [m/s²]."""
        arm = self.problem.arm
        beyond = np.where(np.arange(arm.links) >= joint, arm.lengths * self._curving, 0.0)
        return self._body_bounds(beyond)[mass_links(arm) >= joint]

    def _body_bounds(self, of_links: FloatArray) -> FloatArray:
        """Sum one value per link from the base up to each of the point masses, shape (masses,).

        A sum up to a midpoint includes half of that link's own value; one up to what is fixed to a link its whole
        value, and the bound on the second derivative of the vector from there.
        """
        fixed = PointMasses.of(self.problem.arm)
        whole = np.cumsum(of_links)
        beside = whole[fixed.link] + fixed.reach * self._curving[fixed.link]
        return np.concatenate((whole - 0.5 * of_links, [np.sum(of_links)], beside))

    @cached_property
    def _curving(self) -> FloatArray:
        """Bounds on the second derivatives of the unit vectors e of each link's frame, shape (links,) [1/s²].

        ω̇ × e + ω × (ω × e) is at most |ω̇| + |ω|². The rates ω of links follow from the distance that their unit
        vectors move between samples, up to a step times the bound itself; so the bound is found by iteration, starting
        from the sum of the joint rates.
        """
        if self.problem.arm.dimension == 2:
            turned = np.cumsum(bend_pairs(self.problem.arm, self.motion.positions[self._within])[..., 1], axis=1)
            growth = np.cumsum(self._accelerations[:, 1])
            step = np.diff(self.motion.time[self._within])
            means = np.max(np.abs(np.diff(turned, axis=0)) / step[:, None], axis=0)
            return np.asarray(growth + (means + self._longest * growth) ** 2)
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
        """Return bounds on the links' angular accelerations from bounds on angular velocities, both (links,)."""
        first, second = self._rates.T
        before = np.concatenate(([0.0], turn[:-1]))
        # The two axes of a joint are perpendicular and move with the preceding parts of the arm.
        gains = np.hypot(self._accelerations[:, 0], self._accelerations[:, 1])
        return np.cumsum(gains + first * before + second * (before + first))

    @cached_property
    def _rates(self) -> FloatArray:
        """Bounds on the rates of the bends near the sample, shape (links, 2) [rad/s]."""
        bends = bend_pairs(self.problem.arm, self.motion.positions[self._within])
        means = np.abs(np.diff(bends, axis=0)) / np.diff(self.motion.time[self._within])[:, None, None]
        return np.asarray(np.max(means, axis=0) + self._longest * self._accelerations)

    @property
    def _accelerations(self) -> FloatArray:
        """Acceleration limits of the bends, shape (links, 2) [rad/s²]."""
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
    """Return bounds on the root mean square deviation of n bounded vectors from their means, shape (n,).

    Args:
        at_all: bounds on the lengths of the vectors, shape (n,).
        mean: means of the vectors, shape (n, 3).
    """
    return np.asarray(np.sqrt(np.maximum(at_all**2 - np.sum(mean**2, axis=1), 0.0)))
