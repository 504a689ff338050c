"""What samples ask of the drives, and the share of it that a plan leaves the controller.

The share σ holds for velocities, accelerations, jerks and efforts of all drives. Where holding the arm still takes the
share h of an effort's limit, the effort may take max(σ, h + ½ σ (1 − h)) of it. The rule stands in
``robot.coordinates`` too; the verifier reckons for itself, on purpose.

Second difference quotients of a place are means of its acceleration over the two steps beside a sample, weighted by the
hat w that is highest at the sample and 0 at its neighbours. A moment is a product of a lever and a force, so that its
mean differs from the product of the means; by how much at most is reckoned here. What is left over after that is a mean
of efforts that *every* motion through the samples has to bear, so that some effort of it is at least as great.

The theorems, their assumptions and their proofs stand in ``docs/guarantees.md``: theorem 9 for the plane, where the
axes of all joints are one direction, and theorem 16 for space, where a torque is a product of three: axis, lever and
force.
Everything is bounded by the samples beside it and by the limits on accelerations. Vectors leave what is linear between
samples by at most an eighth of the square of the step times their second derivative.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointTrajectory
from ccm_opt.verification.chain_motion import ChainMotion, LinkFrames, bend_pairs
from ccm_opt.verification.drives import bend_revolutes, check_worst, describe_bend_joints, sample_words
from ccm_opt.verification.limits import allowed_share
from ccm_opt.verification.newton_euler import from_tip
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

_REFINEMENTS = 2
"""How often a bound on how fast links turn is put into itself: each makes it smaller, and the third by little."""


@dataclass(frozen=True)
class HatMeans:
    """What values at samples say of the means around the inner ones, T − 2 of them; values have any further shape.

    Attributes:
        time: of the samples, shape (T,) [s].
    """

    time: FloatArray

    @property
    def steps(self) -> tuple[FloatArray, FloatArray]:
        """Steps before and after the inner samples, each of shape (T − 2,) [s]."""
        step = np.diff(self.time)
        return step[:-1], step[1:]

    def mean(self, values: FloatArray) -> FloatArray:
        """Return the means of what is linear between samples, shape (T − 2, …)."""
        before, after = self._beside(values)
        change = after * (values[2:] - values[1:-1]) + before * (values[:-2] - values[1:-1])
        return np.asarray(values[1:-1] + change / (3.0 * (before + after)))

    def first(self, values: FloatArray) -> FloatArray:
        """Return the mean rates over both steps, shape (T − 2, …)."""
        before, after = self._beside(values)
        return np.asarray((values[2:] - values[:-2]) / (before + after))

    def second(self, values: FloatArray) -> FloatArray:
        """Return the second difference quotients: exactly the means of second derivatives, shape (T − 2, …)."""
        before, after = self._beside(values)
        rates = np.diff(values, axis=0)
        return np.asarray(2.0 * (rates[1:] / after - rates[:-1] / before) / (before + after))

    def at(self, sample: int) -> "HatMeans":
        """Of one inner sample, counted from 0, alone."""
        return HatMeans(self.time[sample : sample + 3])

    def variance(self, values: FloatArray) -> FloatArray:
        """Bound on the mean square of how far vectors (3, …, d) at the samples of one are from their mean, (…)."""
        before, after = (float(step[0]) for step in self.steps)
        # A square is convex, so that between samples it is below what is linear.
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
    """Check the torques of the bends, and the force on a feed axis, that the samples take by themselves.

    A check holds unless every motion through the samples, with accelerations within their limits, passes the limit of
    an effort. ``worst`` is the effort by differences, ``limit`` the limit with what differences may be off.
    """
    limits = problem.limits
    time = trajectory.time
    if len(time) < 3:
        return []
    checks = []
    means = SampleMeans(problem, motion)
    layout = trajectory.coordinates
    if limits.torque is not None:
        bending = bend_revolutes(layout)
        allowed = _allowed_beside(holding[:, bending], limits.torque[bending], problem)
        efforts = np.abs(means.torques)
        limit = allowed * (1.0 + settings.limit_tolerance)
        # The bound is worth its price only where the effort by differences passes the limit.
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
    """Return the greatest effort that is allowed anywhere in the two steps beside each inner sample, shape (T − 2, N).

    Args:
        held: what holds the arm still at the samples, shape (T, N).
        limit: of each drive, shape (N,), or of all.
        problem: whose plans use a share of the limits.
    """
    allowed = limit * allowed_share(np.minimum(np.abs(held) / limit, 1.0), problem.planner.effort_share)
    return np.asarray(np.maximum(np.maximum(allowed[:-2], allowed[1:-1]), allowed[2:]))


@dataclass(frozen=True)
class SampleMeans:
    """Means of efforts around the inner samples, T − 2 of them, by the samples' places and times alone.

    Attributes:
        problem: arm, gravity, and the limits on accelerations.
        motion: the motion, of at least three samples.
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
        """Mean force along the base's direction, shape (T − 2,) [N]; no lever is in it, so that it is exact."""
        return np.asarray(np.sum(self._forces, axis=1) @ self.problem.arm.base_rotation[:, 0])

    @property
    def force_errors(self) -> FloatArray:
        """What rounding can have added to the mean force, shape (T − 2,) [N]."""
        before, after = self._hat.steps
        return np.asarray(4.0 * self.motion.rounding / (before * after) * np.sum(self._masses))

    def torque_error(self, sample: int, bend: int) -> float:
        """Return how far a mean torque may be from the mean that every motion through the samples has [N m].

        Args:
            sample: number of an inner sample, from 0.
            bend: number of a bend, from 0.
        """
        joint, revolute = divmod(int(bend_revolutes(self.problem.arm.coordinates)[bend]), 3)
        axes = (self._frames.first_axes, self._frames.second_axes)[revolute]
        moment = float(np.linalg.norm(self._moments[sample, joint]))
        bounds = SampleBounds(self.problem, self.motion, self._frames, self._bodies, sample)
        return bounds.of_torque(joint, revolute, axes[sample : sample + 3, joint], moment)

    @cached_property
    def _moments(self) -> FloatArray:
        """Mean moments about the joints, without what links take to spin about themselves, (T − 2, links, 3) [N m]."""
        hat = self._hat
        arm = self.problem.arm
        forces = self._forces
        # Σ over the masses beyond joint i of (lever × force), the lever r − pᵢ, in two sums from the tip.
        own = from_tip(np.cross(hat.mean(self._bodies), forces))[:, : arm.links]
        beyond = from_tip(forces)[:, : arm.links]
        joints = arm.embedded(self.motion.points[:, :-1])
        moments = own - np.cross(hat.mean(joints), beyond)
        if arm.dimension == 2:
            # All links turn about one direction, so that their spins are exact means.
            turned = np.cumsum(bend_pairs(arm, self.motion.positions)[..., 1], axis=1)
            turning = hat.second(turned)[..., None] * arm.base_rotation[:, 1]
        else:
            turning = np.cross(hat.mean(self._frames.along), hat.second(self._frames.along))
        return np.asarray(moments + from_tip(arm.inertia_transverse[:, None] * turning))

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
        bodies = np.concatenate((0.5 * (points[:, :-1] + points[:, 1:]), points[:, -1:]), axis=1)
        return self.problem.arm.embedded(bodies)

    @cached_property
    def _frames(self) -> LinkFrames:
        return LinkFrames.of(self.problem.arm, self.motion.positions)

    @property
    def _hat(self) -> HatMeans:
        return HatMeans(self.motion.time)


def _of_bends(drives: FloatArray | float, links: int) -> FloatArray:
    """Return a property of the drives for the first two revolutes of every ball, shape (links, 2)."""
    return np.broadcast_to(np.asarray(drives, dtype=np.float64), (3 * links,)).reshape(-1, 3)[:, :2]


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
    motion: ChainMotion
    frames: LinkFrames
    bodies: FloatArray
    sample: int

    def of_torque(self, joint: int, revolute: int, axis: FloatArray, moment: float) -> float:
        """Return how far the mean torque of a revolute may be from the one by means [N m].

        Args:
            joint: number of the joint, from 0.
            revolute: its first or its second, from 0.
            axis: about which it turns, at the three samples, shape (3, 3).
            moment: size of the mean moment about the joint [N m].
        """
        arm = self.problem.arm
        masses = self._masses_beyond(joint)
        error = masses.error
        bow = 0.0
        turned = 0.0
        # In the plane axes stand still, and the spins of links are exact means.
        if arm.dimension == 3:
            turning = self._turning_beyond(joint)
            error += turning.error
            # The first turns about an axis of the link before, which at the base stands still; the second about one of
            # its own link.
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
        gain = self._hat.second(self.bodies[self._within, joint:])[0]
        at_all = _body_bounds(arm.link_length * self._curving)[joint:]
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
        """Return the links that are turned: their directions stand for levers, how these are bent for forces."""
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
        """Return by how much what holds the arm still can be more between samples than at them [N m].

        The share of a limit that a plan may use grows with it.
        """
        arm = self.problem.arm
        masses = np.append(arm.masses, arm.payload)[joint:]
        moments = np.cross(np.einsum("m,kmd->kd", masses, self._levers(joint)), self.problem.simulation.gravity)
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
        noise = 4.0 * place / (before * after) * (float(masses.shares @ masses.longest) + turning / arm.link_length)
        # Directions are off by less than places by a link's length.
        return noise + 2.0 * place * float(masses.shares @ masses.mean) + place / arm.link_length * moment

    def _levers(self, joint: int) -> FloatArray:
        """From a joint to the masses beyond it, at the three samples, shape (3, n, 3) [m]."""
        joints = self.motion.points[self._within, joint : joint + 1]
        return np.asarray(self.bodies[self._within, joint:] - self.problem.arm.embedded(joints))

    def _bounds_beyond(self, joint: int) -> FloatArray:
        """Return the bounds on the second derivatives of those levers, shape (n,) [m/s²]."""
        arm = self.problem.arm
        beyond = np.where(np.arange(arm.links) >= joint, arm.link_length * self._curving, 0.0)
        return _body_bounds(beyond)[joint:]

    @cached_property
    def _curving(self) -> FloatArray:
        """Bound on second derivatives of the axes of each link, which turn with it, shape (links,) [1/s²].

        ω̇ × e + ω × (ω × e) is at most |ω̇| + |ω|². How fast links turn is known by how far their axes go from sample to
        sample, but for a step times that bound, which a bound that only adds up the joints begins with.
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
        """Bound on angular accelerations of the links, from one on how fast they turn, shape (links,) [rad/s²]."""
        first, second = self._rates.T
        before = np.concatenate(([0.0], turn[:-1]))
        # The two axes of a joint are across each other, and turn with what carries them.
        gains = np.hypot(self._accelerations[:, 0], self._accelerations[:, 1])
        return np.cumsum(gains + first * before + second * (before + first))

    @cached_property
    def _rates(self) -> FloatArray:
        """Bounds on the rates of the bends, shape (links, 2) [rad/s]."""
        bends = bend_pairs(self.problem.arm, self.motion.positions[self._within])
        means = np.abs(np.diff(bends, axis=0)) / np.diff(self.motion.time[self._within])[:, None, None]
        return np.asarray(np.max(means, axis=0) + self._longest * self._accelerations)

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
    """Return the root mean square of how far vectors of bounded size are from their means (n, 3)."""
    return np.asarray(np.sqrt(np.maximum(at_all**2 - np.sum(mean**2, axis=1), 0.0)))


def _body_bounds(of_links: FloatArray) -> FloatArray:
    """Return the bounds on the middles of the links and the tip, from those that each link adds, shape (links + 1,)."""
    return np.append(np.cumsum(of_links) - 0.5 * of_links, np.sum(of_links))
