"""The planner: ends, routes, motion and smooth path, in the plane and in space.

In the plane there are routes through free space (section 4.1 of the paper), a goal configuration of the continuous
curve by the NLP, tip paths, the certified motion on the links, and a smooth path through joint space; in space the
search, the pose in which the motion ends, the optimisation and the smooth path.

A known motion in the plane is bent to where the goal is now, or, where a wall is in its way, tracked by steps that keep
off the walls; then it is optimised like any other. There is no search, so this takes as long as an optimisation.

In space the default mount is as long as the arm's radius. Where such an arm stands square on a floor, the disc at the
end of the mount just touches it, and any turn of the base would press its rim in. The first joints are left straight
then; the arm bends beyond them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.progress import Stages
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.curve_routes import find_guesses, find_routes, further_guesses, route_room, tip_paths_along
from ccm_opt.planning.ending import ended_by_nlp, optimised_to_end_pose
from ccm_opt.planning.ends import Ends, clamped_arm, refuse_ends, resolve_ends
from ccm_opt.planning.goal_pose import EndPoses
from ccm_opt.planning.leader import travel_between_samples
from ccm_opt.planning.leader_strategies import fed_strategies
from ccm_opt.planning.limits.guide_tube import GuideTubeLimit
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.link_space import FedSpace
from ccm_opt.planning.motion import Motion, SpaceMotion
from ccm_opt.planning.motion_task import CachedItems, MotionTask
from ccm_opt.planning.neighbourhood import neighbourhood
from ccm_opt.planning.optimisation.objective import JointSlowness
from ccm_opt.planning.optimisation.optimise import optimise, with_more_room
from ccm_opt.planning.own_units import planning_units
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.pose_beginnings import any_motion
from ccm_opt.planning.refinement import lifted_motion, nominal_task
from ccm_opt.planning.settings import (
    DEFAULT_CURVE_PLANNER,
    CurvePlannerSettings,
    SpaceCertificateSettings,
    SpaceMotionSettings,
)
from ccm_opt.planning.smooth_path import joint_path
from ccm_opt.planning.space_task import SpaceTask, coarse_problem, space_task
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.strategies import STRATEGIES, find_by_ways, find_motion
from ccm_opt.planning.tracking import Reference, follow_reference, tracked
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import GoalPoseRecord, JointPath
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.contact_finder import CertificateSettings
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_SHARE_IN_THE_PLANE = 0.9
"""Share of the time limit that the search may use. Taste: timing and checks need the rest."""
_SHARE_IN_SPACE = 0.8
"""The same in space: the rest is for timing, simulation and reasons."""
_CONTACT_SHARE = 0.5
"""Share of the contact tolerance that planning uses. Taste."""
_STRAIGHT = 1e-9
"""Bends up to which joints count as straight [rad]."""
_SQUARE = 1e-6
"""One less the cosine of the angle to a wall's normal up to which the end of the mount stands square on it."""

_Planned: TypeAlias = tuple[tuple[SpaceMotion, ...], GoalPoseRecord | None]
"""Motions in space of which the first that has a smooth path is taken, and the record of the pose in which they end."""


def resumed(known: Motion, task: MotionTask) -> Motion | None:
    """Return a certified, optimised motion near a known one.

    Args:
        known: a motion from the same start to another goal or among other walls.
        task: the arm, the room, the goal and the limits as they are now.

    Returns:
        None where the known motion leads to none; that says nothing of the task.
    """
    if task.goal_pose is not None or task.user_limits:
        return None
    # The space through the start that holds the end of the known motion too.
    space, start = task.space_through(task.start)
    space, _ = space.blended_to(known.configurations[-1])
    stepper = task.stepper(space, MARGINS[0])
    coordinates = space.closest(known.configurations)
    coordinates[0] = np.append(start, 0.0)
    moved = _bent(known, coordinates, stepper, task) or _tracked(known, coordinates[0], stepper, task)
    return None if moved is None else optimised_to_end_pose(moved, task)


def _bent(known: Motion, coordinates: FloatArray, stepper: Stepper, task: MotionTask) -> Motion | None:
    """Return the known motion with the way of its end onto the goal added, more and more towards the end.

    Args:
        known: the motion.
        coordinates: of its keyframes in the space of the steps, shape (K, p).
        stepper: takes steps.
        task: with the goal.
    """
    try:
        settled = settle(stepper, task.limited_goal, stepper.pose(coordinates[-1]), task.deadline)
    except Stalled:
        return None
    begun = replace(known, curve=stepper.space, unknowns=coordinates, u=None, end_pose=None)
    for bent in begun.bent_to(settled[-1].v):
        if len(task.failures(bent.curve, bent.unknowns)) == 0:
            return bent
    # Where bending it would meet a wall, the motion goes on from its end.
    led_on = begun.through(np.vstack((coordinates, [pose.v for pose in settled[1:]])))
    return led_on if len(task.failures(led_on.curve, led_on.unknowns)) == 0 else None


def _tracked(known: Motion, start: FloatArray, stepper: Stepper, task: MotionTask) -> Motion | None:
    """Return the known motion tracked from its start by steps that keep off the walls as they are now, then settled."""
    reference = Reference.of(known, stepper.space)
    try:
        way = follow_reference(stepper, reference, task.limited_goal, stepper.pose(start), task.deadline)
    except Stalled:
        return None
    motion = Motion.of(stepper.space, way.poses, known.candidate)
    return motion if len(task.failures(motion.curve, motion.unknowns)) == 0 else None


@dataclass(frozen=True)
class MotionPlanner:
    """Plans certified motions; satisfies the ``Planner`` protocol.

    Attributes:
        stages: names and times the stages.
        terms: the user's constraints and costs, or None.
        refuse: raises where it is proved that no way leads to the goal; asked where no route or no way of the tip is
            found, and for goals of the whole arm that are not reached at once.
        plane: numbers of every stage in the plane.
        space: the same in space.
        first_found: whether in space the first motion that is found is taken as it is.
    """

    stages: Stages = field(default_factory=Stages)
    terms: UserTerms | None = None
    refuse: Callable[[Problem], None] = field(default=lambda _: None)
    plane: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
    space: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    first_found: bool = False

    @property
    def user(self) -> UserLimit | None:
        """The user's constraints and costs as a limit of motions in the plane; usually None."""
        return None if self.terms is None else UserLimit(self.terms)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion to the problem's goal.

        Raises:
            ProblemError: the start breaks a limit.
            NoPlanFound: with the reason and what would help.
        """
        if problem.dimension == 2:
            with planning_units(problem) as units:
                path, _ = self.planned(units.scaled(problem))
            return units.path_in_metres(path, problem.arm)
        deadline = Deadline.after(_SHARE_IN_SPACE * problem.planner.time_limit)
        with self.stages("free space"):
            tree = SurfaceTree.of(problem.workspace.soup)
            problem = with_clamped_base(problem, tree)
            task = space_task(problem, tree, deadline, self.space, self.terms)
            refuse_ends(problem, task)
            task = replace(task, refuse=partial(self.refuse, problem))
        try:
            found = ((any_motion(task),), None) if self.first_found else self._lifted(problem, task)
            motions, end = found or self._planned(problem, task)
        except NoPlanFound as none:
            raise annotate_clamped_base(none, problem) from none
        with self.stages("smooth path"):
            path = joint_path(task, *motions, legs=problem.planner.retiming == "paul")
        return replace(path, goal_pose=end)

    def planned(self, problem: Problem, known: Motion | None = None) -> tuple[JointPath, Motion]:
        """Plan a certified motion in the plane, and keep it as the search knows it.

        Args:
            problem: what is asked, in units of its arm.
            known: a motion for a problem that differs a little, from which to go on; sought from nothing when None, or
                when nothing comes of it.

        Returns:
            The path and the motion that it follows.

        Raises:
            NoPlanFound: with the reason and what would help.
        """
        deadline = Deadline.after(_SHARE_IN_THE_PLANE * problem.planner.time_limit)
        with self.stages("mapping"):
            ends = resolve_ends(problem)
            if self.user is not None:
                self.user.refuse_ends(ends.start, ends.goal_pose)
            near = neighbourhood(problem, ends)

        # Routes and guesses of goal poses, then the certified motion of the links, then the smooth path along it.
        end_poses = EndPoses(near, ends, self.stages, self.terms, self.plane.goal_pose)
        if known is not None:
            with self.stages("motion"):
                task = replace(self.task_without_routes(near, ends, deadline), end_poses=end_poses)
                motion = resumed(known, task)
                if motion is not None:
                    path = joint_path(task, motion)
                    return replace(path, goal_pose=end_poses.record(motion.end_pose)), motion
        strategies = STRATEGIES
        if problem.arm.base_axes:
            task = self.task_without_routes(problem, ends, deadline)
            task = replace(task, refuse=partial(self.refuse, problem))
            strategies = fed_strategies(problem, self.shape_change)
        else:
            task = replace(self.motion_task(near, ends, deadline, problem), end_poses=end_poses)
        with self.stages("motion"):
            motion = find_motion(task, strategies)
            path = joint_path(task, motion)
        return replace(path, goal_pose=end_poses.record(motion.end_pose)), motion

    def motion_task(self, problem: Problem, ends: Ends, deadline: Deadline, asked: Problem | None = None) -> MotionTask:
        """Return what the search for a motion between ends that are already resolved is asked.

        Args:
            problem: perhaps with the walls of the neighbourhood alone.
            ends: of the motion.
            deadline: when to stop.
            asked: the problem with all walls as they are, for proofs; the same when None.

        Raises:
            NoPlanFound: there is no route, and a proof that there can be none.
        """
        with self.stages("free space"):
            room = route_room(problem, ends)
            routes = find_routes(problem, ends, room) if ends.goal_pose is None else ()
            tip_paths = tip_paths_along(problem, ends, routes, room)
            if not tip_paths:
                self.refuse(problem if asked is None else asked)
        # Without a goal for the whole arm all that there is to prove has been tried by now.
        refuse = partial(self.refuse, asked or problem) if ends.goal_pose is not None else _nothing_proved
        guesses = CachedItems(self._in_stage(find_guesses(problem, ends, room, routes)))
        further = CachedItems(self._in_stage(further_guesses(problem, ends, room, routes)))
        return replace(
            self.task_without_routes(problem, ends, deadline),
            guesses=guesses,
            tip_paths=tip_paths,
            further_guesses=further,
            refuse=refuse,
        )

    def task_without_routes(self, problem: Problem, ends: Ends, deadline: Deadline) -> MotionTask:
        """Return the same for those who know a motion already, and need no routes; arguments as for ``motion_task``."""
        settings = self.plane
        arm = clamped_arm(problem.arm) if ends.clamped else problem.arm
        return MotionTask(
            arm=arm,
            workspace=problem.workspace,
            start=ends.start,
            goal=ends.goal,
            goal_pose=ends.goal_pose,
            deadline=deadline,
            clamped=ends.clamped,
            optimiser=problem.planner.optimiser,
            seed=problem.planner.seed,
            weights=problem.planner.weights,
            slowness=slowness(problem),
            user=self.user,
            wanted_gap=problem.wanted_gap,
            held=(GuideTubeLimit(arm, travel_between_samples(arm, problem.limits)),) if arm.base_axes else (),
            # In it a way of the base counts by the time that it takes.
            fed_space=FedSpace.of_arm(arm, turn_per_link(problem)) if arm.base_axes else None,
            settings=replace(settings.motion, certificate=certificate_settings(problem, settings.motion.certificate)),
        )

    def shape_change(self, problem: Problem, ends: Ends, deadline: Deadline) -> Motion:
        """Return a motion of what is beyond the hole of a feed axis, an arm on a fixed base, whatever the user asks.

        Raises:
            NoPlanFound: there is none.
        """
        return find_motion(MotionPlanner(plane=self.plane).motion_task(problem, ends, deadline))

    def _in_stage(self, configurations: Iterator[FloatArray]) -> Iterator[FloatArray]:
        """Yield the configurations, each made in the stage of that name when it is asked for."""
        while True:
            with self.stages("configuration"):
                found = next(configurations, None)
            if found is None:
                return
            yield found

    # ------------------------------------------------------------ in space
    def _planned(self, problem: Problem, task: SpaceTask) -> _Planned:
        """The optimised motion, and the one that was found, whose path may have room where the shorter one has none.

        With them comes what the NLP said about where they end, or None.
        """
        with self.stages("motion"):
            found = find_by_ways(task)
        with self.stages("configuration"):
            ending = ended_by_nlp(problem, task, found)
            motion = tracked(task, ending.motion)
        with self.stages("optimisation"):
            motions = (
                with_more_room(optimise(motion, ending.task), motion, ending.task),
                found if motion.u is None else motion,
            )
        return motions, ending.record

    def _lifted(self, problem: Problem, task: SpaceTask) -> _Planned | None:
        """Return the motion of an arm of many links, planned for few.

        None where the arm has few, or that does not pass.
        """
        few = nominal_task(task)
        if few is None:
            return None
        try:
            motions, end = self._planned(coarse_problem(problem, few), replace(few, refuse=lambda: None))
        except NoPlanFound:
            return None
        with self.stages("lifting"):
            lifted = lifted_motion(task, motions[0])
        return None if lifted is None else ((lifted,), end)


def _nothing_proved() -> None:
    """Refuses nothing."""


def certificate_settings(problem: Problem, settings: CertificateSettings) -> CertificateSettings:
    """Of a certificate that keeps to the contact tolerance of a problem."""
    return replace(settings, contact=_CONTACT_SHARE * problem.contact_tolerance)


def slowness(problem: Problem) -> JointSlowness:
    """Return what the joints and the base can do by their limits.

    Planar motion turns the second revolute of every ball.
    """
    limits = problem.limits
    speeds, accelerations = limits.velocity[1::3], limits.acceleration[1::3]
    if problem.arm.base_axes:
        per_turn = turn_per_link(problem) / problem.arm.link_length  # rad a metre
        speeds = np.append(speeds, per_turn * (limits.feed_velocity or 1.0))
        accelerations = np.append(accelerations, per_turn * (limits.feed_acceleration or 1.0))
    return JointSlowness.from_limits(speeds, accelerations)


def turn_per_link(problem: Problem) -> float:
    """Return what the average joint turns while the base is carried by a link length [rad]."""
    speed = problem.limits.feed_velocity or 1.0
    return float(problem.limits.velocity[1::3].mean() * problem.arm.link_length / speed)


def with_clamped_base(problem: Problem, tree: SurfaceTree) -> Problem:
    """The problem for an arm whose first joints stay straight and belong to the mount, where it stands flush on a wall.

    Args:
        problem: with one goal.
        tree: of its surfaces.
    """
    count = clamped_joints(problem, tree)
    arm = problem.arm
    clamped = replace(arm, mount_length=count * arm.link_length, clamped_joints=count)
    return replace(problem, arm=clamped) if count else problem


def clamped_joints(problem: Problem, tree: SurfaceTree) -> int:
    """Return how many joints from the base a wall at the end of the mount holds straight; 0 where there is none."""
    arm = problem.arm
    first, share = arm.mount_end
    count = max(1, int(np.ceil(first + share - _STRAIGHT)))
    ends = [q for pose in (problem.start, problem.goal) if (q := pose.whole(arm)) is not None]
    bent = np.any(np.abs(np.stack(ends)[:, : 2 * count]) >= _STRAIGHT)
    if arm.base_axes or share >= 1.0 - _STRAIGHT or count >= arm.links or bent:
        return 0
    points = arm.joint_positions_at(problem.start.configuration(arm))
    along = points[first + 1] - points[first]
    end = points[first] + share * along
    # What a motion has to spare beyond contact is not there: no certificate would let the base turn.
    spare = SpaceCertificateSettings().spare * arm.length / NOMINAL_LINKS
    reach = arm.radius + problem.workspace.clearance + spare
    near = tree.nearest(np.stack((end, end))[None], reach)
    if near.owner[0] < 0 or near.gap[0] >= reach:
        return 0
    # Held only by what lies square behind it.
    away = end - near.point[0]
    square = away @ along >= (1.0 - _SQUARE) * np.linalg.norm(along) * np.linalg.norm(away)
    return count if square else 0


def annotate_clamped_base(failure: NoPlanFound, problem: Problem) -> NoPlanFound:
    """Return the failure with what would let the first joint bend among its advice, where the base is clamped."""
    if not problem.arm.clamped_joints:
        return failure
    found = failure.diagnosis
    own = "raise arm.mount_length: the arm stands flush on a wall, so that the base cannot turn"
    return type(failure)(replace(found, advice=(own, *found.advice)))
