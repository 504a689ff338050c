"""Efforts in space that the samples' places and times take by themselves, whatever accelerations are reported.

As in the plane (``verification/sample_efforts.py``) second difference quotients are exact means of accelerations, and
what is reckoned is by how much the mean of a product may differ from the product of the means. In space a torque is a
product of three: axis, lever and force. It is theorem 16 of ``docs/theory.md``.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.verification.link_frames import LinkFrames
from ccm_opt.space.verification.space_chain_motion import SpaceChainMotion
from ccm_opt.space.verification.space_newton_euler import of_bends
from ccm_opt.space.verification.space_sample_bounds import SampleBounds
from ccm_opt.verification.bend_layout import joint_of_bend, revolutes_of_bends
from ccm_opt.verification.effort_share import HoldingEfforts
from ccm_opt.verification.hat_means import HatMeans
from ccm_opt.verification.sample_efforts import allowed_beside, force_check, torque_check
from ccm_opt.verification.verification_settings import VerificationSettings


def check_space_sample_efforts(
    problem: SpaceProblem,
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

    problem: SpaceProblem
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
