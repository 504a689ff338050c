"""Finds the best pose at a goal, whatever motion would lead to it."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import ConfigurationNotFound, Diagnosis, NoPlanFound, ProblemError
from ccm_opt.core.length_words import short_length, words_for_unit, words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import refuse_impossible
from ccm_opt.driver.arguments import compiled_terms, expect_arguments, refuse_contradictions, refuse_without_effect
from ccm_opt.driver.pose_failure import failure_words, no_pose
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.ik.pose_task import JointRegions
from ccm_opt.ik.poses_among_surfaces import PosesAmongSurfaces
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.ending import pose_record as pose_record_in_space
from ccm_opt.planning.ends import GapsAtSamples, refuse_goal
from ccm_opt.planning.goal_members import pose_record
from ccm_opt.planning.goal_pose import GoalPoseSearch
from ccm_opt.planning.joint_regions import joint_regions
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.planning.pose_beginnings import PoseBeginning, PoseBeginnings, PoseSearchSettings
from ccm_opt.planning.pose_over_routes import PoseTry, brought_tries, drawn_tries, pose_search, pose_tries
from ccm_opt.planning.space_task import SpaceTask, space_task
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import BindingSide, PoseOutcome, StaticPose
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_LEANING = 1e-4
"""By how much the room to a side may differ from the gap of a pose that leans on it (taste)."""

_ROW = re.compile(r"link (\d+): side (\d+) of its region, at its (start|end)")
"""What ``region_rows`` calls its rows."""


def binding_sides(search: GoalPoseSearch, pose: ArmPose, start: FloatArray) -> tuple[BindingSide, ...]:
    """The sides that a pose leans on, the largest multiplier first.

    Args:
        search: that found the pose.
        pose: a solution of the NLP.
        start: link headings about which its regions were drawn, shape (links,) [rad].
    """
    arm = search.problem.arm
    points = arm.joint_positions(pose.headings)
    drawn = [joint_regions(arm, search.problem.workspace, start, settings) for settings in search.settings.widening]
    sides = []
    for name, multiplier in pose.answer.multipliers.items():
        row = _ROW.fullmatch(name)
        if row is None:
            continue
        link = int(row[1])
        joint = link if row[3] == "end" else link - 1
        place = points[joint]
        normal = _normal(drawn, joint, int(row[2]) - 1, place, pose.gap, search)
        if normal is not None:
            sides.append(BindingSide(link, _pair(place), _pair(normal), multiplier))
    return tuple(sides)


def _normal(
    drawn: list[JointRegions], joint: int, side: int, place: FloatArray, gap: float, search: GoalPoseSearch
) -> FloatArray | None:
    """The side's outward normal, shape (2,), in the regions by which the place has just the gap to it; None in none."""
    allowed = _LEANING * search.problem.arm.length
    for regions in drawn:
        for each in np.flatnonzero((regions.joint == joint) & (regions.number == side)):
            inwards = regions.normals[each]
            if abs(float(inwards @ place - regions.offsets[each]) - gap) <= allowed:
                return np.asarray(-inwards)
    return None


def _pair(vector: FloatArray) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])


def find_pose(
    problem: Problem,
    *,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    progress: Callable[[Progress], None] | None = None,
    settings: Settings | None = None,
) -> StaticPose:
    """Find the best pose of the arm at a problem's goal, by the goal-pose NLP from every route to it.

    In space it is asked from where a motion ends that leads there, and from drawn poses.

    Of goals in sequence it is the last. Whether a motion leads to the pose is not asked: ``solve`` does that.

    Args:
        problem: with a goal for the tip; in the plane with an arm whose base stands still.
        constraints: of the user; those that cover the goal are rows of the NLP.
        costs: of the user; those that cover the goal are terms of its objective.
        progress: told when a stage starts, and when the search begins with another candidate.
        settings: numbers of the stages; the defaults when None.

    Returns:
        The pose of least cost, which touches nothing, within the joint limits, with the tip at the goal.

    Raises:
        ProblemError: the goal is for the whole arm, so that there is nothing to find, or the base moves.
        NoPlanFound: no pose was found; the diagnosis says what is missed, and whether that is proved.
    """
    Problem.expected(problem)
    refuse_without_effect(problem)
    expect_arguments(progress=progress, settings=settings)
    numbers = settings or DEFAULT_SETTINGS
    with on_one_thread(), words_in(problem.length_unit):
        stages = Stages(progress, problem.planner.time_limit)
        _refuse_other_questions(problem)
        terms = compiled_terms(problem.arm, constraints, costs)
        with stages("necessary checks"):
            refuse_contradictions(problem, terms)
            refuse_impossible(problem)
        if problem.dimension == 3:
            return _found_in_space(problem, terms, stages, numbers)
        return _found_in_plane(problem, terms, stages, numbers)


def _refuse_other_questions(problem: Problem) -> None:
    """Refuse problems that leave no pose at the goal to be found.

    Raises:
        ProblemError: saying why.
    """
    if problem.goal.whole(problem.arm) is not None:
        raise ProblemError("the goal is for the whole arm, so there is no pose to find; give goal.position instead")
    if problem.arm.base_axes and problem.dimension == 2:
        raise ProblemError(
            "the base is on a feed axis; in the plane the question is answered for a base that stands still"
        )


def _found_in_plane(problem: Problem, terms: UserTerms | None, stages: Stages, numbers: Settings) -> StaticPose:
    """The best pose in the plane, asked from every route to the goal."""
    units = OwnUnits(problem.arm.length)
    try:
        with words_for_unit(units.metres):
            answer = _found(units, units.scaled(problem), terms, stages, numbers)
    except NoPlanFound as failure:
        raise type(failure)(units.diagnosis_in_metres(failure.diagnosis)) from failure
    return replace(
        answer,
        problem=problem,
        binding=tuple(replace(side, place=_times(side.place, units.metres)) for side in answer.binding),
        outcomes=tuple(_outcome_in_metres(each, units) for each in answer.outcomes),
    )


def _outcome_in_metres(outcome: PoseOutcome, units: OwnUnits) -> PoseOutcome:
    return outcome if outcome.gap is None else replace(outcome, gap=units.metres * outcome.gap)


def _times(place: tuple[float, float], factor: float) -> tuple[float, float]:
    return factor * place[0], factor * place[1]


def _found(
    units: OwnUnits, problem: Problem, terms: UserTerms | None, stages: Stages, settings: Settings
) -> StaticPose:
    """The best pose of a problem in units of its arm, its record and curve in metres.

    Raises:
        NoPlanFound: no pose was found.
    """
    with stages("configuration"):
        search = pose_search(problem, terms, settings.curve)
        tries = list(pose_tries(search, settings.curve))
        tries = sorted((*tries, *drawn_tries(search, tries)), key=lambda each: each.cost)
        if all(each.best is None for each in tries):
            tries = sorted((*tries, *brought_tries(search, settings.curve)), key=lambda each: each.cost)
        if not tries or tries[0].best is None:
            raise no_pose(problem, tries, terms)
    return _answer(units, problem, tries, terms, stages)


def _answer(
    units: OwnUnits, problem: Problem, tries: Sequence[PoseTry], terms: UserTerms | None, stages: Stages
) -> StaticPose:
    """The pose of the first try, with all that is known of it."""
    first = tries[0]
    number = first.best or 0
    pose = first.poses[number]
    record = units.record_in_metres(pose_record(first.search, pose, len(tries)))
    return StaticPose(
        problem=problem,
        pose=record,
        configuration=problem.arm.bends(record.headings),
        curve=record.curve,
        nearest=first.search.nearest(pose.headings),
        binding=binding_sides(first.search, pose, first.starts[number]),
        residuals={} if terms is None else terms.residuals_at_goal(pose.q),
        outcomes=tuple(_outcome(each) for each in tries),
        timings=dict(stages.timings),
    )


def _outcome(each: PoseTry) -> PoseOutcome:
    if each.best is None:
        return PoseOutcome(each.start, reason=failure_words(each))
    pose = each.poses[each.best]
    return PoseOutcome(each.start, pose.answer.cost, pose.gap)


@dataclass(frozen=True, eq=False)
class _SpaceTry:
    """What came of one beginning.

    Attributes:
        beginning: where it began.
        pose: the best feasible one, or else the last.
        feasible: whether it is one.
    """

    beginning: PoseBeginning
    pose: ArmPose
    feasible: bool

    @property
    def reason(self) -> str:
        """Why there is no pose; empty where there is one."""
        if self.feasible:
            return ""
        worst = [_space_row_words(name, by) for name, by in list(self.pose.answer.broken.items())[:3]]
        if not worst:
            return f"the program ends with {self.pose.answer.status}, and the pose touches something"
        return f"it does not keep {', '.join(worst)}"

    @property
    def outcome(self) -> PoseOutcome:
        """The same as a record."""
        if not self.feasible:
            return PoseOutcome(self.beginning.name, reason=self.reason)
        return PoseOutcome(self.beginning.name, self.pose.answer.cost, self.pose.gap)


def _found_in_space(problem: Problem, terms: UserTerms | None, stages: Stages, numbers: Settings) -> StaticPose:
    """The best pose in space, asked from the end of a motion to the goal and from drawn poses."""
    deadline = Deadline.after(problem.planner.time_limit)
    with stages("necessary checks"):
        tree = SurfaceTree.of(problem.workspace.soup)
        task = space_task(problem, tree, deadline, numbers.space)
        if task.goal_pose is None:
            refuse_goal(problem, task, task.goal)
    # Of all poses that which is nearest to the start is the best, all else being equal.
    asked = PosesAmongSurfaces(problem, tree, near=task.start, terms=terms)
    with stages("configuration"):
        tries = _tries(asked, task, numbers.poses)
    best = tries[0]
    return StaticPose(
        problem=problem,
        pose=pose_record_in_space(asked.wanted_gap, best.pose, len(tries)),
        configuration=best.pose.q,
        curve=best.pose.curve,
        nearest=_nearest_in_space(problem, best.pose),
        residuals={} if terms is None else terms.residuals_at_goal(best.pose.q),
        outcomes=tuple(each.outcome for each in tries),
        timings=dict(stages.timings),
    )


def _tries(asked: PosesAmongSurfaces, task: SpaceTask, search: PoseSearchSettings) -> list[_SpaceTry]:
    """What comes of every beginning, the best first.

    Raises:
        ConfigurationNotFound: no beginning leads to a feasible pose.
    """
    beginnings = PoseBeginnings(task, search)
    tries: list[_SpaceTry] = []
    for beginning in beginnings:
        poses = asked.improved(beginning.q, task.deadline)
        feasible = [pose for pose in poses if asked.feasible(pose)]
        best = min(feasible, key=lambda pose: pose.answer.cost, default=poses[-1])
        tries.append(_SpaceTry(beginning, best, bool(feasible)))
        if task.deadline.passed() and any(each.feasible for each in tries):
            break
    tries.sort(key=lambda each: each.pose.answer.cost if each.feasible else np.inf)
    if not tries or not tries[0].feasible:
        raise _no_pose_in_space(tries, beginnings)
    return tries


def _no_pose_in_space(tries: Sequence[_SpaceTry], beginnings: PoseBeginnings) -> ConfigurationNotFound:
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


def _space_row_words(name: str, by: float) -> str:
    """A row that is broken, in the user's terms where it is the user's."""
    what, _, rest = name.partition(": ")
    return f"constraint '{rest}' by {by:.4g}" if what == "user" else f"{name} ({by:.2g})"


def _nearest_in_space(problem: Problem, pose: ArmPose) -> str:
    """What is nearest to what in a pose, in words; empty where nothing is near."""
    gaps = GapsAtSamples.of(problem, problem.arm.joint_positions_at(pose.q)[None])
    clearance = problem.workspace.clearance
    to_walls = float(gaps.walls.gap[0]) - clearance
    to_itself = float(gaps.itself.gap[0])
    near = gaps.walls if to_walls <= to_itself else gaps.itself
    if not near.link[0]:
        return ""
    return f"link {near.link[0]} and {gaps.other(near, 0)}, {short_length(min(to_walls, to_itself))}"
