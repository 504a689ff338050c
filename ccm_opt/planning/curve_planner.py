"""The planner of curves: configuration, motion, smooth path.

The known motion is bent to where the goal is now, or, where a wall is in its way, tracked by steps that keep off the
walls; then it is optimised like any other. There is no search, so this takes as long as an optimisation.

Free space and routes (section 4.1 of the paper), a goal configuration of the continuous curve by the NLP, tip paths,
the certified motion on the links, and a smooth path through joint space.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.progress import Stages
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.continuation import Stalled, settle
from ccm_opt.planning.curve_routes import find_guesses, find_routes, further_guesses, route_room, tip_paths_along
from ccm_opt.planning.ending import optimised_to_end_pose
from ccm_opt.planning.ends import Ends, clamped_arm, resolve_ends
from ccm_opt.planning.goal_pose import EndPoses
from ccm_opt.planning.leader import travel_between_samples
from ccm_opt.planning.led_strategies import fed_strategies
from ccm_opt.planning.limits.guide_tube import GuideTubeLimit
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.link_space import FedSpace, LinkSpace
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import CachedItems, MotionTask
from ccm_opt.planning.neighbourhood import neighbourhood
from ccm_opt.planning.optimisation.objective import JointSlowness
from ccm_opt.planning.own_units import in_own_units
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.planning.smooth_path import joint_path
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.strategies import STRATEGIES, find_motion
from ccm_opt.planning.tracking import ReferenceMotion, follow_reference
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.scene.contact_finder import CertificateSettings

_PLANNING_SHARE = 0.9
"""Share of the time limit that the search may use. Taste: timing and checks need the rest."""

_CONTACT_SHARE = 0.5
"""This half."""


def resumed(known: Motion, task: MotionTask) -> Motion | None:
    """A certified, optimised motion near a known one.

    Args:
        known: a motion to another goal or among other walls.
        task: the arm, the room, the goal and the limits as they are now.

    Returns:
        None where the known motion leads to none, or begins elsewhere; that says nothing of the task.
    """
    same_start = known.configurations.shape[1] == len(task.start) and np.allclose(
        known.configurations[0], task.start, rtol=0.0, atol=task.settings.certificate.rounding
    )
    if not same_start:
        return None
    if task.goal_pose is not None or task.user_limits:
        return None
    stepper = _stepper(known, task)
    moved = _bent(known, stepper, task) or _tracked(known, stepper, task)
    return None if moved is None else optimised_to_end_pose(moved, task)


def _stepper(known: Motion, task: MotionTask) -> Stepper:
    """Steps in the space through the start that holds the end of the known motion too."""
    space, _ = LinkSpace.through(task.arm, task.start, task.nominal_links, clamped=task.clamped)
    space, _ = space.blended_to(known.configurations[-1])
    return task.stepper(space, MARGINS[0])


def _bent(known: Motion, stepper: Stepper, task: MotionTask) -> Motion | None:
    """The known motion with the way of its end onto the goal added, more and more towards the end."""
    space = stepper.space
    coordinates = _coordinates(space, known, task.start)
    try:
        settled = settle(stepper, task.limited_goal, stepper.pose(coordinates[-1]), task.deadline)
    except Stalled:
        return None
    begun = replace(known, curve=space, unknowns=coordinates, u=None, end_pose=None)
    for bent in begun.bent_to(settled[-1].v, known.path_parameters):
        if _is_certified(bent, task):
            return bent
    # Where bending it would meet a wall, the motion goes on from its end.
    led_on = begun.through(np.vstack((coordinates, [pose.v for pose in settled[1:]])))
    return led_on if _is_certified(led_on, task) else None


def _tracked(known: Motion, stepper: Stepper, task: MotionTask) -> Motion | None:
    """The known motion tracked by steps that keep off the walls as they are now, then settled on the goal."""
    start = stepper.pose(_coordinates(stepper.space, known, task.start)[0])
    reference = ReferenceMotion.of(known)
    try:
        way = follow_reference(stepper, reference, task.limited_goal, start, task.deadline)
    except Stalled:
        return None
    motion = Motion.of(stepper.space, way.poses, known.candidate)
    return motion if _is_certified(motion, task) else None


def _coordinates(space: LinkSpace, known: Motion, start: FloatArray) -> FloatArray:
    """Coordinates nearest to the keyframes of the known motion, shape (K, p); those of the start are exact."""
    wanted = space.arm.poses(known.configurations) - space.arm.poses(space.offset)
    coordinates = np.array(np.linalg.lstsq(space.turns, wanted.T, rcond=None)[0].T, dtype=np.float64)
    exact = LinkSpace.through(space.arm, start, space.nominal_links, clamped=space.clamped)[1]
    coordinates[0] = np.append(exact, 0.0)
    return coordinates


def _is_certified(motion: Motion, task: MotionTask) -> bool:
    """Whether a motion keeps all limits."""
    q = motion.configurations
    return len(task.certificate.failures(q)) == 0 and task.within_joint_limits(q)


@dataclass(frozen=True)
class CurvePlanner:
    """Plans by the continuous curve; satisfies the ``Planner`` protocol.

    Attributes:
        stages: names and times the stages.
        terms: the user's constraints and costs, or None.
        refuse: raises where it is proved that no way leads to the goal; asked where no route is found, and for goals of
            the whole arm that are not reached at once.
        settings: numbers of every stage.
    """

    stages: Stages = field(default_factory=Stages)
    terms: UserTerms | None = None
    refuse: Callable[[Problem], None] = field(default=lambda _: None)
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER

    @property
    def user_limits(self) -> tuple[UserLimit, ...]:
        """The user's constraints and costs as limits of the motion; usually none."""
        return () if self.terms is None else (UserLimit(self.terms),)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion.

        Raises:
            NoPlanFound: with the reason and what would help.
        """
        with in_own_units(problem) as units:
            path, _ = self.planned(units.scaled(problem))
        return units.path_in_metres(path, problem.arm)

    def planned(self, problem: Problem, known: Motion | None = None) -> tuple[JointPath, Motion]:
        """Plan a certified motion, and keep it as the search knows it.

        Args:
            problem: what is asked, in units of its arm.
            known: a motion for a problem that differs a little, from which to go on; sought from nothing when None, or
                when nothing comes of it.

        Returns:
            The path and the motion that it follows.

        Raises:
            NoPlanFound: with the reason and what would help.
        """
        deadline = Deadline.after(_PLANNING_SHARE * problem.planner.time_limit)
        with self.stages("mapping"):
            ends = resolve_ends(problem)
            for limit in self.user_limits:
                limit.refuse_ends(ends.start, ends.goal_pose)
            near = neighbourhood(problem, ends)

        # Routes and guesses of goal poses, then the certified motion of the links, then the smooth path along it.
        end_poses = EndPoses(near, ends, self.stages, self.terms, self.settings.goal_pose)
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
        """What the search for a motion between ends that are already resolved is asked.

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
        """The same for those who know a motion already, and need no routes; arguments as for ``motion_task``."""
        settings = self.settings
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
            user_limits=self.user_limits,
            wanted_gap=problem.wanted_gap,
            guide_tubes=(GuideTubeLimit(arm, travel_between_samples(arm, problem.limits)),) if arm.base_axes else (),
            # In it a way of the base counts by the time that it takes.
            fed_space=FedSpace.of_arm(arm, turn_per_link(problem)) if arm.base_axes else None,
            settings=replace(settings.motion, certificate=certificate_settings(problem, settings.motion.certificate)),
        )

    def shape_change(self, problem: Problem, ends: Ends, deadline: Deadline) -> Motion:
        """A motion of what is beyond the hole of a feed axis, an arm on a fixed base, whatever the user asks.

        Raises:
            NoPlanFound: there is none.
        """
        return find_motion(CurvePlanner(settings=self.settings).motion_task(problem, ends, deadline))

    def _in_stage(self, configurations: Iterator[FloatArray]) -> Iterator[FloatArray]:
        """Configurations, each made in the stage of that name when it is asked for."""
        while True:
            with self.stages("configuration"):
                found = next(configurations, None)
            if found is None:
                return
            yield found


def _nothing_proved() -> None:
    """Refuses nothing."""


def certificate_settings(problem: Problem, settings: CertificateSettings) -> CertificateSettings:
    """Of a certificate that keeps to the contact tolerance of a problem."""
    return replace(settings, contact=_CONTACT_SHARE * problem.contact_tolerance)


def slowness(problem: Problem) -> JointSlowness:
    """What the joints and the base can do by their limits; planar motion turns the second revolute of every ball."""
    limits = problem.limits
    speeds, accelerations = limits.velocity[1::3], limits.acceleration[1::3]
    if problem.arm.base_axes:
        per_turn = turn_per_link(problem) / problem.arm.link_length  # rad a metre
        speeds = np.append(speeds, per_turn * (limits.feed_velocity or 1.0))
        accelerations = np.append(accelerations, per_turn * (limits.feed_acceleration or 1.0))
    return JointSlowness.from_limits(speeds, accelerations)


def turn_per_link(problem: Problem) -> float:
    """What the average joint turns while the base is carried by a link length [rad]."""
    speed = problem.limits.feed_velocity or 1.0
    return float(problem.limits.velocity[1::3].mean() * problem.arm.link_length / speed)
