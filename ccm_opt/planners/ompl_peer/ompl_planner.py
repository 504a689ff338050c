"""A planner that asks OMPL: RRT-Connect (Kuffner and LaValle, 2000) with OMPL's defaults, its way shortened by OMPL.

What is compared is the search. The arm, its limits, poses at the goal, the proof that a motion touches nothing, the
smooth path, timing and verification are those of our planners.
"""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.collision.certificate import Certificate
from ccm_opt.collision.room_advice import room_advice
from ccm_opt.errors import Diagnosis, MotionNotFound, ProblemError, TimeLimitReached
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.motion.connect.shortcuts import dense
from ccm_opt.motion.ends import Ends, resolve_ends
from ccm_opt.motion.nearest_curves import nearest_curve
from ccm_opt.motion.spline_path import certified_spline, spare_kept
from ccm_opt.planners.ompl_peer.ompl_settings import DEFAULT_OMPL, OmplSettings
from ccm_opt.planners.ompl_peer.ompl_space import OmplSpace
from ccm_opt.planners.ompl_peer.tip_goal_poses import poses_at_goal, stands_free
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath

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
            raise MotionNotFound(Diagnosis(reason, "motion", room_advice(arm, problem.workspace)))
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
