"""Results of the stages of planning: untimed path, trajectory, states of all joints, simulated motion, and checks."""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem.solution.records import FOLLOWED, ClearanceLimit, GoalPoseRecord, NearPlace, SimulationVerdict
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.coordinates import Coordinates, joint_coordinates

if TYPE_CHECKING:
    from collections.abc import Callable

    from scipy.interpolate import BSpline

_ALL_BENDS = joint_coordinates(0)
"""Placeholder for an omitted layout of coordinates, which is replaced by one bend angle per column."""


def _left_out() -> FloatArray:
    """Return an empty array of shape (0, 0), the placeholder for omitted data of the feed axis."""
    return np.zeros((0, 0))


@dataclass(frozen=True, repr=False)
class JointPath:
    """An untimed, certified path of the arm in joint space, with c coordinates (bend angles, then any feed).

    Attributes:
        spline: clamped C² spline of the coordinates over the path parameter u in [0, 1], values of shape (c,) [rad, m].
        keyframes: configurations at the planner's K keyframes, shape (K, c) [rad, m].
        curves: backbone curves to which the keyframes were fitted, K or none.
        candidate: name of the planner's candidate (one way of moving along one route) that led to this path.
        spare: certified lower bound on the clearance along the whole path, beyond contact [m]; timing may deviate from
            the path by this much.
        goal_pose: solution of the nonlinear program for the final pose; None if none was solved or the solver
            failed.
        parts: the paths that were joined into this path, if there are several; between successive parts the spline
            has a corner, at which the arm must rest.
        clearance_limit: what keeps the clearance between start and goal from growing; None if the preferred
            clearance is kept, or the cause is unknown.
        lacking: clearance that the path lacks between start and goal more than at these, as a fraction of the preferred
            clearance, if the path may be improved.
        further: function that optimises the path within seconds of CPU time and returns a path with the same ends and
            more clearance, or this path; None if that is not worthwhile. It is lost when the path is copied to
            another process.
    """

    spline: "BSpline"
    keyframes: FloatArray
    curves: tuple[Configuration, ...]
    candidate: str = ""
    spare: float = 0.0
    goal_pose: GoalPoseRecord | None = None
    parts: "tuple[JointPath, ...]" = ()
    clearance_limit: ClearanceLimit | None = None
    lacking: float = 0.0
    further: "Callable[[float], JointPath] | None" = None

    def mapped(self, change: "Callable[[JointPath], JointPath]") -> "JointPath":
        """Return the path changed by a function, which also changes the paths that ``further`` returns."""
        further = self.further
        return replace(change(self), further=None if further is None else lambda s: further(s).mapped(change))

    def reversed(self) -> "JointPath":
        """Return the path traversed backwards, from its end to its start, for example to retract the arm."""
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
            lacking=0.0,
            further=None,
        )

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "further": None}

    def __repr__(self) -> str:
        return f"<JointPath through {len(self.keyframes)} keyframes, {self.candidate}>"


@dataclass(frozen=True, repr=False)
class JointTrajectory:
    """A timed motion, sampled at T times, with c coordinates (bend angles, then any feed).

    Attributes:
        time: times of the samples, from 0, in steps of at most 5 ms, shape (T,) [s].
        positions: coordinates, bend angles positive counter-clockwise, shape (T, c) [rad, m].
        velocities: velocities of the coordinates, shape (T, c) [rad/s, m/s].
        accelerations: accelerations of the coordinates, shape (T, c) [rad/s², m/s²].
        coordinates: layout of the columns; by default one bend angle per column.
        stops: indices of the samples at which the arm rests at intermediate goals, in order.
        timed_by: method that timed each part of the motion from rest to rest: ``"toppra"``, ``"sweeps"`` with the
            reason, ``"paul"``, or ``"rest"`` where nothing moves; empty if unknown, as for a motion from a file.
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
        """Duration of the motion, from the first to the last sample [s]."""
        return float(self.time[-1])

    @property
    def bend_angles(self) -> FloatArray:
        """Bend angles of the joints, one column each, in space two per joint, shape (T, b) [rad]."""
        return self.positions[:, self.coordinates.bends]

    @property
    def bend_velocities(self) -> FloatArray:
        """Angular velocities of the bends, one column each, shape (T, b) [rad/s]."""
        return self.velocities[:, self.coordinates.bends]

    @property
    def bend_accelerations(self) -> FloatArray:
        """Angular accelerations of the bends, one column each, shape (T, b) [rad/s²]."""
        return self.accelerations[:, self.coordinates.bends]

    @property
    def base_positions(self) -> FloatArray:
        """Positions of the base on its feed axis, shape (T, 1) [m]; shape (T, 0) for a fixed base."""
        return self.positions[:, self.coordinates.base]

    @property
    def base_velocities(self) -> FloatArray:
        """Velocities of the feed axis, shape (T, 1) [m/s]; shape (T, 0) for a fixed base."""
        return self.velocities[:, self.coordinates.base]

    @property
    def base_accelerations(self) -> FloatArray:
        """Accelerations of the feed axis, shape (T, 1) [m/s²]; shape (T, 0) for a fixed base."""
        return self.accelerations[:, self.coordinates.base]

    def part(self, samples: slice) -> "JointTrajectory":
        """Return the trajectory restricted to a range of samples, with the stops in this range.

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
    """States of all drives at T samples of a motion: three revolutes per ball joint of n links, and any feed axis.

    Attributes:
        names: names of the revolute joints, in the order of ``joint_names``.
        angles: angles of the revolute joints, shape (T, 3 n) [rad].
        velocities: velocities of the revolute joints, shape (T, 3 n) [rad/s].
        accelerations: accelerations of the revolute joints, shape (T, 3 n) [rad/s²].
        torques: torques of the revolute joints, shape (T, 3 n) [N m].
        base_forces: force of the feed axis along its direction, shape (T, 1) [N]; by default (T, 0), a fixed base.
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
    """Motion of the simulated arm of n links, at the T samples of the trajectory.

    Attributes:
        angles: angles of the revolute joints, shape (T, 3 n) [rad]; the last pose is repeated after an early stop.
        torques: applied torques, shape (T, 3 n), or of the m drives of sections that bend evenly, shape (T, m) [N m]; 0
            after an early stop.
        tracking_error: maximum joint error at any integration step [rad].
        saturated: whether any drive reached its effort limit.
        base_positions: positions of the base on its feed axis, shape (T, 1) [m]; by default (T, 0), a fixed base.
        saturated_time: total time during which at least one drive was at its effort limit [s].
        verdict: outcome of the simulation.
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
        passed: whether the motion respects the limit.
        place: bodies and time of the minimum clearance, for checks of clearance; None for other checks, and where
            nothing is near.
    """

    name: str
    worst: float
    limit: float
    unit: str
    where: str
    passed: bool
    place: NearPlace | None = None
