"""Frozen results of every stage, from the curve's keyframes to the simulated arm."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ccm_opt.arrays import FloatArray
from ccm_opt.continuum.configuration import Configuration
from ccm_opt.problem import Problem

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


@dataclass(frozen=True)
class JointPath:
    """An untimed, certified motion of the jointed arm.

    Attributes:
        spline: C² clamped spline of the joint bends over the path parameter u in [0, 1], values (links,) [rad]; with a
            feed axis one more value, its position [m].
        keyframes: bends at the planner's keyframes, shape (K, links) [rad]; with a feed axis one more column [m].
        curves: the continuum curve behind each keyframe, length K.
        candidate: name of the tactic that found the motion.
        leaders: paths that the arm follows joint by joint, in order, each of shape (m, 2) [m]; none when it does not.
        spare: gap beyond contact that the whole path is certified to keep [m]; timing may use it up.
    """

    spline: "BSpline"
    keyframes: FloatArray
    curves: tuple[Configuration, ...]
    candidate: str = ""
    leaders: tuple[FloatArray, ...] = ()
    spare: float = 0.0

    def reversed(self) -> "JointPath":
        """The same motion from its end to its start; to draw the arm back is to reverse how it came."""
        spline = self.spline
        backwards = type(spline)(spline.t[-1] - spline.t[::-1], spline.c[::-1].copy(), spline.k)
        return replace(
            self,
            spline=backwards,
            keyframes=self.keyframes[::-1].copy(),
            curves=self.curves[::-1],
            candidate=f"{self.candidate}, backwards" if self.candidate else "backwards",
            leaders=self.leaders[::-1],
        )


@dataclass(frozen=True)
class FeedMotion:
    """The base on its feed axis at every sample; each of shape (T,).

    Attributes:
        positions: [m].
        velocities: [m/s].
        accelerations: [m/s²].
    """

    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray


@dataclass(frozen=True)
class JointTrajectory:
    """A timed motion, sampled.

    Attributes:
        time: shape (T,) [s], from 0, steps of at most 5 ms.
        bend_angles: planar joint bends, counter-clockwise, shape (T, links) [rad].
        bend_velocities: shape (T, links) [rad/s].
        bend_accelerations: shape (T, links) [rad/s²].
        feed: what the feed axis does, or None when the base is fixed.
        stops: numbers of the samples at which the arm rests at its goals on the way, in order.
    """

    time: FloatArray
    bend_angles: FloatArray
    bend_velocities: FloatArray
    bend_accelerations: FloatArray
    feed: FeedMotion | None = None
    stops: tuple[int, ...] = ()

    @property
    def duration(self) -> float:
        """Time from first to last sample [s]."""
        return float(self.time[-1])


@dataclass(frozen=True)
class JointStates:
    """The same motion for the three revolutes of every ball joint, order of ``joint_names``; shapes (T, 3 * links).

    ``feed_forces``, shape (T,) [N], is what the feed axis bears along its direction; None when the base is fixed.
    """

    names: tuple[str, ...]
    angles: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    torques: FloatArray
    feed_forces: FloatArray | None = None


@dataclass(frozen=True)
class SimulatedMotion:
    """What the simulated arm did, at the trajectory's own samples.

    Attributes:
        angles: shape (T, 3 * links) [rad].
        torques: applied, shape (T, 3 * links) [N m].
        tracking_error: largest joint error at any integration step [rad].
        saturated: whether any torque met its limit.
        base_feed: position of the base on its feed axis, shape (T,) [m], or None when the base is fixed.
    """

    angles: FloatArray
    torques: FloatArray
    tracking_error: float
    saturated: bool
    base_feed: FloatArray | None = None


@dataclass(frozen=True)
class Check:
    """One limit, checked over the whole motion by the verifier.

    Attributes:
        name: for example ``wall clearance`` or ``joint torque``.
        worst: worst value met, in ``unit``.
        limit: the limit it is held against, in ``unit``.
        unit: unit of both.
        where: link or joint, obstacle, and time, in words.
        passed: whether the limit holds.
    """

    name: str
    worst: float
    limit: float
    unit: str
    where: str
    passed: bool


@dataclass(frozen=True)
class Solution:
    """A verified plan with everything computed on the way. What is not solved is an exception, never a solution."""

    problem: Problem
    path: JointPath
    trajectory: JointTrajectory
    joints: JointStates
    simulation: SimulatedMotion
    checks: tuple[Check, ...]
    metrics: Mapping[str, float]
    timings: Mapping[str, float]
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def joint_positions(self) -> FloatArray:
        """Joint and tip positions at every sample, shape (T, links + 1, 2) [m]."""
        arm = self.problem.arm
        feed = self.trajectory.feed
        return arm.joint_positions(arm.headings(self.trajectory.bend_angles), 0.0 if feed is None else feed.positions)
