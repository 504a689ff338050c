"""What samples ask of the drives, and the share of it that a plan leaves the controller.

The share σ holds for velocities, accelerations, jerks and efforts of all drives. Where holding the arm still takes the
share h of an effort's limit, the effort may take max(σ, h + ½ σ (1 − h)) of it. The rule stands in
``robot.coordinates`` too; the verifier reckons for itself, on purpose.

Second difference quotients of a place are means of its acceleration over the two steps beside a sample, weighted by the
hat w that is highest at the sample and 0 at its neighbours. A moment is a product of a lever and a force, so that its
mean differs from the product of the means; by how much at most is reckoned here. What is left over after that is a mean
of efforts that *every* motion through the samples has to bear, so that some effort of it is at least as great.

The theorem, its assumptions and its proof stand in ``docs/theory.md`` (theorem 9). The plane is taken as that of
complex numbers here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.solution import Check, JointStates, JointTrajectory
from ccm_opt.verification.checked_problem import CheckedProblem
from ccm_opt.verification.consistency import point_rounding
from ccm_opt.verification.link_motion import advance, axis_direction, link_headings
from ccm_opt.verification.newton_euler import efforts_in_plane
from ccm_opt.verification.stretch_proof import HatMeans
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings

UNIT = "of the limit"

HoldingEfforts = tuple[FloatArray, FloatArray]
"""Torques of all revolutes, shape (T, 3 * links) [N m], and forces of the base's axes, (T, axes) [N], at rest."""


def check_shares(
    problem: CheckedProblem,
    trajectory: JointTrajectory,
    joints: JointStates,
    of_limits: Sequence[Check],
    holding: HoldingEfforts,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check the share that plans keep; nothing where they may use the limits in full.

    Args:
        problem: what was asked.
        trajectory: the planar motion.
        joints: the same for the drives, with their efforts.
        of_limits: the checks of the limits themselves, which know where the greatest share of each is taken.
        holding: what holds the arm still at the samples.
        settings: the tolerance of limits.
    """
    share = problem.planner.effort_share
    if share == 1.0:
        return []
    checks = []
    drives = ("joint", *trajectory.coordinates.base_names)
    for kind in ("velocity", "acceleration", "jerk"):
        limited = [check for check in of_limits if check.name in {f"{drive} {kind}" for drive in drives}]
        if limited:
            checks.append(_of_rate(kind, limited, share, settings))
    taken, held, names = _efforts(problem, trajectory, joints, holding)
    if names:
        checks.append(_of_effort(taken, held, names, trajectory.time, share, settings))
    return checks


def _of_rate(kind: str, limited: Sequence[Check], share: float, settings: VerificationSettings) -> Check:
    """The check for velocities, accelerations or jerks, from those of their limits."""
    tightest = max(limited, key=lambda check: check.worst / check.limit)
    worst = tightest.worst / tightest.limit
    # The place of an axis that carries the base is a time alone.
    where = tightest.where if tightest.name.startswith("joint") else f"{tightest.name} at {tightest.where}"
    return Check(
        f"share of {kind}", worst, share, UNIT, where, passed=worst <= share * (1.0 + settings.limit_tolerance)
    )


def _of_effort(
    taken: FloatArray,
    held: FloatArray,
    names: Sequence[str],
    time: FloatArray,
    share: float,
    settings: VerificationSettings,
) -> Check:
    """The check for efforts; what may be taken depends on what holds the arm still at each sample."""
    allowed = allowed_share(held, share)
    k, j = np.unravel_index(np.argmax(taken / allowed), taken.shape)
    worst = float(taken[k, j])
    bound = float(allowed[k, j])
    where = f"{names[int(j)]} at t = {time[k]:.4f} s"
    if bound > share:
        where = f"{where}, where holding the arm still takes {held[k, j]:.3g} of the limit"
    passed = worst <= bound * (1.0 + settings.limit_tolerance)
    return Check("share of effort", worst, bound, UNIT, where, passed=passed)


def allowed_share(held: FloatArray, share: float) -> FloatArray:
    """Share of an effort's limit that a plan may use where holding the arm still takes some of it, in [0, 1]."""
    return np.asarray(np.maximum(share, held + 0.5 * share * (1.0 - held)))


def holding_efforts(problem: Problem, positions: FloatArray) -> HoldingEfforts:
    """What holds the arm still at given poses, shape (T, c); zeros where no effort is limited."""
    if problem.limits.torque is None and problem.limits.feed_force is None:
        count = len(positions)
        return np.zeros((count, 3 * problem.arm.links)), np.zeros((count, len(problem.arm.base_axes)))
    rest = np.zeros_like(positions)
    torques, force = efforts_in_plane(problem.arm, problem.simulation.gravity, positions, rest, rest)
    return torques, np.repeat(force[:, None], len(problem.arm.base_axes), axis=1)


def _efforts(
    problem: CheckedProblem, trajectory: JointTrajectory, joints: JointStates, holding: HoldingEfforts
) -> tuple[FloatArray, FloatArray, list[str]]:
    """Shares of the limits that efforts take and that hold the arm still, shape (T, N), and names of these drives."""
    limits = problem.limits
    torques_at_rest, forces_at_rest = holding
    taken = []
    held = []
    names = []
    if limits.torque is not None:
        taken.append(np.abs(joints.torques) / limits.torque)
        held.append(np.abs(torques_at_rest) / limits.torque)
        names += [f"joint {j // 3 + 1} ({name})" for j, name in enumerate(joints.names)]
    if limits.feed_force is not None:
        taken.append(np.abs(joints.base_forces) / limits.feed_force)
        held.append(np.abs(forces_at_rest) / limits.feed_force)
        names += [f"the {name} axis" for name in trajectory.coordinates.base_names]
    if not names:
        return np.zeros((0, 0)), np.zeros((0, 0)), names
    # More than all of it holds nothing still; the check of the limit itself says so.
    return np.concatenate(taken, axis=1), np.minimum(np.concatenate(held, axis=1), 1.0), names


class MeansOfForce(Protocol):
    """Means of the force on a feed axis around the inner samples, and what they may be off, shape (T − 2,) [N] each."""

    @property
    def force(self) -> FloatArray:
        """The means by differences."""

    @property
    def force_errors(self) -> FloatArray:
        """What the true means may be off."""


def check_sample_efforts(
    problem: Problem,
    trajectory: JointTrajectory,
    holding: HoldingEfforts,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> list[Check]:
    """Check the torques of the bends, and the force on a feed axis, that the samples take by themselves.

    A check holds unless every motion through the samples, with accelerations within their limits, passes the limit of
    an effort. ``worst`` is the effort by differences, ``limit`` the limit with what differences may be off.
    """
    limits = problem.limits
    if len(trajectory.time) < 3:
        return []
    checks = []
    means = SampleMeans(problem, trajectory)
    torques, forces = holding
    if limits.torque is not None:
        limit = allowed_beside(torques[:, 1::3], limits.torque[1::3], problem)
        checks.append(_torque_check(means, limit, settings))
    if limits.feed_force is not None:
        for name, held in zip(trajectory.coordinates.base_names, forces.T, strict=True):
            limit = allowed_beside(held[:, None], np.array([limits.feed_force]), problem)[:, 0]
            checks.append(force_check(name, means, trajectory.time, limit, settings))
    return checks


def allowed_beside(held: FloatArray, limit: FloatArray, problem: CheckedProblem) -> FloatArray:
    """The greatest effort that is allowed anywhere in the two steps beside each inner sample, shape (T − 2, N).

    Args:
        held: what holds the arm still at the samples, shape (T, N).
        limit: of each drive, shape (N,).
        problem: whose plans use a share of the limits.
    """
    allowed = limit * allowed_share(np.minimum(np.abs(held) / limit, 1.0), problem.planner.effort_share)
    return np.asarray(np.maximum(np.maximum(allowed[:-2], allowed[1:-1]), allowed[2:]))


def _torque_check(means: "SampleMeans", allowed: FloatArray, settings: VerificationSettings) -> Check:
    efforts = np.abs(means.torques)
    limit = allowed * (1.0 + settings.limit_tolerance)
    # The bound is worth its price only where the effort by differences passes the limit.
    sample, joint = np.nonzero(efforts > limit)
    limit[sample, joint] += means.torque_errors(sample, joint)
    time = means.trajectory.time
    return torque_check(efforts, limit, lambda k, j: f"joint {j + 1} at t = {time[k + 1]:.4f} s")


def torque_check(efforts: FloatArray, limit: FloatArray, where: Callable[[int, int], str]) -> Check:
    """The check of the torques that the inner samples take by themselves.

    Args:
        efforts: their absolute values, shape (T − 2, N) [N m].
        limit: with what they may be off, of the same shape [N m].
        where: says where an effort is, by its row and column.
    """
    k, j = (int(index) for index in np.unravel_index(np.argmax(efforts / limit), efforts.shape))
    worst = float(efforts[k, j])
    bound = float(limit[k, j])
    return Check("joint torque of the samples", worst, bound, "N m", where(k, j), passed=worst <= bound)


def force_check(
    name: str,
    means: MeansOfForce,
    time: FloatArray,
    allowed: FloatArray,
    settings: VerificationSettings,
) -> Check:
    """The check of the force on a feed axis that the inner samples take by themselves.

    Args:
        name: of the axis.
        means: the force by differences, and what it may be off.
        time: of all samples, shape (T,) [s].
        allowed: shape (T − 2,) [N].
        settings: of the verifier.
    """
    efforts = np.abs(means.force)
    limit = allowed * (1.0 + settings.limit_tolerance) + means.force_errors
    k = int(np.argmax(efforts / limit))
    where = f"t = {time[k + 1]:.4f} s"
    worst = float(efforts[k])
    bound = float(limit[k])
    return Check(f"{name} force of the samples", worst, bound, "N", where, passed=worst <= bound)


@dataclass(frozen=True)
class SampleMeans:
    """Means of efforts around the inner samples, T − 2 of them, by the samples' places and times alone.

    Attributes:
        problem: arm, gravity, and the limits on accelerations.
        trajectory: the motion, of at least three samples.
    """

    problem: Problem
    trajectory: JointTrajectory

    @property
    def torques(self) -> FloatArray:
        """Mean torques of the bends, counter-clockwise, shape (T − 2, links) [N m]."""
        arm = self._arm
        forces = self._forces
        # Σ over the masses beyond joint i of (lever × force), the lever r − pᵢ, in two sums from the tip.
        levers = self._hat.mean(self._bodies)
        own = _from_tip(np.imag(np.conj(levers) * forces))[:, : arm.links]
        beyond = _from_tip(forces)[:, : arm.links]
        moments = own - np.imag(np.conj(self._hat.mean(self._joints[:, :-1])) * beyond)
        # Links turn, rotors turn with their bends, and friction rubs.
        spins = _from_tip(arm.inertia_transverse * self._hat.second(self._headings))
        bends = self.trajectory.bend_angles
        geared = _of_bends(arm, arm.rotor_inertia) * self._hat.second(bends)
        rubbed = _of_bends(arm, arm.friction) * self._hat.first(bends)
        return np.asarray(moments + spins + geared + rubbed)

    @property
    def force(self) -> FloatArray:
        """Mean force along the base heading, shape (T − 2,) [N]; no lever is in it, so that it is exact."""
        x, y = axis_direction(self._arm)
        return np.asarray(np.real(np.sum(self._forces, axis=1) * np.conj(complex(x, y))))

    @property
    def force_errors(self) -> FloatArray:
        """What rounding can have added to the mean force, shape (T − 2,) [N]."""
        return np.asarray(np.sum(self._masses) * self._noise)

    def torque_errors(self, sample: IntArray, joint: IntArray) -> FloatArray:
        """How far mean torques may be from the means that every motion through the samples has, shape (m,) [N m].

        Args:
            sample: numbers of inner samples, from 0.
            joint: numbers of bends, from 0.
        """
        return np.array([self._torque_error(int(k), int(i)) for k, i in zip(sample, joint, strict=True)])

    def _torque_error(self, k: int, i: int) -> float:
        arm = self._arm
        before = self._steps[0][k]
        after = self._steps[1][k]
        longest = max(before, after)
        within = slice(k, k + 3)
        # How fast links may turn and speed up between the samples, by the limits on accelerations.
        growth = np.cumsum(self.problem.limits.acceleration[1::3])
        mean_rates = np.diff(self._headings[within], axis=0) / np.array([[before], [after]])
        rates = np.max(np.abs(mean_rates), axis=0) + longest * growth
        of_links = arm.link_length * (growth + rates**2)
        at_all = bounds_of_bodies(of_links) + (self.problem.limits.feed_acceleration or 0.0)
        beyond = bounds_of_bodies(np.where(np.arange(arm.links) >= i, of_links, 0.0))

        levers = (self._bodies[within] - self._joints[within, i : i + 1])[:, i:]
        spread = np.abs(levers - self._mean_of(levers, before, after)) ** 2
        weights = np.array([before, 2.0 * (before + after), after]) / (3.0 * (before + after))
        bow = longest**2 / 8.0 * beyond[i:]
        mean = self._accelerations[k, i:]
        unsteady = np.sqrt(np.maximum(at_all[i:] ** 2 - np.abs(mean) ** 2, 0.0))
        pull = np.abs(mean - self._gravity) + abs(self._gravity)
        masses = self._masses[i:]
        of_levers = float(masses @ ((np.sqrt(weights @ spread) + bow) * unsteady + bow * pull))

        rubbing = float(_of_bends(arm, arm.friction)[i] * self.problem.limits.acceleration[3 * i + 1] * longest)
        noise = self._noise[k]
        turning = float(np.sum(arm.inertia_transverse[i:]) + _of_bends(arm, arm.rotor_inertia)[i]) / arm.link_length
        rounded = noise * (float(masses @ np.max(np.abs(levers), axis=0)) + turning)
        rounded += 2.0 * point_rounding(arm, self.trajectory.positions) * float(masses @ pull)
        return float(of_levers + rubbing + rounded)

    @property
    def _arm(self) -> Arm:
        return self.problem.arm

    @property
    def _hat(self) -> HatMeans:
        return HatMeans(self.trajectory.time)

    @cached_property
    def _steps(self) -> tuple[FloatArray, FloatArray]:
        return self._hat.steps

    @cached_property
    def _headings(self) -> FloatArray:
        return link_headings(self._arm, self.trajectory.positions)

    @cached_property
    def _joints(self) -> FloatArray:
        """Base, joints and tip, shape (T, links + 1), complex [m]."""
        arm = self._arm
        steps = arm.link_length * np.exp(1j * self._headings)
        x, y = axis_direction(arm)
        base = complex(*arm.base) + advance(arm, self.trajectory.positions) * complex(x, y)
        return np.asarray(base[:, None] + np.concatenate((np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)), axis=1))

    @cached_property
    def _bodies(self) -> FloatArray:
        """Where the masses are: the middles of the links, and the tip, shape (T, links + 1), complex [m]."""
        joints = self._joints
        return np.concatenate((0.5 * (joints[:, :-1] + joints[:, 1:]), joints[:, -1:]), axis=1)

    @property
    def _masses(self) -> FloatArray:
        """Of the links, and the payload, shape (links + 1,) [kg]."""
        return np.append(self._arm.masses, self._arm.payload)

    @property
    def _gravity(self) -> complex:
        x, _, z = self.problem.simulation.gravity
        return complex(x, z)

    @cached_property
    def _accelerations(self) -> FloatArray:
        """Mean accelerations of the masses, shape (T − 2, links + 1), complex [m/s²]."""
        return self._hat.second(self._bodies)

    @property
    def _forces(self) -> FloatArray:
        """Mean forces that the masses need, shape (T − 2, links + 1), complex [N]."""
        return np.asarray(self._masses * (self._accelerations - self._gravity))

    @cached_property
    def _noise(self) -> FloatArray:
        """What rounding of places can have added to a mean acceleration, shape (T − 2,) [m/s²]."""
        before, after = self._steps
        return np.asarray(4.0 * point_rounding(self._arm, self.trajectory.positions) / (before * after))

    def _mean_of(self, three: FloatArray, before: float, after: float) -> FloatArray:
        change = after * (three[2] - three[1]) + before * (three[0] - three[1])
        return np.asarray(three[1] + change / (3.0 * (before + after)))


def bounds_of_bodies(of_links: FloatArray) -> FloatArray:
    """Bounds on the middles of the links and the tip, from those that each link adds, shape (links + 1,)."""
    return np.append(np.cumsum(of_links) - 0.5 * of_links, np.sum(of_links))


def _of_bends(arm: Arm, drives: FloatArray | float) -> FloatArray:
    return np.broadcast_to(np.asarray(drives, dtype=np.float64), (3 * arm.links,))[1::3]


def _from_tip(values: FloatArray) -> FloatArray:
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
