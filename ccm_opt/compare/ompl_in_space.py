"""RRT-Connect of OMPL for arms in space (extra ``ompl``), over our distances and under our certificate: a peer.

What is compared is the search. The pose at the goal, the proof that a motion touches nothing, the smooth path, timing
and verification are those of our planner. The sampler plans in the joints, as samplers do.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ccm_opt.compare.ompl_peer import DEFAULT_OMPL, NAME, OmplSettings, ompl_modules
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.errors import Diagnosis, MotionNotFound, NoPlanFound, ProblemError, TimeLimitReached
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.space_certificate import SpaceCertificate
from ccm_opt.planning.space_ends import refuse_ends
from ccm_opt.planning.space_goal_poses import goal_poses
from ccm_opt.planning.space_search import find_motion
from ccm_opt.planning.space_settings import SpaceMotionSettings
from ccm_opt.planning.space_smooth_path import certified_spline
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.problem import TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.solution import JointPath


@dataclass(frozen=True)
class FedJoints:
    """What a sampler draws for an arm, and the configurations that this stands for.

    A guide tube holds joints straight, and a sampler never draws that a number is zero. So every bend counts by how far
    its joint has come out of the tube: not at all inside, in full a link beyond. Without a feed axis what is drawn are
    the bends themselves. The feed is counted in twenty-fourths of the arm.

    Attributes:
        arm: the arm.
        longest_turn: by which a bend may change from one configuration to the next [rad].
        beyond_tube: how far behind the tube joints begin to bend, in link lengths.
    """

    arm: Arm
    longest_turn: float
    beyond_tube: float = 0.0

    @property
    def low(self) -> FloatArray:
        """Least value of everything drawn, shape (c,)."""
        return self.arm.lower_limits / self._units

    @property
    def high(self) -> FloatArray:
        """Greatest value of everything drawn, shape (c,)."""
        return self.arm.upper_limits / self._units

    def configuration(self, drawn: FloatArray) -> FloatArray:
        """What draws stand for, shape (..., c) [rad, m]."""
        q = drawn * self._units
        bends = slice(0, 2 * self.arm.links)
        q[..., bends] *= self._out(q)
        return q

    def drawn(self, q: FloatArray) -> FloatArray | None:
        """What stands for a configuration, shape (c,); None where that is beyond the limits."""
        out = np.append(self._out(q), np.ones(len(self.arm.base_axes)))
        drawn = np.where(out > 0.0, q / np.where(out > 0.0, out, 1.0), 0.0) / self._units
        slack = 1e-9
        fits = np.all(drawn >= self.low - slack) and np.all(drawn <= self.high + slack)
        return np.clip(drawn, self.low, self.high) if fits and np.allclose(self.configuration(drawn), q) else None

    def keyframes(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Configurations along a straight line between draws, shape (k ≥ 2, c) [rad, m]."""
        bends = slice(0, 2 * self.arm.links)
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
        return np.append(np.ones(2 * self.arm.links), of_axes)

    @property
    def _leaving(self) -> FloatArray:
        """Feed from which on each joint may bend, a little beyond the tube, shape (links,) [m].

        A smooth path begins to bend it somewhat earlier than the way does.
        """
        beyond = self.beyond_tube * self.arm.link_length
        return np.asarray(self.arm.hole + beyond - self.arm.link_length * np.arange(self.arm.links), dtype=np.float64)

    def _out(self, q: FloatArray) -> FloatArray:
        """How far each bend counts, from 0 to 1, shape (..., 2 links)."""
        if not self.arm.base_axes:
            return np.ones(2 * self.arm.links)
        beyond = (self.arm.coordinates.advance(q)[..., None] - self._leaving) / self.arm.link_length
        return np.asarray(np.repeat(np.clip(beyond, 0.0, 1.0), 2, axis=-1), dtype=np.float64)


@dataclass(frozen=True)
class SpaceOmplPlanner:
    """Plans with OMPL.

    Attributes:
        settings: shares of the time.
        motion: numbers of goal poses, certificate and smooth path.
    """

    settings: OmplSettings = DEFAULT_OMPL
    motion: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)

    def plan(self, problem: SpaceProblem) -> JointPath:
        """Plan a certified motion.

        Raises:
            ProblemError: the goal asks for places on the way, which this planner does not know; or OMPL is missing.
            NoPlanFound: none was found in time.
        """
        tree = SurfaceTree.of(problem.workspace.soup)
        limit = problem.planner.time_limit
        joints = FedJoints(problem.arm, self.settings.longest_turn, self.settings.beyond_tube)
        given = self._given_goals(problem, tree, joints)
        task = space_task(problem, tree, Deadline.after(self.settings.planning_share * limit), self.motion)
        if task.via:
            raise ProblemError("the method ompl knows no places on the way; leave goal.via out, or use nlp")
        refuse_ends(problem, task)
        goals = given or self._goals(problem, tree, joints, Deadline.after(self.settings.goal_share * limit))
        way = self._way(problem, task, joints, goals)
        legs = [joints.keyframes(before, after)[1:] for before, after in pairwise(way)]
        keyframes = np.concatenate((task.start[None], *legs))
        spline = certified_spline(task, keyframes)
        if spline is None:
            raise MotionNotFound(Diagnosis("the motion leaves no room for a smooth path", "motion"))
        return JointPath(spline, keyframes, (), NAME, spare=task.certificate.pair_gap)

    def _given_goals(self, problem: SpaceProblem, tree: SurfaceTree, joints: FedJoints) -> list[FloatArray]:
        """Where our own search ends, which the sampler gets for nothing of its time; none where that finds nothing.

        In ducts hardly any pose that is drawn at a goal touches nothing, and a sampler without a goal can only fail.
        """
        if not isinstance(problem.goal, TipGoal) or problem.goal.via:
            return []
        until = Deadline.after(self.settings.goal_share * problem.planner.time_limit)
        try:
            found = find_motion(space_task(problem, tree, until, self.motion))
        except NoPlanFound:
            return []
        drawn = joints.drawn(found.configurations[-1])
        return [] if drawn is None else [drawn]

    def _goals(self, problem: SpaceProblem, tree: SurfaceTree, joints: FedJoints, until: Deadline) -> list[FloatArray]:
        """Draws that stand for poses at the goal."""
        task = space_task(problem, tree, until, self.motion)
        if task.goal_pose is not None:
            poses = iter((task.goal_pose,))
        else:
            curve, _ = CurveMap.through(task.arm, task.start)
            rng = np.random.default_rng(problem.planner.seed)
            poses = (pose.q for pose in goal_poses(task, task.stepper(curve), rng))
        found: list[FloatArray] = []
        for q in poses:
            drawn = joints.drawn(q)
            if drawn is not None:
                found.append(drawn)
            if len(found) == self.settings.goal_poses:
                break
        if not found:
            reason = "no pose with the tip at the goal that touches nothing was drawn"
            raise MotionNotFound(Diagnosis(reason, "goal", ("raise planner.time_limit", "use planner.method nlp")))
        return found

    def _way(self, problem: SpaceProblem, task: SpaceTask, joints: FedJoints, goals: list[FloatArray]) -> FloatArray:
        """Draws along a certified way, shape (K ≥ 2, c)."""
        base, geometric, util = ompl_modules()
        util.noOutputHandler()
        # OMPL's generators take their seeds from this one when they are made; 0 is none.
        util.RNG.setSeed(problem.planner.seed + 1)
        # The smooth path leaves the way at its corners, and needs some gap for that.
        beyond = self.settings.searched_gap * problem.arm.length
        certificate = replace(
            task.certificate, gap=task.certificate.gap + beyond, pair_gap=task.certificate.pair_gap + beyond
        )
        information = _information(base, certificate, joints)
        start = joints.drawn(task.start)
        if start is None:
            raise ProblemError("the start bends joints that are hardly out of the guide tube; the method ompl cannot")
        asked = base.ProblemDefinition(information)
        asked.addStartState(_state(information, start))
        there = base.GoalStates(information)
        for goal in goals:
            there.addState(_state(information, goal))
        asked.setGoal(there)
        planner = geometric.RRTConnect(information)
        planner.setProblemDefinition(asked)
        planner.setup()
        until = Deadline.after(task.deadline.left - self.settings.simplifying_share * problem.planner.time_limit)
        planner.solve(base.PlannerTerminationCondition(until.passed))
        if not asked.hasExactSolution():
            reason = f"{until.what_passed()} before {NAME} had a way; poses at the goal: {len(goals)}"
            raise TimeLimitReached(Diagnosis(reason, "motion", ("raise planner.time_limit", "use planner.method nlp")))
        path = asked.getSolutionPath()
        shortening = base.PlannerTerminationCondition(task.deadline.passed)
        geometric.PathSimplifier(information).simplify(path, shortening)
        return np.array([_drawn(state, len(start)) for state in path.getStates()])


def _information(base: Any, certificate: SpaceCertificate, joints: FedJoints) -> Any:
    """The space that OMPL plans in, with the certificate as judge of states and motions."""
    low = joints.low
    high = joints.high
    bounds = base.RealVectorBounds(len(low))
    for k in range(len(low)):
        bounds.setLow(k, float(low[k]))
        bounds.setHigh(k, float(high[k]))
    space = base.RealVectorStateSpace(len(low))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    count = len(low)

    def stands_free(state: Any) -> bool:
        q = joints.configuration(_drawn(state, count))
        return certificate.safe(q, q, depth=0)

    class CertifiedSpaceMotions(base.MotionValidator):  # type: ignore[misc]
        """Motions that the certificate proves free of contact."""

        def checkMotion(self, one: Any, other: Any) -> bool:  # noqa: N802 - OMPL's name
            """Whether the straight motion from a state to another touches nothing."""
            keyframes = joints.keyframes(_drawn(one, count), _drawn(other, count))
            return all(certificate.safe(before, after) for before, after in pairwise(keyframes))

    information.setStateValidityChecker(stands_free)
    information.setMotionValidator(CertifiedSpaceMotions(information))
    information.setup()
    return information


def _state(information: Any, drawn: FloatArray) -> Any:
    """A state of OMPL from draws, shape (c,)."""
    state = information.allocState()
    for k, value in enumerate(drawn):
        state[k] = float(value)
    return state


def _drawn(state: Any, count: int) -> FloatArray:
    return np.array([state[k] for k in range(count)])
