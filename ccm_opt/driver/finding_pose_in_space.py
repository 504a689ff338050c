"""The static question in space: the best pose of the arm at the goal, whatever motion would lead to it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.length_words import short_length
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.driver.user_terms import compiled_terms
from ccm_opt.errors import ConfigurationNotFound, Diagnosis, ProblemError
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.space_goal_pose import SpaceGoalPoses
from ccm_opt.ik.space_pose_solver import SpaceArmPose
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.pose_beginnings import DEFAULT_POSE_SEARCH, PoseBeginning, PoseBeginnings, PoseSearchSettings
from ccm_opt.planning.space_ending import pose_record
from ccm_opt.planning.space_ends import GapsAtSamples, refuse_goal
from ccm_opt.planning.space_settings import SpaceMotionSettings
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.problem import TipGoal
from ccm_opt.problem.space_problem import SpaceProblem
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.solution import PoseOutcome
from ccm_opt.solution.space_solution import SpaceStaticPose


@dataclass(frozen=True, eq=False)
class _PoseTry:
    """What came of one beginning.

    Attributes:
        beginning: where it began.
        pose: the best feasible one, or else the last.
        feasible: whether it is one.
    """

    beginning: PoseBeginning
    pose: SpaceArmPose
    feasible: bool

    @property
    def reason(self) -> str:
        """Why there is no pose; empty where there is one."""
        if self.feasible:
            return ""
        worst = [_row_words(name, by) for name, by in list(self.pose.answer.broken.items())[:3]]
        if not worst:
            return f"the program ends with {self.pose.answer.status}, and the pose touches something"
        return f"it does not keep {', '.join(worst)}"

    @property
    def outcome(self) -> PoseOutcome:
        """The same as a record."""
        if not self.feasible:
            return PoseOutcome(self.beginning.name, reason=self.reason)
        return PoseOutcome(self.beginning.name, self.pose.answer.cost, self.pose.gap)


def find_pose_in_space(
    problem: SpaceProblem,
    *,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    progress: Callable[[Progress], None] | None = None,
    search: PoseSearchSettings = DEFAULT_POSE_SEARCH,
) -> SpaceStaticPose:
    """Find the best pose at the goal of a problem in space; see ``find_pose``.

    Args:
        problem: with a goal for the tip; the base may be on a feed axis.
        constraints: of the user; those that cover the goal are rows of the NLP.
        costs: of the user; those that cover the goal are terms of its objective.
        progress: told when a stage starts, and when the search begins with another candidate.
        search: from how many beginnings.

    Raises:
        ProblemError: the goal is for the whole arm.
        NoPlanFound: no pose was found.
    """
    if not isinstance(problem.goal, TipGoal):
        raise ProblemError("the goal is for the whole arm, so there is no pose to find; give goal.position instead")
    stages = Stages(progress, problem.planner.time_limit)
    terms = compiled_terms(problem.arm, constraints, costs)
    deadline = Deadline.after(problem.planner.time_limit)
    with stages("necessary checks"):
        tree = SurfaceTree.of(problem.workspace.soup)
        task = space_task(problem, tree, deadline, SpaceMotionSettings())
        if task.goal is not None:
            refuse_goal(problem, task, task.goal)
    # Of all poses that which is nearest to the start is the best, all else being equal.
    asked = SpaceGoalPoses(problem, tree, near=task.start, terms=terms)
    with stages("configuration"):
        tries = _tries(asked, task, search)
    best = tries[0]
    return SpaceStaticPose(
        problem=problem,
        pose=pose_record(asked.wanted_gap, best.pose, len(tries)),
        curve=best.pose.curve,
        nearest=_nearest(problem, best.pose),
        residuals=_residuals(terms, best.pose),
        outcomes=tuple(each.outcome for each in tries),
        timings=dict(stages.timings),
    )


def _tries(asked: SpaceGoalPoses, task: SpaceTask, search: PoseSearchSettings) -> list[_PoseTry]:
    """What comes of every beginning, the best first.

    Raises:
        ConfigurationNotFound: no beginning leads to a feasible pose.
    """
    beginnings = PoseBeginnings(task, search)
    tries: list[_PoseTry] = []
    for beginning in beginnings:
        poses = asked.improved(beginning.q, task.deadline)
        feasible = [pose for pose in poses if asked.feasible(pose)]
        best = min(feasible, key=lambda pose: pose.answer.cost, default=poses[-1])
        tries.append(_PoseTry(beginning, best, bool(feasible)))
        if task.deadline.passed() and any(each.feasible for each in tries):
            break
    tries.sort(key=lambda each: each.pose.answer.cost if each.feasible else np.inf)
    if not tries or not tries[0].feasible:
        raise _no_pose(tries, beginnings)
    return tries


def _no_pose(tries: Sequence[_PoseTry], beginnings: PoseBeginnings) -> ConfigurationNotFound:
    """Why no pose was found; that there is none is not proved."""
    failure = beginnings.failure
    advice: tuple[str, ...] = ("raise planner.time_limit", "raise arm.joint_limit_deg", "leave goal.direction out")
    evidence: dict[str, object] = {"tried": [f"{each.beginning.name}: {each.reason}" for each in tries]}
    if tries:
        first = tries[0]
        reason = f"no pose was found at the goal from {len(tries)} beginnings; {first.beginning.name}: {first.reason}"
        return ConfigurationNotFound(Diagnosis(reason, "configuration", advice, evidence))
    reason = "no pose was found at the goal that touches nothing: none of those that were drawn is free"
    if failure is not None:
        reason += f", and no motion leads there: {failure.diagnosis.reason}"
        evidence |= failure.diagnosis.evidence
        advice = (*failure.diagnosis.advice, *(each for each in advice if each not in failure.diagnosis.advice))
    return ConfigurationNotFound(Diagnosis(reason, "configuration", advice, evidence))


def _row_words(name: str, by: float) -> str:
    """A row that is broken, in the user's terms where it is the user's."""
    what, _, rest = name.partition(": ")
    return f"constraint '{rest}' by {by:.4g}" if what == "user" else f"{name} ({by:.2g})"


def _nearest(problem: SpaceProblem, pose: SpaceArmPose) -> str:
    """What is nearest to what in a pose, in words; empty where nothing is near."""
    gaps = GapsAtSamples.of(problem, problem.arm.joint_positions_at(pose.q)[None])
    clearance = problem.workspace.clearance
    to_walls = float(gaps.walls.gap[0]) - clearance
    to_itself = float(gaps.itself.gap[0])
    near = gaps.walls if to_walls <= to_itself else gaps.itself
    if not near.link[0]:
        return ""
    return f"link {near.link[0]} and {gaps.other(near, 0)}, {short_length(min(to_walls, to_itself))}"


def _residuals(terms: UserTerms | None, pose: SpaceArmPose) -> dict[str, float]:
    return {} if terms is None else terms.residuals_at_goal(pose.q)
