"""What every stage makes of a problem, from the path without time to the simulated arm and the verifier's checks."""

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
"""Stands for a layout that is left out."""


def _left_out() -> FloatArray:
    """Return the stands for what the axes that carry the base do when it is left out."""
    return np.zeros((0, 0))


@dataclass(frozen=True, repr=False)
class JointPath:
    """An untimed, certified motion of the jointed arm.

    Attributes:
        spline: C² clamped spline of the arm's coordinates over the path parameter u in [0, 1], values (c,) [rad, m].
        keyframes: coordinates at the planner's keyframes, shape (K, c) [rad, m].
        curves: the continuum curve behind each keyframe, length K.
        candidate: name of the tactic that found the motion.
        spare: gap beyond contact that the whole path is certified to keep [m]; timing may use it up.
        goal_pose: what the goal-pose NLP said about the end; None where it was not asked, or gave no answer.
        parts: the paths of which it is made, where it is made of several; the spline has a corner between two of them,
            where the arm has to rest.
    """

    spline: "BSpline"
    keyframes: FloatArray
    curves: tuple[Configuration, ...]
    candidate: str = ""
    spare: float = 0.0
    goal_pose: GoalPoseRecord | None = None
    parts: "tuple[JointPath, ...]" = ()

    def reversed(self) -> "JointPath":
        """Return the same motion from its end to its start; to draw the arm back is to reverse how it came."""
        spline = self.spline
        backwards = type(spline)(spline.t[-1] - spline.t[::-1], spline.c[::-1].copy(), spline.k)
        return replace(
            self,
            spline=backwards,
            keyframes=self.keyframes[::-1].copy(),
            curves=self.curves[::-1],
            candidate=f"{self.candidate}, backwards" if self.candidate else "backwards",
            # The pose at which the motion now begins says nothing about where it ends.
            goal_pose=None,
            parts=tuple(part.reversed() for part in reversed(self.parts)),
        )

    def __repr__(self) -> str:
        return f"<JointPath through {len(self.keyframes)} keyframes, {self.candidate}>"


@dataclass(frozen=True, repr=False)
class JointTrajectory:
    """A timed motion, sampled.

    Attributes:
        time: shape (T,) [s], from 0, steps of at most 5 ms.
        positions: of all coordinates: bends, counter-clockwise, then the axes that carry the base, shape (T, c)
            [rad, m].
        velocities: shape (T, c) [rad/s, m/s].
        accelerations: shape (T, c) [rad/s², m/s²].
        coordinates: what the columns are; when left out, each is the bend of a joint.
        stops: numbers of the samples at which the arm rests at its goals on the way, in order.
        timed_by: what found the speeds of each stretch from rest to rest: ``"toppra"``, ``"sweeps"`` with the reason,
            ``"paul"``, or ``"rest"`` where nothing moves; empty when it is not known, as of a motion that is read back.
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
        """Positions of the axes that carry the base, shape (T, axes) [m]; (T, 0) when it is fixed."""
        return self.positions[:, self.coordinates.base]

    @property
    def base_velocities(self) -> FloatArray:
        """Velocities of the axes that carry the base, shape (T, axes) [m/s]."""
        return self.velocities[:, self.coordinates.base]

    @property
    def base_accelerations(self) -> FloatArray:
        """Accelerations of the axes that carry the base, shape (T, axes) [m/s²]."""
        return self.accelerations[:, self.coordinates.base]

    def part(self, samples: slice) -> "JointTrajectory":
        """Return some of the samples, in their order; stops that are not among them are left out.

        Args:
            samples: a slice without a step.
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
    """The same motion as the drives see it: the three revolutes of every ball joint, and the axes of the base.

    Attributes:
        names: of the revolutes, in the order of ``joint_names``.
        angles: of the revolutes, shape (T, 3 * links) [rad].
        velocities: shape (T, 3 * links) [rad/s].
        accelerations: shape (T, 3 * links) [rad/s²].
        torques: shape (T, 3 * links) [N m].
        base_forces: what the axes that carry the base bear along their direction, shape (T, axes) [N]; when left out,
            the base is fixed.
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
    """What the simulated arm did, at the trajectory's own samples.

    Attributes:
        angles: shape (T, 3 * links) [rad]; where the run was stopped, its last pose stands for all later ones.
        torques: applied, shape (T, 3 * links) [N m]; 0 after the run was stopped.
        tracking_error: largest joint error at any integration step [rad].
        saturated: whether any effort met its limit.
        base_positions: of the axes that carry the base, shape (T, axes) [m]; when left out, the base is fixed.
        saturated_time: for how long in all some effort was at its limit [s].
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
    """One limit, checked over the whole motion by the verifier.

    Attributes:
        name: for example ``wall clearance`` or ``joint torque``.
        worst: worst value met, in ``unit``.
        limit: the limit it is held against, in ``unit``.
        unit: unit of both.
        where: link or joint, obstacle, and time, in words.
        passed: whether the limit holds.
        place: of a check of gaps, where the least one is; None of other checks, and where nothing is near.
    """

    name: str
    worst: float
    limit: float
    unit: str
    where: str
    passed: bool
    place: NearPlace | None = None
