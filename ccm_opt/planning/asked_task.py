"""The task of a motion in space as a problem asks for it, and the boxes within reach."""

from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.space_continuation import SpaceTipPose
from ccm_opt.planning.space_settings import SpaceMotionSettings
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.space_user_limit import SpaceUserLimit
from ccm_opt.problem.space_problem import SpaceJointPose, SpaceProblem, SpaceTipGoal
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.robot.space_arm import SpaceArm
from ccm_opt.scene.distances.surface_tree import SurfaceTree


def reach_box(arm: SpaceArm, bounds: FloatArray | None) -> FloatArray:
    """Corners of where any of the arm can be: within the arm's length of its base, and in the room, (2, 3) [m]."""
    low, high = arm.base_range
    return _box_about(arm, low, high, arm.length, bounds)


def tip_box(arm: SpaceArm, bounds: FloatArray | None) -> FloatArray:
    """Corners of where the tip can be, (2, 3) [m]; an arm is straight in its guide tube and turns about its end."""
    low, high = arm.base_range
    if not arm.base_axes:
        return reach_box(arm, bounds)
    first = max(low, arm.hole)
    return _box_about(arm, first, max(first, high), arm.length - max(first - high, 0.0), bounds)


def _box_about(arm: SpaceArm, low: float, high: float, reach: float, bounds: FloatArray | None) -> FloatArray:
    """Corners of what is within reach of a part of the line of the base, and in the room, (2, 3) [m]."""
    ends = arm.base + np.outer([low, high], arm.direction)
    box = np.stack((ends.min(axis=0) - reach, ends.max(axis=0) + reach))
    if bounds is None:
        return box
    return np.stack((np.maximum(box[0], bounds[0]), np.minimum(box[1], bounds[1])))


def space_task(
    problem: SpaceProblem,
    tree: SurfaceTree,
    deadline: Deadline,
    settings: SpaceMotionSettings,
    terms: UserTerms | None = None,
) -> SpaceTask:
    """What the search is asked for a problem.

    Args:
        problem: with one goal.
        tree: of its surfaces.
        deadline: when to stop.
        settings: numbers of the search.
        terms: the user's constraints and costs, or None.
    """
    arm = problem.arm
    goal = problem.goal
    return SpaceTask(
        arm=arm,
        tree=tree,
        start=problem.start.configuration(arm),
        goal=None if isinstance(goal, SpaceJointPose) else tip_pose(problem, goal),
        goal_pose=goal.configuration(arm) if isinstance(goal, SpaceJointPose) else None,
        via=() if isinstance(goal, SpaceJointPose) else goal.via,
        via_reach=problem.via_reach,
        clearance=problem.workspace.clearance,
        wanted_gap=problem.wanted_gap,
        box=tip_box(arm, problem.workspace.bounds),
        scene=problem.workspace.extent if len(problem.workspace.soup) else np.zeros((0, 3)),
        names=problem.workspace.soup.names,
        slowness=slowness(problem),
        deadline=deadline,
        seed=problem.planner.seed,
        settings=settings,
        user=None if terms is None else SpaceUserLimit.of(arm, terms, settings.schedule.lead),
    )


def coarse_problem(problem: SpaceProblem, few: SpaceTask) -> SpaceProblem:
    """The problem as the search for nominal links sees it; torques are left to the arm itself."""
    limits = problem.limits
    revolutes = 3 * few.arm.links
    return replace(
        problem,
        arm=few.arm,
        workspace=replace(problem.workspace, clearance=few.clearance),
        planner=replace(problem.planner, wanted_gap=few.wanted_gap),
        start=SpaceJointPose.from_configuration(few.start, few.arm.links),
        limits=replace(
            limits,
            velocity=limits.velocity[:revolutes],
            acceleration=limits.acceleration[:revolutes],
            torque=None,
            jerk=None,
        ),
    )


def tip_pose(problem: SpaceProblem, goal: SpaceTipGoal) -> SpaceTipPose:
    """The goal of the tip; half of the tolerances is left to what comes after planning."""
    tolerances = problem.tolerances
    return SpaceTipPose(goal.position, goal.direction, 0.5 * tolerances.position, 0.5 * tolerances.heading)


def slowness(problem: SpaceProblem) -> FloatArray:
    """How dear a unit of each coordinate is: the usual speed of a bend over that of the coordinate, shape (c,)."""
    arm = problem.arm
    speeds = problem.limits.of_coordinates(arm.coordinates).velocity
    usual = float(np.median(speeds[: 2 * arm.links]))
    # A feed without a limit counts as one that goes a nominal link while a joint bends by a radian.
    speeds = np.where(np.isfinite(speeds), speeds, usual * arm.length / NOMINAL_LINKS)
    return np.asarray(usual / speeds)
