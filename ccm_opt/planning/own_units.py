"""Conversion of planar problems to the arm's length as the unit of length, and of results back to metres.

Steps, solvers and tolerances of planning are tuned for an arm of about a metre. So every problem is planned with the
length of its arm as the unit of length; masses and times are unchanged. Then an arm of a millimetre and one of a
kilometre, in similar workspaces, give equal problems, except for the rounding of the division; rounding every length to
a grid far finer than any tolerance removes that difference too, so that the plans agree to the last bit.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, Finding, NoPlanFound
from ccm_opt.core.length_words import words_for_unit
from ccm_opt.problem import (
    Goal,
    JointPose,
    Limits,
    LookAt,
    PlannerOptions,
    Problem,
    SimulationOptions,
    Stop,
    Tolerances,
    VerificationOptions,
)
from ccm_opt.problem.solution import GoalPoseRecord, JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

GRID = 2.0**36
"""Number of grid steps to a unit, to which lengths are rounded: 15 picometres on an arm of a metre, far below any
tolerance. Derived: as coarse as the tolerances allow, so that hardly any length lies so near the middle between two
grid points that the rounding of the division decides."""
LENGTHS = frozenset(
    (
        *("allowed", "arc", "arm_length", "distance", "gap", "outside"),
        *("place", "remaining", "route_length", "violation", "way_length"),
    )
)
"""Names of those numbers in the data of a diagnosis that are lengths and have to be converted to metres."""
LENGTH_KEYS = (".radius", ".clearance", ".link_length", ".feed.range")
"""Ends of keys of the problem file whose values are lengths and may be bounded by a finding of a diagnosis."""


@dataclass(frozen=True)
class OwnUnits:
    """System of units whose unit of length is the length of a problem's arm.

    Attributes:
        metres: length of the arm, the unit of length [m].
    """

    metres: float

    def scaled(self, problem: Problem) -> Problem:
        """Return a problem converted from metres to the arm's units; angles, times and masses are unchanged."""
        tolerances = self._tolerances(problem.tolerances)
        arm = self._arm(problem.arm)
        return replace(
            problem,
            workspace=self._workspace(problem.workspace),
            arm=arm,
            limits=self._limits(problem.limits),
            start=self._pose(problem.start, arm),
            goal=self._goal(problem.goal, arm),
            tolerances=tolerances,
            stops=tuple(
                Stop(self._goal(stop.goal, arm), self._tolerances(stop.tolerances), stop.pause)
                for stop in problem.stops
            ),
            planner=self._options(problem.planner),
            simulation=self._simulation(problem.simulation),
            verification=VerificationOptions(_rounded_length(problem.contact_tolerance / self.metres)),
        )

    def path_in_metres(self, path: JointPath, arm: Arm) -> JointPath:
        """Return a joint path converted from the arm's units to metres, for the original arm."""
        spline = path.spline
        return replace(
            path,
            spline=type(spline)(spline.t, self._coordinates(spline.c, arm), spline.k),
            keyframes=self._coordinates(path.keyframes, arm),
            curves=tuple(self._in_metres(curve) for curve in path.curves),
            spare=self.metres * path.spare,
            goal_pose=None if path.goal_pose is None else self.record_in_metres(path.goal_pose),
        )

    def diagnosis_in_metres(self, diagnosis: Diagnosis) -> Diagnosis:
        """Return a diagnosis with its lengths converted from arm's units to metres; its text is in metres already."""
        return replace(
            diagnosis,
            evidence={key: self._figure(key, value) for key, value in diagnosis.evidence.items()},
            findings=self.findings_in_metres(diagnosis.findings),
        )

    def findings_in_metres(self, findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
        """Return findings of a diagnosis with their lengths converted from the arm's units to metres."""
        return tuple(self._finding(finding) for finding in findings)

    def record_in_metres(self, record: GoalPoseRecord) -> GoalPoseRecord:
        """Return the record of a goal-pose NLP with its lengths converted from the arm's units to metres."""
        return replace(
            record,
            curve=self._in_metres(cast("Configuration", record.curve)),
            gap=self.metres * record.gap,
            wanted_gap=self.metres * record.wanted_gap,
        )

    def _length(self, length: float) -> float:
        """Return a length [m] in the arm's units, rounded to the grid."""
        return float(np.round(length / self.metres * GRID) / GRID) if np.isfinite(length) else length

    def _lengths(self, lengths: FloatArray) -> FloatArray:
        return np.asarray(np.round(np.asarray(lengths) / self.metres * GRID) / GRID)

    def _workspace(self, workspace: Workspace) -> Workspace:
        cores = shapely.transform(np.array([each.core for each in workspace.obstacles], dtype=object), self._lengths)
        obstacles = (
            Obstacle(each.name, PlaneShape(core, self._length(each.rounding)))
            for each, core in zip(workspace.obstacles, cores, strict=True)
        )
        boundary = shapely.transform(workspace.boundary, self._lengths)
        return replace(
            workspace, boundary=boundary, obstacles=tuple(obstacles), clearance=self._length(workspace.clearance)
        )

    def _arm(self, arm: Arm) -> Arm:
        area = self.metres**2
        feed, sections = arm.feed, arm.sections
        if sections is not None:
            lengths, radii = sections.lengths / self.metres, sections.radii / self.metres
            sections = replace(sections, lengths=lengths, radii=radii)
        if feed is not None:
            feed = replace(feed, low=self._length(feed.low), high=self._length(feed.high), hole=self._length(feed.hole))
        return replace(
            arm,
            link_length=float(_rounded(arm.link_length / self.metres)),
            radius=self._length(arm.radius),
            base=self._lengths(arm.base),
            mount_length=self._length(arm.mount_length),
            inertia_axial=_rounded(arm.inertia_axial / area),
            inertia_transverse=_rounded(arm.inertia_transverse / area),
            feed=feed,
            sections=sections,
            rotor_inertia=_rounded(arm.rotor_inertia / area),
            friction=_rounded(arm.friction / area),
        )

    def _limits(self, limits: Limits) -> Limits:
        def divided(value: float | None) -> float | None:
            return None if value is None else float(_rounded(value / self.metres))

        points = (
            replace(
                point,
                at=None if point.at is None else min(self._length(point.at), 1.0),
                velocity=float(_rounded(point.velocity / self.metres)),
                acceleration=float(_rounded(point.acceleration / self.metres)),
            )
            for point in limits.points
        )
        return replace(
            limits,
            torque=None if limits.torque is None else _rounded(limits.torque / self.metres**2),
            feed_velocity=divided(limits.feed_velocity),
            feed_acceleration=divided(limits.feed_acceleration),
            feed_force=divided(limits.feed_force),
            feed_jerk=divided(limits.feed_jerk),
            points=tuple(points),
        )

    def _pose(self, pose: JointPose, arm: Arm) -> JointPose:
        feed = self._length(float(pose.feed))
        if pose.curve is None:
            return replace(pose, feed=feed)
        return JointPose.along(arm, self._in_units(pose.curve), pose.mapping, feed)

    def _goal(self, goal: Goal, arm: Arm) -> Goal:
        if goal.for_joints is None:
            tip = goal.for_tip
            return replace(tip, position=self._lengths(tip.position), look_at=self._look_at(tip.look_at))
        return self._pose(goal.for_joints, arm)

    def _look_at(self, look_at: LookAt | None) -> LookAt | None:
        if look_at is None:
            return None
        least, most = map(self._length, look_at.distance)
        return replace(look_at, place=self._lengths(look_at.place), distance=(least, most))

    def _tolerances(self, tolerances: Tolerances) -> Tolerances:
        return replace(tolerances, position=self._length(tolerances.position))

    def _options(self, options: PlannerOptions) -> PlannerOptions:
        gap, bound = options.wanted_gap, options.follow_within
        return replace(
            options,
            wanted_gap=None if gap is None else self._length(gap),
            follow_within=None if bound is None else self._length(bound),
        )

    def _simulation(self, simulation: SimulationOptions) -> SimulationOptions:
        """Return simulation options with gravity in the arm's units; no other option affects plans."""
        return replace(simulation, gravity=_rounded(simulation.gravity / self.metres))

    def _in_units(self, curve: Configuration) -> Configuration:
        large = _stretched(curve, 1.0 / self.metres)
        segments = (
            replace(
                segment,
                length=float(_rounded(segment.length)),
                heading=float(_rounded(segment.heading)),
                curvature=_rounded(segment.curvature),
                moments=(float(_rounded(segment.moments[0])), float(_rounded(segment.moments[1]))),
            )
            for segment in large.segments
        )
        return replace(large, base=self._lengths(curve.base), segments=tuple(segments))

    def _in_metres(self, curve: Configuration) -> Configuration:
        return _stretched(curve, self.metres)

    def _coordinates(self, values: FloatArray, arm: Arm) -> FloatArray:
        """Return configurations, shape (m, c), converted from the arm's units [rad, units] to [rad, m]."""
        units = np.ones(values.shape[-1])
        units[arm.links :] = self.metres
        # Clip to the axis range: the rounding to the grid may have moved its ends slightly.
        inside: FloatArray = values * units
        for column, axis in enumerate(arm.base_axes, start=arm.links):
            inside[..., column] = np.clip(inside[..., column], axis.low, axis.high)
        return inside

    def _finding(self, finding: Finding) -> Finding:
        length = finding.unit == "m"
        measured, allowed = (
            self.metres * value if length and value is not None else value
            for value in (finding.measured, finding.allowed)
        )
        return replace(
            finding,
            place=None if finding.place is None else tuple(self.metres * x for x in finding.place),
            measured=measured,
            allowed=allowed,
            way=tuple(tuple(self.metres * x for x in place) for place in finding.way),
            bounds={key: self.metres * x if key.endswith(LENGTH_KEYS) else x for key, x in finding.bounds.items()},
        )

    def _figure(self, key: str, value: object) -> object:
        """Return a number of a diagnosis, or a collection of numbers, in metres.

        The name ``key`` determines whether the number is a length, a curvature or neither.
        """
        if isinstance(value, Mapping):
            return {name: self._figure(name, each) for name, each in value.items()}
        if isinstance(value, list | tuple):
            return type(value)(self._figure(key, each) for each in value)
        if key in LENGTHS and isinstance(value, float):
            return self.metres * value
        return value / self.metres if key == "curvature_limit" and isinstance(value, float) else value


def _rounded_length(length: float) -> float:
    return float(_rounded(length))


def _rounded(values: FloatArray | float) -> FloatArray:
    """Return values rounded to as many significant binary digits as a length of one unit has on the grid."""
    mantissa, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.round(mantissa * GRID) / GRID, exponent))


def _stretched(curve: Configuration, factor: float) -> Configuration:
    """Return a planar curve scaled about the origin by a factor."""
    segments = tuple(
        replace(
            segment,
            length=factor * segment.length,
            curvature=segment.curvature / factor,
            moments=(segment.moments[0] / factor**3, segment.moments[1] / factor**3),
        )
        for segment in curve.segments
    )
    return replace(curve, base=factor * curve.base, segments=segments)


@contextmanager
def planning_units(problem: Problem) -> Iterator[OwnUnits]:
    """Provide a ``with`` block with the units of a problem's arm; messages and failures are converted to metres.

    Raises:
        NoPlanFound: raised in the block; its diagnosis is in metres.
    """
    units = OwnUnits(problem.arm.length)
    try:
        with words_for_unit(units.metres):
            yield units
    except NoPlanFound as failure:
        raise type(failure)(units.diagnosis_in_metres(failure.diagnosis)) from failure
