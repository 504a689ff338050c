"""The planner of arms in space: from a problem to a certified joint path."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.errors import Diagnosis, MotionNotFound, NoPlanFound, ProblemError, UnreachableGoal
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.ground.length_words import place, short_length
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.ground.stages import Stages
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.motion.limits.user_ends import refuse_broken_goal, refuse_broken_start
from ccm_opt.solution import JointPath, SpaceGoalPoseRecord
from ccm_opt.space.clamped_base import told_of_clamped_base, with_clamped_base
from ccm_opt.space.curve.nominal_links import NOMINAL_LINKS
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.motion.optimisation.space_optimise import optimise
from ccm_opt.space.motion.passed_places import first_missed
from ccm_opt.space.motion.settings.space_motion_settings import SpaceMotionSettings
from ccm_opt.space.motion.space_goal import SpaceTipPose
from ccm_opt.space.motion.space_lifting import coarse_task, lifted_motion
from ccm_opt.space.motion.space_search import find_motion
from ccm_opt.space.motion.space_smooth_path import certified_path
from ccm_opt.space.motion.space_user_limit import SpaceUserLimit
from ccm_opt.space.motion.task import SpaceMotion, SpaceTask
from ccm_opt.space.motion.tracking_in_space import tracked
from ccm_opt.space.nlp_ending import ended_by_nlp
from ccm_opt.space.problem import SpaceJointPose, SpaceProblem, SpaceTipGoal
from ccm_opt.space.scene.enclosures import Enclosure, deepest_enclosure
from ccm_opt.space.scene.scene import ROOM_NAME
from ccm_opt.user_terms.compiled_terms import UserTerms

PLANNING_SHARE = 0.8
"""Of the time limit that planning may take; the rest is for timing, simulation and reasons."""


@dataclass(frozen=True)
class SpacePlanner:
    """Plans motions of arms in space.

    Attributes:
        stages: names and times the stages.
        settings: numbers of the search.
        terms: the user's constraints and costs; None where there are none.
        refuse: raises where it is proved that a problem has no plan; asked where no way of the tip leads to the goal.
    """

    stages: Stages = field(default_factory=Stages)
    settings: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    terms: UserTerms | None = None
    refuse: Callable[[SpaceProblem], None] | None = None

    def plan(self, problem: SpaceProblem) -> JointPath:
        """Plan a certified motion to the problem's goal.

        Raises:
            ProblemError: the start breaks a limit.
            NoPlanFound: with the reason and what would help.
        """
        deadline = Deadline.after(PLANNING_SHARE * problem.planner.time_limit)
        with self.stages("free space"):
            tree = SurfaceTree.of(problem.workspace.soup)
            problem = with_clamped_base(problem, tree)
            task = space_task(problem, tree, deadline, self.settings, self.terms)
            refuse_ends(problem, task)
            if self.refuse is not None:
                task = replace(task, refuse=partial(self.refuse, problem))
        try:
            planned = self._lifted(problem, task) or self._planned(problem, task)
        except NoPlanFound as none:
            raise told_of_clamped_base(none, problem) from none
        with self.stages("smooth path"):
            path = joint_path(task, *planned.motions, legs=problem.planner.retiming == "paul")
        return replace(path, goal_pose=planned.end)

    def _planned(self, problem: SpaceProblem, task: SpaceTask) -> "_Planned":
        """The optimised motion, and the one that was found, whose path may have room where the shorter one has none."""
        with self.stages("motion"):
            found = find_motion(task)
        with self.stages("configuration"):
            ending = ended_by_nlp(problem, task, found)
            motion = tracked(task, ending.motion)
        with self.stages("optimisation"):
            motions = (optimise(motion, ending.task), found if motion.u is None else motion)
        return _Planned(motions, ending.record)

    def _lifted(self, problem: SpaceProblem, task: SpaceTask) -> "_Planned | None":
        """The motion of an arm of many links, planned for few; None where the arm has few, or that does not pass."""
        few = coarse_task(task)
        if few is None:
            return None
        try:
            planned = self._planned(coarse_problem(problem, few), replace(few, refuse=None))
        except NoPlanFound:
            return None
        with self.stages("lifting"):
            lifted = lifted_motion(task, planned.motions[0])
        return None if lifted is None else _Planned((lifted,), planned.end)


@dataclass(frozen=True)
class _Planned:
    """What comes of planning.

    Attributes:
        motions: the best first; a smooth path is laid along the first that has room for one.
        end: what the NLP said about where they end, or None.
    """

    motions: tuple[SpaceMotion, ...]
    end: SpaceGoalPoseRecord | None


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


def refuse_ends(problem: SpaceProblem, task: SpaceTask) -> None:
    """Refuse a start, or a goal of the whole arm, in contact, and a goal that is out of reach.

    Raises:
        ProblemError: the start touches something, or breaks a constraint of the user.
        UnreachableGoal: the goal does, or is too far away.
    """
    if task.user is not None:
        refuse_broken_start(task.user.terms, task.start, task.user.settings.allowed)
        if task.goal_pose is not None:
            refuse_broken_goal(task.user.terms, task.goal_pose, task.user.settings.allowed)
    contact = contact_words(problem, task, task.start)
    if contact:
        raise ProblemError(f"the start is in contact: {contact}")
    if task.goal_pose is not None:
        contact = contact_words(problem, task, task.goal_pose)
        if contact:
            raise UnreachableGoal(Diagnosis(f"the goal pose is in contact: {contact}", "necessary checks"))
    if task.goal is not None:
        refuse_goal(problem, task, task.goal)


def refuse_goal(problem: SpaceProblem, task: SpaceTask, goal: SpaceTipPose) -> None:
    """Refuse a goal for the tip that leaves it no room, or that is out of reach.

    Raises:
        UnreachableGoal: saying which, and by how much.
    """
    _refuse_goal_without_room(problem, task, goal)
    _refuse_far_goal(task, goal)


def contact_words(problem: SpaceProblem, task: SpaceTask, q: FloatArray) -> str:
    """What a configuration touches and how deep it is inside of bodies, in words; empty where it is free."""
    contact = contact_of(problem, task, q)
    joints = joint_positions(task.arm, q)
    # An arm that touches nothing is inside of a body as a whole, as its tip tells.
    first = int(np.ceil(task.arm.mount_length / task.arm.link_length)) if contact else task.arm.links
    found = deepest_enclosure(problem.workspace, joints[first:])
    if found is None:
        return contact
    number = first + found.number
    point = "the tip" if number == task.arm.links else f"joint {number + 1}"
    deep = f"{point} is {_depth_words(found)}"
    return f"{contact}; {deep}" if contact else deep


def _depth_words(found: Enclosure) -> str:
    where = f"deep inside of '{found.name}'" if found.name else f"outside of the {ROOM_NAME}"
    return f"{short_length(found.depth)} {where}, at {place(found.place)}"


def _refuse_goal_without_room(problem: SpaceProblem, task: SpaceTask, goal: SpaceTipPose) -> None:
    """Refuse a goal for the tip inside of a body, or nearer to a surface than the arm may come."""
    found = deepest_enclosure(problem.workspace, goal.position[None])
    if found is not None:
        reason = f"the goal is {_depth_words(found)}"
        raise UnreachableGoal(Diagnosis(reason, "necessary checks", ("move the goal out of it",)))
    kept = task.arm.radius + task.clearance
    # Any place within the tolerance will do for a goal.
    least = kept - problem.tolerances.position
    near = task.tree.nearest(np.stack((goal.position, goal.position))[None], kept)
    if near.owner[0] >= 0 and near.gap[0] < least:
        missing = short_length(kept - float(near.gap[0]))
        name = task.names[near.owner[0]]
        reason = f"the goal leaves the tip no room: it is {missing} too near to '{name}' at {place(near.point[0])}"
        raise UnreachableGoal(
            Diagnosis(reason, "necessary checks", ("move the goal away from it", "use a thinner arm"))
        )


def contact_of(problem: SpaceProblem, task: SpaceTask, q: FloatArray) -> str:
    """What a configuration touches, in words; empty where it touches nothing."""
    del problem
    arm = task.arm
    points = joint_positions(arm, q)
    first = int(arm.mount_length / arm.link_length + 1e-9)
    if first < arm.links:
        segments = np.stack((points[first:-1], points[first + 1 :]), axis=1)
        share = arm.mount_length / arm.link_length - first
        segments[0, 0] += share * (segments[0, 1] - segments[0, 0])
        kept = arm.radius + task.clearance
        near = task.tree.nearest(segments, kept + arm.link_length)
        k = int(np.argmin(near.gap))
        if near.gap[k] < kept - ROUNDING:
            missing = short_length(kept - float(near.gap[k]))
            return (
                f"link {first + k + 1} and '{task.names[near.owner[k]]}' at {place(near.point[k])}, {missing} too near"
            )
    if arm.self_collision:
        pairs = task.certificate.motion.near_pairs(points, 2.0 * arm.radius)
        if len(pairs.first):
            k = int(np.argmin(pairs.distance))
            missing = short_length(2.0 * arm.radius - float(pairs.distance[k]))
            return f"link {pairs.first[k] + 1} and link {pairs.second[k] + 1}, {missing} too near"
    return ""


def _refuse_far_goal(task: SpaceTask, goal: SpaceTipPose) -> None:
    """Refuse a goal that no stretched arm reaches."""
    arm = task.arm
    low, high = arm.base_range
    along = float(np.clip((goal.position - arm.base) @ arm.direction, low, high))
    base = arm.base + along * arm.direction if arm.base_axes else arm.base
    distance = float(np.linalg.norm(goal.position - base))
    if distance > arm.length:
        missing = short_length(distance - arm.length)
        reason = f"the goal is out of reach: {missing} farther from the base than the arm is long"
        raise UnreachableGoal(Diagnosis(reason, "necessary checks", ("move the goal nearer", "use a longer arm")))


def joint_path(task: SpaceTask, *motions: SpaceMotion, legs: bool = False) -> JointPath:
    """The smooth, certified path through joint space along the first of some motions that has one.

    Args:
        task: what was asked.
        motions: certified.
        legs: whether the arm will move on straight legs between the keyframes, and not along the path.

    Raises:
        MotionNotFound: no smooth path near the motion can be certified.
    """
    missed = None
    for motion in motions:
        spline = certified_path(task, motion)
        missed = None if spline is None else _missed_on(task, spline)
        if spline is not None and missed is None:
            # Of what is certified to be spared timing may use nothing where constraints are kept exactly.
            kept = task.user is not None and task.user.terms.hard
            spare = 0.0 if kept else task.certificate.pair_gap
            keyframes = motion.configurations
            if task.arm.base_axes and not legs:
                # Drawn in the unknowns, the path of a fed arm may pass configurations of the motion by.
                keyframes = np.asarray(spline(np.linspace(0.0, 1.0, len(keyframes))))
            return JointPath(spline, keyframes, (), motion.candidate, spare=spare)
    if missed is not None:
        raise MotionNotFound(missed)
    if task.user is None or not task.user.terms.hard:
        raise MotionNotFound(Diagnosis("the motion leaves no room for a smooth path", "motion"))
    names = " and ".join(f"'{name}'" for name in task.user.names)
    reason = f"a motion was found, but no smooth path near it that keeps constraint {names} between its keyframes"
    advice = ["give the constraint some width between its bounds, or make it soft"]
    if task.user.shapes_path and task.arm.base_axes:
        advice.append("leave arm.feed out: equations that are not linear hold for arms with a fixed base")
    raise MotionNotFound(Diagnosis(reason, "constraints", tuple(advice)))


def _missed_on(task: SpaceTask, spline: BSpline) -> Diagnosis | None:
    """Which place the tip does not pass on a path, in words; None where it passes all."""
    if not task.via:
        return None
    spans = len(spline.t) - 2 * spline.k - 1
    u = np.linspace(0.0, 1.0, spans * task.settings.smooth_path.samples + 1)
    tips = joint_positions(task.arm, np.asarray(spline(u)))[:, -1]
    missed = first_missed(tips, np.stack(task.via), task.via_reach)
    if missed is None:
        return None
    number, away = missed
    reason = (
        f"the tip comes within {short_length(away)} of goal.via {number + 1}, "
        f"{short_length(away - task.via_reach)} too far off to pass it"
    )
    return Diagnosis(reason, "motion", ("move the place to where an arm as long and stiff as this can pass it",))
