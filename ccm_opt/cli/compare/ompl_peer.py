"""OMPL's RRT-Connect (extra ``ompl``) as a peer, in the plane and in space.

Only the search is compared. The arm, its limits, poses at the goal, the proof that a motion touches nothing, the smooth
path, timing and verification are those of our planner. Our certificate proves motions that are straight in the bends,
at all times and not just at samples; so OMPL meets the same standard and checks motions by the same means as our
planner.
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
from ccm_opt.planning.drawn_poses import goal_poses
from ccm_opt.planning.draws import GoalDraws, TargetDraws
from ccm_opt.planning.ends import Ends, refuse_ends, resolve_ends
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.planning.own_units import planning_units
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.smooth_path import path_near_configurations
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.planning.spline_path import certified_spare, certified_spline
from ccm_opt.planning.strategies import find_by_ways
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bad_pose import clearance_advice
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.distances.surface_tree import SurfaceTree

NAME = "RRT-Connect of OMPL"
"""Name of the search in records."""
_ADVICE = ("raise planner.time_limit", "use planner.method nlp")
"""Advice when the search finds nothing."""


@dataclass(frozen=True)
class OmplSettings:
    """Settings of the OMPL planner.

    Attributes:
        planning_share: fraction of the time limit for planning; timing and verification need the rest. Taste: as
            for the baseline.
        goal_share: fraction of the time limit for finding poses at a tip goal. Taste.
        goal_poses: number of such poses that is enough. Taste: trees grow from all of them.
        simplifying_share: fraction of the time limit reserved for OMPL's path shortening. Taste.
        searched_gap: gap beyond contact that OMPL's paths keep, as a fraction of the arm's length. Taste.
        certified_gap: gap that the smooth path in the plane keeps; at corners the smooth path may deviate by the
            difference of the two gaps. Taste: as for the baseline.
        longest_turn: largest change of a bend in one leg of a path, so that refining a corner affects a short stretch
            only [rad]. Taste.
        beyond_tube: distance behind the guide tube at which joints begin to bend, in link lengths. Taste: so that a
            smooth path may begin to bend them a little earlier.
        refinements: rounds in which the smooth path is refined in the plane. Derived: a corner between legs of the
            longest turn is refined until the tip deviates by less than the difference of the two gaps.
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
"""Default settings of the OMPL planner."""


@dataclass(frozen=True)
class OmplPlanner:
    """Plans with OMPL; satisfies the ``Planner`` protocol.

    Attributes:
        settings: fractions of the time limit, and gaps that motions keep.
    """

    settings: OmplSettings = DEFAULT_OMPL

    def __post_init__(self) -> None:
        """Raise an error if OMPL is not installed."""
        ompl_modules()

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion.

        Raises:
            ProblemError: the problem has a feed axis in the plane, or via points, which this planner does not support;
                or its start cannot be represented.
            NoPlanFound: no motion was found in time.
        """
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
        start = joints.drawn(query.start)
        if start is None:
            raise ProblemError(
                "the start bends joints that have barely left the guide tube, which the method ompl does not support"
            )
        goals = [drawn for q in query.goals() if (drawn := joints.drawn(q)) is not None]
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
        """Return the sampler coordinates along a certified path, shape (K ≥ 2, c), with exact ends."""
        base, geometric, util = ompl_modules()
        util.noOutputHandler()
        planner_options = query.problem.planner
        # OMPL's generators are seeded from this one when they are made; seed 0 is not valid.
        util.RNG.setSeed(planner_options.seed + 1)
        information = _information(base, query)
        asked = base.ProblemDefinition(information)
        asked.addStartState(_state(information, start))
        there = base.GoalStates(information)
        for goal in goals:
            there.addState(_state(information, goal))
        asked.setGoal(there)
        planner = geometric.RRTConnect(information)
        planner.setProblemDefinition(asked)
        planner.setup()
        until = Deadline.after(query.deadline.left - self.settings.simplifying_share * planner_options.time_limit)
        planner.solve(base.PlannerTerminationCondition(until.passed))
        if not asked.hasExactSolution():
            reason = f"{until.what_passed()} before {NAME} found a path; goal poses: {len(goals)}"
            raise TimeLimitReached(Diagnosis(reason, "motion", _ADVICE, {"goal_poses": len(goals)}))
        path = asked.getSolutionPath()
        shortening = base.PlannerTerminationCondition(query.deadline.passed)
        geometric.PathSimplifier(information).simplify(path, shortening)
        return np.array([_drawn(state, len(start)) for state in path.getStates()])


@dataclass(frozen=True)
class SampledJoints:
    """The coordinates in which a sampler works, and the configurations that they represent.

    A guide tube holds joints straight, and a sampler never samples a bend of exactly zero. So every bend is scaled by
    how far its joint is out of the tube: by 0 inside, by 1 from one link beyond. Without a feed axis the coordinates
    are the bends themselves. The unit of the feed is a twenty-fourth of the arm's length.

    Attributes:
        arm: the arm.
        lower: lower limit of every coordinate of the configuration, shape (c,) [rad, m].
        upper: upper limit, shape (c,) [rad, m].
        longest_turn: largest change of a bend between consecutive keyframes [rad].
        beyond_tube: distance behind the tube at which joints begin to bend, in link lengths.
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

    def configuration(self, drawn: FloatArray) -> FloatArray:
        """Return the configurations for sampler coordinates, shape (..., c) [rad, m]."""
        q = drawn * self._units
        q[..., self.arm.coordinates.bends] *= self._out(q)
        return q

    def drawn(self, q: FloatArray) -> FloatArray | None:
        """Return the sampler coordinates for a configuration, shape (c,); None if they would exceed the limits."""
        out = np.append(self._out(q), np.ones(len(self.arm.base_axes)))
        drawn = np.where(out > 0.0, q / np.where(out > 0.0, out, 1.0), 0.0) / self._units
        slack = 1e-9
        fits = np.all(drawn >= self.low - slack) and np.all(drawn <= self.high + slack)
        return np.clip(drawn, self.low, self.high) if fits and np.allclose(self.configuration(drawn), q) else None

    def keyframes(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return configurations along a straight line in sampler coordinates, shape (k ≥ 2, c) [rad, m]."""
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
        """Feed position from which each joint may bend, slightly beyond the tube, shape (links,) [m].

        A smooth path begins to bend a joint somewhat earlier than the sampled path does.
        """
        beyond = self.beyond_tube * self.arm.link_length
        return np.asarray(self.arm.hole + beyond - self.arm.link_length * np.arange(self.arm.links), dtype=np.float64)

    def _out(self, q: FloatArray) -> FloatArray:
        """Return the factor from 0 to 1 by which each bend is scaled, shape (..., joints)."""
        coordinates = self.arm.coordinates
        if not self.arm.base_axes:
            return np.ones(coordinates.joints)
        beyond = (coordinates.advance(q)[..., None] - self._leaving) / self.arm.link_length
        return np.asarray(np.repeat(np.clip(beyond, 0.0, 1.0), coordinates.bends_a_joint, axis=-1), dtype=np.float64)


class _InPlane:
    """A planning query in the plane, in units of the arm's length."""

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
        """Yield a few configurations at the goal, each of shape (c,) [rad, m], from all of which trees are grown."""
        arm, settings = self.problem.arm, self._settings
        if self._ends.goal_pose is not None:
            yield self._ends.goal_pose
            return
        rng = np.random.default_rng(self.problem.planner.seed)
        check = SampledCheck.of(arm, self.problem.workspace)
        shapes = _any_shape(self.problem, self._ends)
        drawn = GoalDraws(shapes, self._ends.goal, check).poses(rng)
        until = Deadline.after(settings.goal_share * self.problem.planner.time_limit)
        found = 0
        while found < settings.goal_poses and not until.passed() and not self.deadline.passed():
            free = [q for q in arm.bends(next(drawn)) if _stands_free(self._searched, q)]
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
    """Return whether a configuration, shape (c,), is proved to be free of contact."""
    return len(certificate.failures(np.stack((q, q)), depth=0)) == 0


def _any_shape(problem: Problem, ends: Ends) -> TargetDraws:
    """Return the sampling coordinates for all shapes within the joint limits; a clamped base keeps its heading."""
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
    """Return the certificate for a gap, as a fraction of the arm's length, if both ends keep it; else for no gap."""
    with_gap = Certificate(problem.arm, problem.workspace, gap * problem.arm.length)
    known = [pose for pose in (ends.start, ends.goal_pose) if pose is not None]
    free = all(_stands_free(with_gap, pose) for pose in known)
    return with_gap if free else Certificate(problem.arm, problem.workspace)


class _InSpace:
    """A planning query in space."""

    def __init__(self, problem: Problem, settings: OmplSettings) -> None:
        arm = problem.arm
        self.problem = problem
        self._settings = settings
        self._tree = SurfaceTree.of(problem.workspace.soup)
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
        """Return the end pose of ccm-opt's own search, whose time is not charged to OMPL; None if the search fails.

        In ducts, hardly any pose sampled at a goal is free of contact, and a sampler without a goal can only fail.
        """
        if self.problem.goal.whole(self.problem.arm) is not None or self.problem.goal.via:
            return None
        try:
            found = find_by_ways(self._task_within(self._settings.goal_share)).configurations[-1]
        except NoPlanFound:
            return None
        return None if self.joints.drawn(found) is None else found

    def goals(self) -> Iterator[FloatArray]:
        """Yield a few configurations at the goal, each of shape (c,) [rad, m], from all of which trees are grown."""
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
            found += self.joints.drawn(pose.q) is not None
            yield pose.q
            if found == self._settings.goal_poses:
                return

    def safe(self, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
        """Return whether the straight motion between two configurations is proved free of contact."""
        return self._searched.safe(before, after, depth=depth)

    def smooth_path(self, keyframes: FloatArray) -> JointPath | None:
        """Return a certified smooth path near keyframes of shape (K, c) [rad, m]; None if none was found."""
        spline = path_near_configurations(keyframes, self._task)
        return None if spline is None else JointPath(spline, keyframes, (), NAME, spare=self._task.spare)


_Query: TypeAlias = _InPlane | _InSpace
"""A query to OMPL: start, goals, the check of motions, and smoothing of the path."""


def _information(base: Any, query: _Query) -> Any:
    """Return OMPL's space information, in which the certificate checks states and motions."""
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
        """OMPL motion validator that checks motions with the certificate."""

        def checkMotion(self, one: Any, other: Any) -> bool:  # noqa: N802 - OMPL's name
            """Return whether the straight motion between two states is proved free of contact."""
            keyframes = joints.keyframes(_drawn(one, count), _drawn(other, count))
            return all(query.safe(before, after) for before, after in pairwise(keyframes))

    information.setStateValidityChecker(stands_free)
    information.setMotionValidator(CertifiedMotions(information))
    information.setup()
    return information


def _state(information: Any, drawn: FloatArray) -> Any:
    """Return an OMPL state with sampler coordinates, shape (c,)."""
    state = information.allocState()
    for k, value in enumerate(drawn):
        state[k] = float(value)
    return state


def _drawn(state: Any, count: int) -> FloatArray:
    return np.array([state[k] for k in range(count)])


def ompl_modules() -> tuple[Any, Any, Any]:
    """Return OMPL's modules ``base``, ``geometric`` and ``util``.

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
