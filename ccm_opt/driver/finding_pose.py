"""Search for the best static pose at a goal, without regard to a motion that leads to this pose."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import words_in
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.diagnosis.explain import refuse_impossible
from ccm_opt.driver.arguments import (
    compiled_terms,
    expect_arguments,
    refuse_contradictions,
    refuse_without_effect,
)
from ccm_opt.driver.pose_failure import PoseTry, improved_poses, no_pose, own_row
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.driven_links import curve_near_links
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.pose_regions import JointRegions
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.ends import GapsAtSamples, clamped_arm, refuse_goal, resolve_ends
from ccm_opt.planning.goal_pose import for_arm, pose_record, poses_at_goal
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.planning.own_units import OwnUnits, planning_units
from ccm_opt.planning.plane_in_space import problem_in_space, told_in_plane
from ccm_opt.planning.pose_beginnings import PoseBeginning, in_plane, in_space
from ccm_opt.planning.space_task import space_task
from ccm_opt.planning.stand_in import own_configurations, stand_in
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import BindingSide, StaticPose

_LEANING = 1e-4
"""Maximum difference, as a fraction of the arm's length, between a joint's distance to a side of its region and the
clearance of the pose for which this side counts as active. Heuristic."""

_ROW = re.compile(r"link (\d+): side (\d+) of its region, at its (start|end)")
"""Pattern of the names of NLP constraints that keep one end of a link inside its convex region."""


def find_pose(
    problem: Problem,
    *,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    progress: Callable[[Progress], None] | None = None,
    settings: Settings | None = None,
) -> StaticPose:
    """Return the best pose of the arm at a problem's goal, found by a nonlinear program (NLP).

    The NLP is solved from sampled poses, in the plane also from a backbone curve along every route to the goal, in
    space also from the end of a motion to the goal.

    Of several goals in sequence, the last one applies. Whether a motion leads to the pose is not checked; ``solve``
    does that.

    Args:
        problem: problem with a goal for the tip.
        constraints: constraints of the user; those that apply at the goal become constraints of the NLP.
        costs: costs of the user; those that apply at the goal become terms of the objective.
        progress: function called when a stage starts, and when the search turns to another candidate.
        settings: settings of all stages of planning; None for the defaults.

    Returns:
        The collision-free pose of minimum cost, within the joint limits, with the tip at the goal.

    Raises:
        ProblemError: the goal is not one for the tip.
        NoPlanFound: no pose was found; the diagnosis states violated constraints, and whether it is proved that no pose
            exists.
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
        # In the plane no curve follows links that lead to the bodies beside an arm.
        beside = problem.dimension == 2 and bool(problem.arm.rigid_bodies)
        whole = stand_in(problem_in_space(problem) if beside else problem, weighed=True)
        if whole.dimension == problem.dimension == 2:
            with planning_units(whole) as units:
                found = _in_metres(_found(units.scaled(whole), terms, stages, numbers), units)
            return _of_the_arm(replace(found, problem=whole), problem)
        with told_in_plane() if problem.dimension == 2 else nullcontext():
            return _of_the_arm(_found(whole, terms, stages, numbers), problem)


def _in_metres(found: StaticPose, units: OwnUnits) -> StaticPose:
    """Return a static pose in the plane with its lengths converted from the arm's units."""
    metres = units.metres
    record = units.record_in_metres(found.pose)
    return replace(
        found,
        pose=record,
        curve=record.curve,
        binding=tuple(replace(each, place=tuple(metres * x for x in each.place)) for each in found.binding),
        outcomes=tuple(each if each.gap is None else replace(each, gap=metres * each.gap) for each in found.outcomes),
    )


def _of_the_arm(found: StaticPose, problem: Problem) -> StaticPose:
    """Return the static pose of a problem's arm that corresponds to one of the arm in its place, from ``stand_in``."""
    arm, whole = problem.arm, found.problem.arm
    q = own_configurations(found.configuration[None], arm, whole)[0]
    curve, binding = found.curve, found.binding
    if whole is not arm and arm.dimension == 2:
        curve = replace(nearest_curves(arm, q[None])[0], base=arm.joint_positions_at(q)[0])
    elif whole is not arm:
        curve = curve_near_links(arm, q)
    if whole.dimension > arm.dimension:
        binding = tuple(replace(each, place=each.place[::2], towards=each.towards[::2]) for each in binding)
    rows: dict[str, float] = {}
    for name, multiplier in found.pose.multipliers.items():
        rows.setdefault(own_row(name, whole), multiplier)
    return replace(
        found,
        problem=problem,
        pose=replace(found.pose, configuration=q, curve=curve, multipliers=rows),
        configuration=q,
        curve=curve,
        binding=tuple(replace(each, link=whole.link_number(each.link - 1)) for each in binding),
    )


def _refuse_other_questions(problem: Problem) -> None:
    """Raise an error for problems for which ``find_pose`` cannot search for a pose at the goal.

    Raises:
        ProblemError: the goal is not one for the tip.
    """
    if problem.goal.whole(problem.arm) is not None:
        raise ProblemError(
            "the goal gives the pose of the whole arm, so there is none to find; give goal.position instead"
        )
    if problem.goal.path is not None:
        raise ProblemError("goal.path determines the pose at the goal; give goal.position instead")
    if problem.goal.look_at is not None:
        raise ProblemError("the search for a pose does not support goal.look_at; give goal.position instead")
    if problem.coverage is not None:
        raise ProblemError("the search for a pose does not support goal.see; give goal.position instead")


def _found(problem: Problem, terms: UserTerms | None, stages: Stages, settings: Settings) -> StaticPose:
    """Return the best static pose found from any initial pose, by the nonlinear program.

    Raises:
        NoPlanFound: no pose was found.
    """
    deadline = Deadline.after(problem.planner.time_limit)
    with stages("necessary checks"):
        goal_poses, beginnings = (_in_plane if problem.dimension == 2 else _in_space)(
            problem, terms, settings, deadline
        )
    goal_poses = replace(goal_poses, settings=replace(goal_poses.settings, rounds=settings.poses.rounds))
    with stages("configuration"):
        tries: list[PoseTry] = []
        for beginning in beginnings:
            tries.append(improved_poses(goal_poses, beginning, deadline))
            if deadline.passed() and any(each.best is not None for each in tries):
                break
        tries.sort(key=lambda each: each.cost)
        if not tries or tries[0].best is None:
            raise no_pose(goal_poses, tries)
    best = tries[0]
    pose = best.poses[best.best or 0]
    return StaticPose(
        problem=problem,
        pose=pose_record(goal_poses.wanted_gap, pose, len(tries)),
        configuration=pose.q,
        curve=pose.curve,
        nearest=GapsAtSamples.nearest_words(problem, pose.q),
        binding=tuple(binding_sides(goal_poses, pose, best.begun(best.best or 0))),
        residuals={} if terms is None else terms.residuals_at_goal(pose.q),
        outcomes=tuple(each.outcome for each in tries),
        timings=dict(stages.timings),
    )


_Question = tuple[GoalPoses, Iterator[PoseBeginning]]
"""The nonlinear program (NLP) for poses at the goal, and the initial poses from which it is solved."""


def _in_plane(problem: Problem, terms: UserTerms | None, settings: Settings, _: Deadline) -> _Question:
    ends = resolve_ends(problem)
    problem = for_arm(problem, clamped_arm(problem.arm) if ends.clamped else problem.arm)
    goal_poses = poses_at_goal(problem, ends, ends.start, terms, settings.curve.goal_pose)
    return goal_poses, in_plane(problem, ends, settings.poses, settings.curve)


def _in_space(problem: Problem, terms: UserTerms | None, settings: Settings, deadline: Deadline) -> _Question:
    tree = problem.workspace.surface_tree
    task = space_task(problem, tree, deadline, settings.space)
    if task.goal_pose is None:
        refuse_goal(problem, task, task.goal)
    # All else being equal, the pose nearest to the start is the best.
    return GoalPoses(problem, tree, near=task.start, terms=terms, room=task.goal.room), in_space(task, settings.poses)


def binding_sides(goal_poses: GoalPoses, pose: ArmPose, start: FloatArray) -> Iterator[BindingSide]:
    """Yield the sides of convex regions that are active constraints of an optimised pose, largest multiplier first.

    Args:
        goal_poses: the nonlinear program (NLP) for the pose.
        pose: a solution of the NLP.
        start: configuration around which the convex regions were built, with c coordinates, shape (c,) [rad, m].
    """
    points = goal_poses.problem.arm.joint_positions_at(pose.q)
    region_sets = [goal_poses.regions(start, settings) for settings in goal_poses.settings.widening]
    allowed = _LEANING * goal_poses.problem.arm.length
    for name, multiplier in pose.answer.multipliers.items():
        row = _ROW.fullmatch(name)
        if row is None:
            continue
        link = int(row[1])
        joint = link if row[3] == "end" else link - 1
        normal = _normal(region_sets, joint, int(row[2]) - 1, points[joint], pose.gap, allowed)
        if normal is not None:
            yield BindingSide(link, tuple(points[joint].tolist()), tuple(normal.tolist()), multiplier)


def _normal(
    region_sets: list[JointRegions], joint: int, side: int, place: FloatArray, gap: float, allowed: float
) -> FloatArray | None:
    """Return the outward unit normal of the region side whose distance to a joint equals the pose's clearance.

    Args:
        region_sets: convex regions around the joints, one set for each step of the search that widens them.
        joint: index of the joint.
        side: index of the side among those of the joint's region.
        place: position of the joint, shape (d,) with d = 2 or 3.
        gap: clearance of the pose [m].
        allowed: maximum difference between the distance of joint and side and the clearance [m].

    Returns:
        The normal, shape (d,); None if no region has such a side.
    """
    for regions in region_sets:
        for each in np.flatnonzero((regions.joint == joint) & (regions.number == side)):
            inwards = regions.normals[each]
            if abs(float(inwards @ place - regions.offsets[each]) - gap) <= allowed:
                return np.asarray(-inwards)
    return None
