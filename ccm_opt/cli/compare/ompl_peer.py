"""OMPL's RRT-Connect (extra ``ompl``), as a peer, in the plane and in space.

What is compared is the search. The arm, its limits, poses at the goal, the proof that a motion touches nothing, the
smooth path, timing and verification are those of our planner. A straight motion of the bends is what the certificate
proves, for all times and not at samples; so OMPL is held to the same as ours, and asks for a motion what ours asks.
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
from ccm_opt.scene.bad_pose import room_advice
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.distances.surface_tree import SurfaceTree

NAME = "RRT-Connect of OMPL"
"""Of what finds the motion, in records."""
_ADVICE = ("raise planner.time_limit", "use planner.method nlp")
"""What helps where it finds nothing."""


@dataclass(frozen=True)
class OmplSettings:
    """What the planner of OMPL is given and allowed.

    Attributes:
        planning_share: share of the time limit that planning may use; timing and verification need the rest. Taste: as
            the baseline's.
        goal_share: share of the time limit within which poses at a goal for the tip are found. Taste.
        goal_poses: such poses that are enough. Taste: trees grow from all of them.
        simplifying_share: share of the time limit that is kept for OMPL's shortening of the way. Taste.
        searched_gap: gap beyond contact that the ways of OMPL keep, as a share of the arm's length. Taste.
        certified_gap: in the plane, the same of the smooth path, which leaves the way at its corners by what is between
            the two. Taste: as the baseline's.
        longest_turn: change of a bend by which a way is cut into legs, so that a corner that is refined is a short
            stretch of it [rad]. Taste.
        beyond_tube: how far behind a guide tube joints begin to bend, in link lengths. Taste: so that a smooth path may
            begin to bend them a little earlier.
        refinements: rounds in which the smooth path is refined in the plane. Derived: a corner of legs of the longest
            turn is refined until the tip leaves it by less than what is between the two gaps.
        draws: how poses at a goal for the tip are drawn in the plane.
        motion: numbers of goal poses, certificate and smooth path in space.
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
"""What the planner takes when it is not given other settings."""


@dataclass(frozen=True)
class OmplPlanner:
    """Plans with OMPL; satisfies the ``Planner`` protocol.

    Attributes:
        settings: shares of the time, and the gap that motions keep.
    """

    settings: OmplSettings = DEFAULT_OMPL

    def __post_init__(self) -> None:
        """Refuse where OMPL is not installed."""
        ompl_modules()

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion.

        Raises:
            ProblemError: the problem has a feed axis in the plane or places on the way, which this planner does not
                know.
            NoPlanFound: none was found in time.
        """
        if problem.dimension == 3:
            return self._path(_InSpace(problem, self.settings))
        if problem.arm.base_axes:
            raise ProblemError("the method ompl moves no feed axis; use planner.method nlp, or leave arm.feed out")
        with planning_units(problem) as units:
            path = self._path(_InPlane(units.scaled(problem), self.settings))
        return units.path_in_metres(path, problem.arm)

    def _path(self, query: "_Query") -> JointPath:
        joints = query.joints
        start = joints.drawn(query.start)
        if start is None:
            raise ProblemError("the start bends joints that are hardly out of the guide tube; the method ompl cannot")
        goals = [drawn for q in query.goals() if (drawn := joints.drawn(q)) is not None]
        if not goals:
            reason = "no pose with the tip at the goal that touches nothing was drawn"
            raise MotionNotFound(Diagnosis(reason, "goal", _ADVICE))
        legs = [joints.keyframes(*pair)[1:] for pair in pairwise(self._way(query, start, goals))]
        path = query.smooth_path(np.concatenate((query.start[None], *legs)))
        if path is None:
            advice = room_advice(query.problem.arm.radius, query.problem.workspace.clearance)
            raise MotionNotFound(Diagnosis("the motion leaves no room for a smooth path", "motion", advice))
        return path

    def _way(self, query: "_Query", start: FloatArray, goals: list[FloatArray]) -> FloatArray:
        """Return the draws along a certified way, shape (K ≥ 2, c), the ends exact."""
        base, geometric, util = ompl_modules()
        util.noOutputHandler()
        planner_options = query.problem.planner
        # OMPL's generators take their seeds from this one when they are made; 0 is none.
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
            reason = f"{until.what_passed()} before {NAME} had a way; poses at the goal: {len(goals)}"
            raise TimeLimitReached(Diagnosis(reason, "motion", _ADVICE, {"goal_poses": len(goals)}))
        path = asked.getSolutionPath()
        shortening = base.PlannerTerminationCondition(query.deadline.passed)
        geometric.PathSimplifier(information).simplify(path, shortening)
        return np.array([_drawn(state, len(start)) for state in path.getStates()])


@dataclass(frozen=True)
class SampledJoints:
    """What a sampler draws for an arm, and the configurations that this stands for.

    A guide tube holds joints straight, and a sampler never draws that a number is zero. So every bend counts by how far
    its joint has come out of the tube: not at all inside, in full a link beyond. Without a feed axis what is drawn are
    the bends themselves. The feed is counted in twenty-fourths of the arm.

    Attributes:
        arm: the arm.
        lower: least value of every coordinate, shape (c,) [rad, m].
        upper: greatest value, shape (c,) [rad, m].
        longest_turn: by which a bend may change from one configuration to the next [rad].
        beyond_tube: how far behind the tube joints begin to bend, in link lengths.
    """

    arm: Arm
    lower: FloatArray
    upper: FloatArray
    longest_turn: float
    beyond_tube: float = 0.0

    @property
    def low(self) -> FloatArray:
        """Least value of everything drawn, shape (c,)."""
        return self.lower / self._units

    @property
    def high(self) -> FloatArray:
        """Greatest value of everything drawn, shape (c,)."""
        return self.upper / self._units

    def configuration(self, drawn: FloatArray) -> FloatArray:
        """Return what draws stand for, shape (..., c) [rad, m]."""
        q = drawn * self._units
        q[..., self.arm.coordinates.bends] *= self._out(q)
        return q

    def drawn(self, q: FloatArray) -> FloatArray | None:
        """Return what stands for a configuration, shape (c,); None where that is beyond the limits."""
        out = np.append(self._out(q), np.ones(len(self.arm.base_axes)))
        drawn = np.where(out > 0.0, q / np.where(out > 0.0, out, 1.0), 0.0) / self._units
        slack = 1e-9
        fits = np.all(drawn >= self.low - slack) and np.all(drawn <= self.high + slack)
        return np.clip(drawn, self.low, self.high) if fits and np.allclose(self.configuration(drawn), q) else None

    def keyframes(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the configurations along a straight line between draws, shape (k ≥ 2, c) [rad, m]."""
        bends = self.arm.coordinates.bends
        count = max(1, int(np.ceil(float(np.abs((after - before)[bends]).max()) / self.longest_turn)))
        shares = [np.linspace(0.0, 1.0, count + 1)]
        for begin, end in zip(before[bends.stop :], after[bends.stop :], strict=True):
            # A joint that comes out of the tube does so at a keyframe, so that nothing bends in it.
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
        """Feed from which on each joint may bend, a little beyond the tube, shape (links,) [m].

        A smooth path begins to bend it somewhat earlier than the way does.
        """
        beyond = self.beyond_tube * self.arm.link_length
        return np.asarray(self.arm.hole + beyond - self.arm.link_length * np.arange(self.arm.links), dtype=np.float64)

    def _out(self, q: FloatArray) -> FloatArray:
        """Return how far each bend counts, from 0 to 1, shape (..., joints)."""
        coordinates = self.arm.coordinates
        if not self.arm.base_axes:
            return np.ones(coordinates.joints)
        beyond = (coordinates.advance(q)[..., None] - self._leaving) / self.arm.link_length
        return np.asarray(np.repeat(np.clip(beyond, 0.0, 1.0), coordinates.bends_a_joint, axis=-1), dtype=np.float64)


class _InPlane:
    """A query in the plane, in units of the arm."""

    def __init__(self, problem: Problem, settings: OmplSettings) -> None:
        arm = problem.arm
        self.problem = problem
        self._settings = settings
        self.deadline = Deadline.after(settings.planning_share * problem.planner.time_limit)
        self._ends = ends = resolve_ends(problem)
        self.start = ends.start
        # Bounds hold the start in any case.
        reach = np.maximum(arm.bend_limits, np.abs(self.start))
        low, high = -reach, reach.copy()
        if ends.clamped:
            low[0] = high[0] = self.start[0]
        self.joints = SampledJoints(arm, low, high, settings.longest_turn)
        self._searched = _certificate(problem, ends, settings.searched_gap)

    def goals(self) -> Iterator[FloatArray]:
        """Yield configurations at the goal, few enough to grow trees from all of them, each of shape (c,) [rad, m]."""
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
    """Return whether a configuration, shape (c,), touches nothing."""
    return len(certificate.failures(np.stack((q, q)), depth=0)) == 0


def _any_shape(problem: Problem, ends: Ends) -> TargetDraws:
    """Return the draws of every shape that the joints allow; a base that is clamped stays where it is."""
    arm = problem.arm
    free = np.eye(arm.links)
    if ends.clamped:
        free[0, 0] = 0.0
    start = arm.headings(ends.start)
    first = float(ends.start[0])
    bound = float(arm.bend_limits[0])
    # As far as the base may turn at all: other planners are held to what winds the arm least.
    base = (first, first) if ends.clamped else (-bound, bound)
    return TargetDraws(arm, free, (start, start), arm.bend_limits, base)


def _certificate(problem: Problem, ends: Ends, gap: float) -> Certificate:
    """With a gap, as a share of the arm's length, where both ends have it; ends that touch something must be let go."""
    with_gap = Certificate(problem.arm, problem.workspace, gap * problem.arm.length)
    known = [pose for pose in (ends.start, ends.goal_pose) if pose is not None]
    free = all(_stands_free(with_gap, pose) for pose in known)
    return with_gap if free else Certificate(problem.arm, problem.workspace)


class _InSpace:
    """A query in space."""

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
            raise ProblemError("the method ompl knows no places on the way; leave goal.via out, or use nlp")
        refuse_ends(problem, self._task)
        self.start, self.deadline = self._task.start, self._task.deadline
        # The smooth path leaves the way at its corners, and needs some gap for that.
        beyond = settings.searched_gap * arm.length
        certificate = self._task.contact_certificate
        self._searched = replace(certificate, gap=certificate.gap + beyond, pair_gap=certificate.pair_gap + beyond)

    def _task_within(self, share: float) -> SpaceTask:
        until = Deadline.after(share * self.problem.planner.time_limit)
        return space_task(self.problem, self._tree, until, self._settings.motion)

    def _where_ours_ends(self) -> FloatArray | None:
        """Return where our own search ends, which the sampler gets for nothing of its time.

        None where that finds nothing.

        In ducts hardly any pose that is drawn at a goal touches nothing, and a sampler without a goal can only fail.
        """
        if self.problem.goal.whole(self.problem.arm) is not None or self.problem.goal.via:
            return None
        try:
            found = find_by_ways(self._task_within(self._settings.goal_share)).configurations[-1]
        except NoPlanFound:
            return None
        return None if self.joints.drawn(found) is None else found

    def goals(self) -> Iterator[FloatArray]:
        """Yield configurations at the goal, few enough to grow trees from all of them, each of shape (c,) [rad, m]."""
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
        """Return the certified smooth path near keyframes, shape (K, c) [rad, m]; None where there is none."""
        spline = path_near_configurations(keyframes, self._task)
        return None if spline is None else JointPath(spline, keyframes, (), NAME, spare=self._task.spare)


_Query: TypeAlias = _InPlane | _InSpace
"""What OMPL is asked: from where, to where, what is safe, and how its way becomes a path."""


def _information(base: Any, query: _Query) -> Any:
    """Return the space that OMPL plans in, with the certificate as judge of states and motions."""
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
        """Motions that the certificate proves free of contact."""

        def checkMotion(self, one: Any, other: Any) -> bool:  # noqa: N802 - OMPL's name
            """Return whether the straight motion from a state to another touches nothing."""
            keyframes = joints.keyframes(_drawn(one, count), _drawn(other, count))
            return all(query.safe(before, after) for before, after in pairwise(keyframes))

    information.setStateValidityChecker(stands_free)
    information.setMotionValidator(CertifiedMotions(information))
    information.setup()
    return information


def _state(information: Any, drawn: FloatArray) -> Any:
    """Return a state of OMPL from draws, shape (c,)."""
    state = information.allocState()
    for k, value in enumerate(drawn):
        state[k] = float(value)
    return state


def _drawn(state: Any, count: int) -> FloatArray:
    return np.array([state[k] for k in range(count)])


def ompl_modules() -> tuple[Any, Any, Any]:
    """Return the OMPL's modules ``base``, ``geometric`` and ``util``.

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
