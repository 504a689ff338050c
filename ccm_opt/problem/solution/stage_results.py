"""Results of the planning stages: untimed path, timed trajectory, drive states, simulated motion, and checks."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem.solution.records import FOLLOWED, GoalPoseRecord, NearPlace, SimulationVerdict
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.coordinates import Coordinates, joint_coordinates

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_ALL_BENDS = joint_coordinates(0)
"""Marks an omitted layout of coordinates, which then becomes one bend per column."""


def _left_out() -> FloatArray:
    """Return an empty array that marks omitted data of the base axes."""
    return np.zeros((0, 0))


@dataclass(frozen=True, repr=False)
class JointPath:
    """An untimed, certified motion of the jointed arm.

    Attributes:
        spline: C² clamped spline of the arm's coordinates over the path parameter u in [0, 1], values (c,) [rad, m].
        keyframes: coordinates at the planner's keyframes, shape (K, c) [rad, m].
        curves: the continuum curve to which each keyframe was fitted, length K.
        candidate: name of the tactic that found the motion.
        spare: certified least gap of the whole path beyond contact [m], which timing may use up.
        goal_pose: record of the goal-pose NLP for the final pose; None where it was not run, or found nothing.
        parts: the paths that were joined into this path, where there are several; the spline has a corner between
            successive parts, at which the arm has to rest.
    """

    spline: "BSpline"
    keyframes: FloatArray
    curves: tuple[Configuration, ...]
    candidate: str = ""
    spare: float = 0.0
    goal_pose: GoalPoseRecord | None = None
    parts: "tuple[JointPath, ...]" = ()

    def reversed(self) -> "JointPath":
        """Return the path run backwards, from its end to its start, for example to retract the arm."""
        spline = self.spline
        backwards = type(spline)(spline.t[-1] - spline.t[::-1], spline.c[::-1].copy(), spline.k)
        return replace(
            self,
            spline=backwards,
            keyframes=self.keyframes[::-1].copy(),
            curves=self.curves[::-1],
            candidate=f"{self.candidate}, backwards" if self.candidate else "backwards",
            # The record describes the final pose, which is now the start.
            goal_pose=None,
            parts=tuple(part.reversed() for part in reversed(self.parts)),
        )

    def __repr__(self) -> str:
        return f"<JointPath through {len(self.keyframes)} keyframes, {self.candidate}>"


@dataclass(frozen=True, repr=False)
class JointTrajectory:
    """A sampled timed motion.

    Attributes:
        time: times of the samples, shape (T,) [s], from 0, steps of at most 5 ms.
        positions: all coordinates: bends, counter-clockwise, then the base axes, shape (T, c) [rad, m].
        velocities: velocities of all coordinates, shape (T, c) [rad/s, m/s].
        accelerations: accelerations of all coordinates, shape (T, c) [rad/s², m/s²].
        coordinates: meaning of the columns; by default each is the bend of a joint.
        stops: indices of the samples at which the arm rests at its intermediate goals, in order.
        timed_by: method that timed each stretch from rest to rest: ``"toppra"``, ``"sweeps"`` with the reason,
            ``"paul"``, or ``"rest"`` where nothing moves; empty when unknown, as for a motion read from a file.
    """

    time: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    coordinates: Coordinates = _ALL_BENDS
    stops: tuple[int, ...] = ()
    timed_by: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.coordinates is _ALL_BENDS:
            object.__setattr__(self, "coordinates", joint_coordinates((np.shape(self.positions) or (0,))[-1]))

    @property
    def duration(self) -> float:
        """Time from first to last sample [s]."""
        return float(self.time[-1])

    @property
    def bend_angles(self) -> FloatArray:
        """Bends of the joints, shape (T, links) [rad]."""
        return self.positions[:, self.coordinates.bends]

    @property
    def bend_velocities(self) -> FloatArray:
        """Velocities of the bends, shape (T, links) [rad/s]."""
        return self.velocities[:, self.coordinates.bends]

    @property
    def bend_accelerations(self) -> FloatArray:
        """Accelerations of the bends, shape (T, links) [rad/s²]."""
        return self.accelerations[:, self.coordinates.bends]

    @property
    def base_positions(self) -> FloatArray:
        """Positions of the base axes, shape (T, axes) [m]; (T, 0) when the base is fixed."""
        return self.positions[:, self.coordinates.base]

    @property
    def base_velocities(self) -> FloatArray:
        """Velocities of the base axes, shape (T, axes) [m/s]."""
        return self.velocities[:, self.coordinates.base]

    @property
    def base_accelerations(self) -> FloatArray:
        """Accelerations of the base axes, shape (T, axes) [m/s²]."""
        return self.accelerations[:, self.coordinates.base]

    def part(self, samples: slice) -> "JointTrajectory":
        """Return the trajectory restricted to a range of samples, with the stops among them.

        Args:
            samples: the range, a slice without a step.
        """
        first, last, _ = samples.indices(len(self.time))
        return replace(
            self,
            time=self.time[samples],
            positions=self.positions[samples],
            velocities=self.velocities[samples],
            accelerations=self.accelerations[samples],
            stops=tuple(stop - first for stop in self.stops if first <= stop < last),
        )

    def __repr__(self) -> str:
        return f"<JointTrajectory of {len(self.time)} samples, {self.duration:.3f} s>"


@dataclass(frozen=True, repr=False)
class JointStates:
    """A timed motion as the drives see it: the three revolutes of every ball joint, and the base axes.

    Attributes:
        names: names of the revolutes, in the order of ``joint_names``.
        angles: angles of the revolutes, shape (T, 3 * links) [rad].
        velocities: velocities of the revolutes, shape (T, 3 * links) [rad/s].
        accelerations: accelerations of the revolutes, shape (T, 3 * links) [rad/s²].
        torques: torques of the revolutes, shape (T, 3 * links) [N m].
        base_forces: forces of the base axes along their directions, shape (T, axes) [N]; when left out, the base is
            fixed.
    """

    names: tuple[str, ...]
    angles: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    torques: FloatArray
    base_forces: FloatArray = field(default_factory=_left_out)

    def __post_init__(self) -> None:
        if self.base_forces.shape == (0, 0):
            object.__setattr__(self, "base_forces", np.zeros((len(self.angles), 0)))

    def __repr__(self) -> str:
        return f"<JointStates of {len(self.names)} revolutes, {len(self.angles)} samples>"


@dataclass(frozen=True, repr=False)
class SimulatedMotion:
    """Motion of the simulated arm, at the samples of the trajectory.

    Attributes:
        angles: angles of the revolutes, shape (T, 3 * links) [rad]; after an early stop the last pose is repeated.
        torques: applied torques, shape (T, 3 * links) [N m]; 0 after an early stop.
        tracking_error: largest joint error at any integration step [rad].
        saturated: whether any drive reached its limit on effort.
        base_positions: positions of the base axes, shape (T, axes) [m]; when left out, the base is fixed.
        saturated_time: total time during which at least one drive was at its limit on effort [s].
        verdict: whether the arm followed its plan.
    """

    angles: FloatArray
    torques: FloatArray
    tracking_error: float
    saturated: bool
    base_positions: FloatArray = field(default_factory=_left_out)
    saturated_time: float = 0.0
    verdict: SimulationVerdict = FOLLOWED

    def __post_init__(self) -> None:
        if self.base_positions.shape == (0, 0):
            object.__setattr__(self, "base_positions", np.zeros((len(self.angles), 0)))

    def __repr__(self) -> str:
        return f"<SimulatedMotion: {self.verdict.outcome}>"


@dataclass(frozen=True)
class Check:
    """Result of the verifier's check of one limit over the whole motion.

    Attributes:
        name: name of the check, for example ``wall clearance`` or ``joint torque``.
        worst: worst value over the motion, in ``unit``.
        limit: the limit on that value, in ``unit``.
        unit: unit of ``worst`` and ``limit``.
        where: link or joint, obstacle and time at which the worst value occurs, in words.
        passed: whether the limit holds.
        place: place of the least gap, for checks of gaps; None for other checks, and where nothing is near.
    """

    name: str
    worst: float
    limit: float
    unit: str
    where: str
    passed: bool
    place: NearPlace | None = None
