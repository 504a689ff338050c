"""Planner that uses RRT-Connect of OMPL (extra ``ompl``), for comparison, for planar arms and arms in space.

Only the search is compared. Goal poses, collision checking of motions, smoothing, timing and verification are those of
the built-in planner. Collisions are checked by its certificate, which proves straight motions in joint space
collision-free at all times, not only at samples.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib import import_module
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, NoPlanFound, ProblemError, TimeLimitReached
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.draws import GoalDraws, TargetDraws
from ccm_opt.planning.ends import Ends, refuse_ends, resolve_ends
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.planning.own_units import planning_units
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.sampled_poses import goal_poses
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.smooth_path import path_near_configurations
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.planning.spline_path import certified_spare, certified_spline
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.problem.tool_rules import refuse_tool
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bad_pose import clearance_advice
from ccm_opt.scene.certificate import Certificate

NAME = "RRT-Connect of OMPL"
"""Name of the planner in records."""
_ADVICE = ("raise planner.time_limit", "use planner.method nlp")
"""Advice to the user when no path is found."""


@dataclass(frozen=True)
class OmplSettings:
    """Settings of the OMPL planner.

    Attributes:
        planning_share: fraction of the time limit for planning; the rest is for timing and verification. Heuristic: as
            for the paper's planner.
        goal_share: fraction of the time limit for finding poses at a goal for the tip. Heuristic.
        goal_poses: maximum number of goal poses, from all of which trees grow. Heuristic.
        simplifying_share: fraction of the time limit reserved for shortening the path. Heuristic.
        searched_gap: clearance beyond contact that paths of OMPL keep, as a fraction of the arm's length. Heuristic.
        certified_gap: clearance beyond contact that the smooth planar path keeps, as a fraction of the arm's length; at
            corners it may deviate from the path of OMPL by the difference. Heuristic: as for the paper's planner.
        longest_turn: maximum change of a joint angle between two keyframes [rad]; a small value keeps the refinement of
            a corner local. Heuristic.
        beyond_tube: distance beyond the guide tube at which joints begin to bend, in link lengths. Heuristic: a smooth
            path may begin to bend them a little earlier.
        refinements: maximum number of refinements of the smooth planar path. Derived: they reduce the deviation at a
            corner of maximum turn below the difference of the two clearances.
        motion: settings of goal poses, certificate and smooth path in space.
    """

    planning_share: float = 0.9
    goal_share: float = 0.2
    goal_poses: int = 10
    simplifying_share: float = 0.15
    searched_gap: float = 3e-4
    certified_gap: float = 1e-4
    longest_turn: float = 0.2
    beyond_tube: float = 0.2
    refinements: int = 10
    motion: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)


DEFAULT_OMPL = OmplSettings()
"""Default settings of the planner that uses OMPL."""


@dataclass(frozen=True)
class OmplPlanner:
    """Planner with the search RRT-Connect of OMPL; implements the ``Planner`` protocol.

    Attributes:
        settings: fractions of the time limit, and clearances that motions keep.
    """

    settings: OmplSettings = DEFAULT_OMPL

    def __post_init__(self) -> None:
        """Raise an error if OMPL is not installed."""
        ompl_modules()

    def plan(self, problem: Problem) -> JointPath:
        """Return a certified path for a problem.

        Raises:
            ProblemError: the arm is planar with a feed axis, or the goal has via points; or the
                start cannot be represented in the coordinates of the sampler.
            NoPlanFound: no path was found in time.
        """
        refuse_tool(problem.arm, "the method ompl")
        if problem.arm.drives is not None:
            raise ProblemError('the OMPL planner does not support arm.sections with drive = "section" or arm.coupling')
        if problem.arm.carrier:
            raise ProblemError("the method ompl does not support arm.base.axes; use planner.method nlp")
        if problem.dimension == 3:
            return self._path(_InSpace(problem, self.settings))
        if problem.arm.base_axes:
            raise ProblemError(
                "the method ompl does not support a feed axis; use planner.method nlp, or leave arm.feed out"
            )
        with planning_units(problem) as units:
            path = self._path(_InPlane(units.scaled(problem), self.settings))
        return units.path_in_metres(path, problem.arm)

    def _path(self, query: "_Query") -> JointPath:
        joints = query.joints
        start = joints.sample(query.start)
        if start is None:
            raise ProblemError(
                "the start bends joints that have barely left the guide tube, which the method ompl does not support"
            )
        goals = [sample for q in query.goals() if (sample := joints.sample(q)) is not None]
        if not goals:
            reason = "no collision-free pose with the tip at the goal was sampled"
            raise MotionNotFound(Diagnosis(reason, "goal", _ADVICE))
        legs = [joints.keyframes(*pair)[1:] for pair in pairwise(self._way(query, start, goals))]
        path = query.smooth_path(np.concatenate((query.start[None], *legs)))
        if path is None:
            advice = clearance_advice(query.problem.arm.radius, query.problem.workspace.clearance)
            raise MotionNotFound(Diagnosis("the motion's clearance is too small for a smooth path", "motion", advice))
        return path

    def _way(self, query: "_Query", start: FloatArray, goals: list[FloatArray]) -> FloatArray:
        """Return the K vertices of a certified path found by OMPL, in sampler coordinates, shape (K, c).

        The first vertex is exactly the start, the last exactly a goal.

        Args:
            query: the planning query.
            start: sampler coordinates of the start, shape (c,).
            goals: sampler coordinates of poses at the goal, each of shape (c,).
        """
        base, geometric, util = ompl_modules()
        util.noOutputHandler()
        planner_options = query.problem.planner
        # OMPL's generators are seeded from this one when they are made; seed 0 is not valid.
        util.RNG.setSeed(planner_options.seed + 1)
        information = _information(base, query)
        definition = base.ProblemDefinition(information)
        definition.addStartState(_state(information, start))
        there = base.GoalStates(information)
        for goal in goals:
            there.addState(_state(information, goal))
        definition.setGoal(there)
        planner = geometric.RRTConnect(information)
        planner.setProblemDefinition(definition)
        planner.setup()
        until = Deadline.after(query.deadline.left - self.settings.simplifying_share * planner_options.time_limit)
        planner.solve(base.PlannerTerminationCondition(until.passed))
        if not definition.hasExactSolution():
            reason = f"{until.what_passed()} before {NAME} found a path; goal poses: {len(goals)}"
            raise TimeLimitReached(Diagnosis(reason, "motion", _ADVICE, {"goal_poses": len(goals)}))
        path = definition.getSolutionPath()
        shortening = base.PlannerTerminationCondition(query.deadline.passed)
        geometric.PathSimplifier(information).simplify(path, shortening)
        return np.array([_drawn(state, len(start)) for state in path.getStates()])


@dataclass(frozen=True)
class SampledJoints:
    """Transformation between the c coordinates in which OMPL samples and configurations of the arm.

    The guide tube of a feed axis holds joints straight, but a sampler never samples an angle of exactly zero. Every
    joint angle is therefore scaled by a factor that grows from 0 inside the tube to 1 one link length beyond. Without a
    feed axis, sampler coordinates are the joint angles. The feed is measured in units of a twenty-fourth of the arm's
    length.

    Attributes:
        arm: the arm.
        lower: lower limits of the configuration, shape (c,) [rad, m].
        upper: upper limits of the configuration, shape (c,) [rad, m].
        longest_turn: maximum change of a joint angle between consecutive keyframes [rad].
        beyond_tube: distance beyond the tube at which joints begin to bend, in link lengths.
    """

    arm: Arm
    lower: FloatArray
    upper: FloatArray
    longest_turn: float
    beyond_tube: float = 0.0

    @property
    def low(self) -> FloatArray:
        """Lower limits of the sampler coordinates, shape (c,)."""
        return self.lower / self._units

    @property
    def high(self) -> FloatArray:
        """Upper limits of the sampler coordinates, shape (c,)."""
        return self.upper / self._units

    def configuration(self, sample: FloatArray) -> FloatArray:
        """Return the configurations, shape (..., c) [rad, m], that sampler coordinates of shape (..., c) represent."""
        q = sample * self._units
        q[..., self.arm.coordinates.bends] *= self._out(q)
        return q

    def sample(self, q: FloatArray) -> FloatArray | None:
        """Return the sampler coordinates, shape (c,), of a configuration, shape (c,) [rad, m], or None.

        The result is None if the coordinates would be outside the range of the sampler or would not represent this
        configuration.
        """
        out = np.append(self._out(q), np.ones(len(self.arm.base_axes)))
        sample = np.where(out > 0.0, q / np.where(out > 0.0, out, 1.0), 0.0) / self._units
        slack = 1e-9
        fits = np.all(sample >= self.low - slack) and np.all(sample <= self.high + slack)
        return np.clip(sample, self.low, self.high) if fits and np.allclose(self.configuration(sample), q) else None

    def keyframes(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return configurations along a segment in sampler coordinates, with both ends, shape (k ≥ 2, c) [rad, m].

        Args:
            before: sampler coordinates of the first end, shape (c,).
            after: sampler coordinates of the second end, shape (c,).
        """
        bends = self.arm.coordinates.bends
        count = max(1, int(np.ceil(float(np.abs((after - before)[bends]).max()) / self.longest_turn)))
        shares = [np.linspace(0.0, 1.0, count + 1)]
        for begin, end in zip(before[bends.stop :], after[bends.stop :], strict=True):
            # Joints leave the tube at keyframes, so that nothing bends inside the tube.
            places = np.append(self._leaving, self._leaving + self.arm.link_length) / self._units[-1]
            met = (places - begin) / (end - begin) if begin != end else np.zeros(0)
            shares.append(met[(met > 0.0) & (met < 1.0)])
        share = np.unique(np.concatenate(shares))[:, None]
        return self.configuration((1.0 - share) * before + share * after)

    @property
    def _units(self) -> FloatArray:
        of_axes = np.full(len(self.arm.base_axes), self.arm.length / 24.0)
        return np.append(np.ones(self.arm.coordinates.joints), of_axes)

    @property
    def _leaving(self) -> FloatArray:
        """Feeds at which the joints of n links begin to bend, slightly beyond the guide tube, shape (n,) [m].

        A smooth path begins to bend a joint a little earlier than the sampled path.
        """
        beyond = self.beyond_tube * self.arm.link_length
        return np.asarray(self.arm.hole + beyond - self.arm.joint_places[:-1], dtype=np.float64)

    def _out(self, q: FloatArray) -> FloatArray:
        """Return the factors in [0, 1] that scale the b joint angles of configurations (..., c), shape (..., b)."""
        coordinates = self.arm.coordinates
        if not self.arm.base_axes:
            return np.ones(coordinates.joints)
        beyond = (coordinates.advance(q)[..., None] - self._leaving) / self.arm.link_length
        return np.asarray(np.repeat(np.clip(beyond, 0.0, 1.0), coordinates.bends_a_joint, axis=-1), dtype=np.float64)


class _InPlane:
    """Query to OMPL for a planar arm: start, goals, collision check and smoothing; lengths in arm lengths."""

    def __init__(self, problem: Problem, settings: OmplSettings) -> None:
        arm = problem.arm
        self.problem = problem
        self._settings = settings
        self.deadline = Deadline.after(settings.planning_share * problem.planner.time_limit)
        self._ends = ends = resolve_ends(problem)
        self.start = ends.start
        # The bounds always contain the start.
        reach = np.maximum(arm.bend_limits, np.abs(self.start))
        low, high = -reach, reach.copy()
        if ends.clamped:
            low[0] = high[0] = self.start[0]
        self.joints = SampledJoints(arm, low, high, settings.longest_turn)
        self._searched = _certificate(problem, ends, settings.searched_gap)

    def goals(self) -> Iterator[FloatArray]:
        """Yield several configurations at the goal from which trees grow, each of shape (c,) [rad]."""
        arm, settings = self.problem.arm, self._settings
        if self._ends.goal_pose is not None:
            yield self._ends.goal_pose
            return
        rng = np.random.default_rng(self.problem.planner.seed)
        check = SampledCheck.for_workspace(arm, self.problem.workspace)
        shapes = _any_shape(self.problem, self._ends)
        samples = GoalDraws(shapes, self._ends.goal, check).poses(rng)
        until = Deadline.after(settings.goal_share * self.problem.planner.time_limit)
        found = 0
        while found < settings.goal_poses and not until.passed() and not self.deadline.passed():
            free = [q for q in arm.bends(next(samples)) if _stands_free(self._searched, q)]
            yield from free[: settings.goal_poses - found]
            found += len(free)

    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        return len(self._searched.failures(np.stack((before, after)), depth=depth)) == 0

    def smooth_path(self, keyframes: FloatArray) -> JointPath | None:
        certificate = _certificate(self.problem, self._ends, self._settings.certified_gap)
        spline = certified_spline(keyframes, certificate, self._settings.refinements)
        if spline is None:
            return None
        curves = nearest_curves(self.problem.arm, keyframes)
        return JointPath(spline, keyframes, curves, NAME, spare=certified_spare(spline, certificate))


def _stands_free(certificate: Certificate, q: FloatArray) -> bool:
    """Return whether a configuration, shape (c,) [rad, m], is proved collision-free by a certificate."""
    return len(certificate.failures(np.stack((q, q)), depth=0)) == 0


def _any_shape(problem: Problem, ends: Ends) -> TargetDraws:
    """Return the coordinates from which OMPL samples all configurations within the joint limits of a planar arm.

    With a clamped base the first bend angle is fixed; otherwise it has its full range.
    """
    arm = problem.arm
    free = np.eye(arm.links)
    if ends.clamped:
        free[0, 0] = 0.0
    start = arm.headings(ends.start)
    first = float(ends.start[0])
    bound = float(arm.bend_limits[0])
    # The base may turn over its whole range, while our planners take the turn that winds the arm least.
    base = (first, first) if ends.clamped else (-bound, bound)
    return TargetDraws(arm, free, (start, start), arm.bend_limits, base)


def _certificate(problem: Problem, ends: Ends, gap: float) -> Certificate:
    """Return a certificate that proves a clearance if start and goal pose keep it, else one that proves no contact.

    Args:
        problem: the problem.
        ends: start and goal.
        gap: clearance beyond contact, as a fraction of the arm's length.
    """
    with_gap = Certificate(problem.arm, problem.workspace, gap * problem.arm.length)
    known = [pose for pose in (ends.start, ends.goal_pose) if pose is not None]
    free = all(_stands_free(with_gap, pose) for pose in known)
    return with_gap if free else Certificate(problem.arm, problem.workspace)


class _InSpace:
    """A query to OMPL for an arm in space: start, goals, collision check and smoothing."""

    def __init__(self, problem: Problem, settings: OmplSettings) -> None:
        arm = problem.arm
        self.problem = problem
        self._settings = settings
        self._tree = problem.workspace.surface_tree
        self.joints = SampledJoints(
            arm, arm.lower_limits, arm.upper_limits, settings.longest_turn, settings.beyond_tube
        )
        self._given = self._where_ours_ends()
        self._task = self._task_within(settings.planning_share)
        if self._task.via:
            raise ProblemError("the method ompl does not support goal.via; leave it out, or use nlp")
        refuse_ends(problem, self._task)
        self.start, self.deadline = self._task.start, self._task.deadline
        # The smooth path deviates from the sampled path at corners, which takes some gap.
        beyond = settings.searched_gap * arm.length
        certificate = self._task.contact_certificate
        self._searched = replace(certificate, gap=certificate.gap + beyond, pair_gap=certificate.pair_gap + beyond)

    def _task_within(self, share: float) -> SpaceTask:
        until = Deadline.after(share * self.problem.planner.time_limit)
        return space_task(self.problem, self._tree, until, self._settings.motion)

    def _where_ours_ends(self) -> FloatArray | None:
        """Return the final configuration of the built-in planner's motion, shape (c,) [rad, m]; None if it finds none.

        It serves as a goal pose. In ducts hardly any sampled goal pose is collision-free, and without one OMPL cannot
        succeed. The time of this search is not counted as OMPL's.
        """
        if self.problem.goal.whole(self.problem.arm) is not None or self.problem.goal.via:
            return None
        try:
            found = find_by_ways(self._task_within(self._settings.goal_share)).configurations[-1]
        except NoPlanFound:
            return None
        return None if self.joints.sample(found) is None else found

    def goals(self) -> Iterator[FloatArray]:
        """Yield several configurations at the goal from which trees grow, each of shape (c,) [rad, m]."""
        if self._given is not None:
            yield self._given
            return
        task = self._task_within(self._settings.goal_share)
        if task.goal_pose is not None:
            yield task.goal_pose
            return
        curve, _ = CurveMap.through(task.arm, task.start)
        rng = np.random.default_rng(self.problem.planner.seed)
        found = 0
        for pose in goal_poses(task, task.stepper(curve), rng):
            found += self.joints.sample(pose.q) is not None
            yield pose.q
            if found == self._settings.goal_poses:
                return

    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Return whether the straight motion in joint space between two configurations is proved collision-free.

        Args:
            before: the first configuration, shape (c,) [rad, m].
            after: the second configuration, shape (c,) [rad, m].
            depth: maximum number of bisections of the motion; None for the default.
        """
        return self._searched.safe(before, after, depth=depth)

    def smooth_path(self, keyframes: FloatArray) -> JointPath | None:
        """Return a certified smooth path near K keyframes, shape (K, c) [rad, m]; None if none was found."""
        spline = path_near_configurations(keyframes, self._task)
        return None if spline is None else JointPath(spline, keyframes, (), NAME, spare=self._task.spare)


_Query: TypeAlias = _InPlane | _InSpace
"""A query to OMPL: start, goals, collision check of motions, and smoothing of the path."""


def _information(base: Any, query: _Query) -> Any:
    """Return the space information of OMPL in which the certificate checks states and motions.

    Args:
        base: module ``base`` of OMPL.
        query: the planning query.
    """
    joints = query.joints
    low, high = joints.low, joints.high
    count = len(low)
    bounds = base.RealVectorBounds(count)
    for k in range(count):
        bounds.setLow(k, float(low[k]))
        bounds.setHigh(k, float(high[k]))
    space = base.RealVectorStateSpace(count)
    space.setBounds(bounds)
    information = base.SpaceInformation(space)

    def stands_free(state: Any) -> bool:
        q = joints.configuration(_drawn(state, count))
        return query.safe(q, q, depth=0)

    class CertifiedMotions(base.MotionValidator):  # type: ignore[misc]
        """Motion validator of OMPL that proves motions collision-free with the certificate."""

        def checkMotion(self, one: Any, other: Any) -> bool:  # noqa: N802 - OMPL's name
            """Return whether the straight motion between two states is proved collision-free."""
            keyframes = joints.keyframes(_drawn(one, count), _drawn(other, count))
            return all(query.safe(before, after) for before, after in pairwise(keyframes))

    information.setStateValidityChecker(stands_free)
    information.setMotionValidator(CertifiedMotions(information))
    information.setup()
    return information


def _state(information: Any, sample: FloatArray) -> Any:
    """Return an OMPL state with given sampler coordinates, shape (c,)."""
    state = information.allocState()
    for k, value in enumerate(sample):
        state[k] = float(value)
    return state


def _drawn(state: Any, count: int) -> FloatArray:
    return np.array([state[k] for k in range(count)])


def ompl_modules() -> tuple[Any, Any, Any]:
    """Return the modules ``base``, ``geometric`` and ``util`` of OMPL.

    Raises:
        ProblemError: OMPL is not installed.
    """
    try:
        return import_module("ompl.base"), import_module("ompl.geometric"), import_module("ompl.util")
    except ImportError as error:
        raise ProblemError(
            f"the method ompl needs the package ompl; install it with: pip install ompl ({error})"
        ) from error


__all__ = ["OmplPlanner"]
