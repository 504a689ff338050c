"""OMPL's RRT-Connect in the plane, as a peer.

A straight motion of the bends turns every link evenly, which is what the certificate proves, for all times and not at
samples. So OMPL's planners are held to the same as ours, and ask for a motion what ours ask.

What is compared is the search. The arm, its limits, poses at the goal, the proof that a motion touches nothing, the
smooth path, timing and verification are those of our planners.
"""

from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.errors import Diagnosis, MotionNotFound, ProblemError, TimeLimitReached
from ccm_opt.planning.draws import GoalDraws, TargetDraws
from ccm_opt.planning.ends import Ends, resolve_ends
from ccm_opt.planning.own_units import in_own_units
from ccm_opt.planning.pose import nearest_curve
from ccm_opt.planning.sampled_check import SampledCheck
from ccm_opt.planning.settings import ConnectSettings, SmoothPathSettings
from ccm_opt.planning.shortcuts import dense
from ccm_opt.planning.spline_path import certified_spline, spare_kept
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bad_pose import room_advice
from ccm_opt.scene.certificate import Certificate
from ccm_opt.solution import JointPath


@dataclass(frozen=True)
class OmplSettings:
    """What the planner of OMPL is given and allowed.

    Attributes:
        planning_share: share of the time limit that planning may use; timing and verification need the rest. Taste: as
            the baseline's.
        goal_share: share of the time limit within which poses at a goal for the tip are drawn. Taste.
        goal_poses: such poses that are enough. Taste: trees grow from all of them.
        simplifying_share: share of the time limit that is kept for OMPL's shortening of the way. Taste.
        searched_gap: gap beyond contact that the ways of OMPL keep, as a share of the arm's length. Taste.
        certified_gap: the same of the smooth path, which leaves the way at its corners by what is between the two.
            Taste: as the baseline's.
        longest_turn: turn of a link by which a way is cut into legs, so that a corner that is refined is a short
            stretch of it [rad]. Taste.
        beyond_tube: in space, how far behind a guide tube joints begin to bend, in link lengths. Taste: so that a
            smooth path may begin to bend them a little earlier.
        smooth: how the smooth path is found. Derived: a corner of legs of the longest turn is refined until the tip
            leaves it by less than what is between the two gaps.
        draws: how poses at a goal for the tip are drawn.
    """

    planning_share: float = 0.9
    goal_share: float = 0.2
    goal_poses: int = 10
    simplifying_share: float = 0.15
    searched_gap: float = 3e-4
    certified_gap: float = 1e-4
    longest_turn: float = 0.2
    beyond_tube: float = 0.2
    smooth: SmoothPathSettings = field(default_factory=lambda: SmoothPathSettings(refinements=10))
    draws: ConnectSettings = field(default_factory=ConnectSettings)


DEFAULT_OMPL = OmplSettings()
"""What the planner takes when it is not given other settings."""


def poses_at_goal(
    problem: Problem, ends: Ends, certificate: Certificate, deadline: Deadline, settings: OmplSettings
) -> FloatArray:
    """Link headings of poses at the goal that touch nothing, shape (m ≥ 1, links) [rad].

    Raises:
        MotionNotFound: none was drawn within its share of the time.
    """
    if ends.goal_headings is not None:
        return ends.goal_headings[None]

    rng = np.random.default_rng(problem.planner.seed)
    check = SampledCheck.of(problem.arm, problem.workspace, settings.draws.sampling)
    drawn = GoalDraws(_any_shape(problem, ends, settings), ends.goal, check, settings.draws.goals).poses(rng)
    until = Deadline.after(settings.goal_share * problem.planner.time_limit)
    found: list[FloatArray] = []
    while len(found) < settings.goal_poses and not until.passed() and not deadline.passed():
        found += [pose for pose in next(drawn) if stands_free(certificate, pose)]
    if not found:
        reason = "no pose with the tip at the goal that touches nothing was drawn"
        raise MotionNotFound(Diagnosis(reason, "goal", ("raise planner.time_limit", "use planner.method nlp")))
    return np.array(found[: settings.goal_poses])


def stands_free(certificate: Certificate, headings: FloatArray) -> bool:
    """Whether a pose touches nothing, link headings (links,) [rad]."""
    return len(certificate.failures(np.stack((headings, headings)), depth=0)) == 0


def _any_shape(problem: Problem, ends: Ends, settings: OmplSettings) -> TargetDraws:
    """Draws of every shape that the joints allow; a base that is clamped stays where it is."""
    arm = problem.arm
    free = np.eye(arm.links)
    if ends.clamped:
        free[0, 0] = 0.0
    first = float(arm.bends(ends.start)[0])
    bound = float(arm.bend_limits[0])
    # As far as the base may turn at all: other planners are held to what winds the arm least.
    base = (first, first) if ends.clamped else (-bound, bound)
    return TargetDraws(arm, free, (ends.start, ends.start), arm.bend_limits, base, settings.draws)


class OmplSpace:
    """Bends of an arm as a state space of OMPL.

    Args:
        base: the module ``ompl.base``.
        certificate: of poses and motions.
        start: bends at the start, shape (links,) [rad]; bounds hold them in any case.
        clamped: whether the base cannot turn.
    """

    def __init__(self, base: Any, certificate: Certificate, start: FloatArray, *, clamped: bool) -> None:
        self._arm = certificate.arm
        bounds = base.RealVectorBounds(self._arm.links)
        reach = np.maximum(self._arm.bend_limits, np.abs(start))
        low = -reach
        high = reach.copy()
        if clamped:
            low[0] = start[0]
            high[0] = start[0]
        for joint in range(self._arm.links):
            bounds.setLow(joint, float(low[joint]))
            bounds.setHigh(joint, float(high[joint]))
        space = base.RealVectorStateSpace(self._arm.links)
        space.setBounds(bounds)
        self.information = base.SpaceInformation(space)
        self.information.setStateValidityChecker(_validity(self._arm, certificate))
        self.information.setMotionValidator(_motions(base, self.information, self._arm, certificate))
        self.information.setup()

    def state(self, bends: FloatArray) -> Any:
        """A state of OMPL from bends, shape (links,) [rad]."""
        state = self.information.allocState()
        for joint, bend in enumerate(bends):
            state[joint] = float(bend)
        return state

    def bends(self, state: Any) -> FloatArray:
        """Bends of a state, shape (links,) [rad]."""
        return _bends(self._arm, state)


def _bends(arm: Arm, state: Any) -> FloatArray:
    return np.array([state[joint] for joint in range(arm.links)])


def _validity(arm: Arm, certificate: Certificate) -> Any:
    """Whether a pose touches nothing; bends within the bounds are OMPL's own business."""
    return lambda state: stands_free(certificate, arm.headings(_bends(arm, state)))


def _motions(base: Any, information: Any, arm: Arm, certificate: Certificate) -> Any:
    """OMPL's interface for motions between two states; the class is made here, for OMPL may not be installed."""

    class CertifiedMotions(base.MotionValidator):  # type: ignore[misc]
        """Motions that the certificate proves free of contact."""

        def checkMotion(self, one: Any, other: Any) -> bool:  # noqa: N802 - OMPL's name
            """Whether the straight motion from a state to another touches nothing."""
            pair = np.stack((arm.headings(_bends(arm, one)), arm.headings(_bends(arm, other))))
            return len(certificate.failures(pair)) == 0

    return CertifiedMotions(information)


NAME = "RRT-Connect of OMPL"
"""Of what finds the motion, in records."""


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
            ProblemError: the arm has a feed axis, which this planner does not know.
            NoPlanFound: none was found in time.
        """
        if problem.arm.base_axes:
            raise ProblemError("the method ompl moves no feed axis; use planner.method nlp, or leave arm.feed out")
        with in_own_units(problem) as units:
            path = self._path(units.scaled(problem))
        return units.path_in_metres(path, problem.arm)

    def _path(self, problem: Problem) -> JointPath:
        """Plan in units of the arm."""
        deadline = Deadline.after(self.settings.planning_share * problem.planner.time_limit)
        ends = resolve_ends(problem)
        certificate = _certificate(problem, ends, self.settings.searched_gap)
        goals = poses_at_goal(problem, ends, certificate, deadline, self.settings)
        way = self._way(problem, ends, certificate, goals, deadline)
        return self._smooth_path(problem, _certificate(problem, ends, self.settings.certified_gap), way)

    def _way(
        self, problem: Problem, ends: Ends, certificate: Certificate, goals: FloatArray, deadline: Deadline
    ) -> FloatArray:
        """Link headings of a certified way, shape (K ≥ 2, links) [rad], the ends exact."""
        base, geometric, util = ompl_modules()
        util.noOutputHandler()
        # OMPL's generators take their seeds from this one when they are made; 0 is none.
        util.RNG.setSeed(problem.planner.seed + 1)
        arm = problem.arm
        space = OmplSpace(base, certificate, arm.bends(ends.start), clamped=ends.clamped)
        asked = base.ProblemDefinition(space.information)
        asked.addStartState(space.state(arm.bends(ends.start)))
        there = base.GoalStates(space.information)
        for goal in goals:
            there.addState(space.state(arm.bends(goal)))
        asked.setGoal(there)

        planner = geometric.RRTConnect(space.information)
        planner.setProblemDefinition(asked)
        planner.setup()
        until = Deadline.after(deadline.left - self.settings.simplifying_share * problem.planner.time_limit)
        planner.solve(base.PlannerTerminationCondition(until.passed))
        if not asked.hasExactSolution():
            raise TimeLimitReached(_out_of_time(until, len(goals)))
        path = asked.getSolutionPath()
        shortening = base.PlannerTerminationCondition(deadline.passed)
        geometric.PathSimplifier(space.information).simplify(path, shortening)
        return arm.headings(np.array([space.bends(state) for state in path.getStates()]))

    def _smooth_path(self, problem: Problem, certificate: Certificate, way: FloatArray) -> JointPath:
        """The smooth, certified path along a way.

        Raises:
            MotionNotFound: no smooth path near it can be certified.
        """
        arm = problem.arm
        legs = dense(way, self.settings.longest_turn)
        spline = certified_spline(legs, certificate, self.settings.smooth)
        if spline is None:
            reason = "the motion leaves no room for a smooth path"
            raise MotionNotFound(Diagnosis(reason, "motion", room_advice(arm.radius, problem.workspace.clearance)))
        curves = tuple(nearest_curve(arm, pose) for pose in legs)
        spare = spare_kept(spline, certificate, self.settings.smooth)
        return JointPath(BSpline(spline.t, arm.bends(spline.c), spline.k), arm.bends(legs), curves, NAME, spare=spare)


def _certificate(problem: Problem, ends: Ends, gap: float) -> Certificate:
    """With a gap, as a share of the arm's length, where both ends have it; ends that touch something must be let go."""
    with_gap = Certificate(problem.arm, problem.workspace, gap * problem.arm.length)
    known = [pose for pose in (ends.start, ends.goal_headings) if pose is not None]
    free = all(stands_free(with_gap, pose) for pose in known)
    return with_gap if free else Certificate(problem.arm, problem.workspace)


def _out_of_time(deadline: Deadline, goals: int) -> Diagnosis:
    reason = f"{deadline.what_passed()} before {NAME} had a way; poses at the goal: {goals}"
    return Diagnosis(reason, "motion", ("raise planner.time_limit", "use planner.method nlp"), {"goal_poses": goals})


def ompl_modules() -> tuple[Any, Any, Any]:
    """OMPL's modules ``base``, ``geometric`` and ``util``.

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
