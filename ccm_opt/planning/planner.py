"""The planner: finds a motion between resolved ends, optimises it and smooths it, in the plane and in space.

In the plane the stages are routes through free space (section 4.1 of the paper), a goal configuration of the continuous
curve by the NLP, tip paths, the certified motion of the links and a smooth path through joint space. In space they are
the search, the goal configuration by the NLP, the optimisation and the smooth path.

To replan, a known motion is adapted to the new goal (see ``resuming``).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ccm_opt.core.arrays import ROUNDING, TINY, FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import MotionNotFound, NoPlanFound, ProblemError
from ccm_opt.core.progress import Stages
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.clamped_base import annotate_clamped_base, with_clamped_base
from ccm_opt.planning.curve_routes import find_guesses, find_routes, further_guesses, route_room, tip_paths_along
from ccm_opt.planning.ending import ended_by_nlp
from ccm_opt.planning.ends import Ends, clamped_arm, refuse_ends, resolve_ends
from ccm_opt.planning.goal_pose import EndPoses
from ccm_opt.planning.leader import travel_between_samples
from ccm_opt.planning.leader_motion import (
    certified_path,
    not_behind_tip,
    path_behind_tip,
    travel_time,
    with_clearance_limit,
)
from ccm_opt.planning.leader_strategies import fed_strategies
from ccm_opt.planning.limits.following import FollowingLimit
from ccm_opt.planning.limits.guide_tube import GuideTubeLimit
from ccm_opt.planning.limits.limit import LimitOf
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.link_space import FedSpace
from ccm_opt.planning.motion import CurveMotion, Motion, SpaceMotion
from ccm_opt.planning.motion_task import CachedItems, MotionTask
from ccm_opt.planning.neighbourhood import neighbourhood
from ccm_opt.planning.optimisation.objective import JointSlowness
from ccm_opt.planning.optimisation.optimise import clearance_limit, optimise, with_more_clearance
from ccm_opt.planning.own_units import planning_units
from ccm_opt.planning.path_following import motion_along
from ccm_opt.planning.plane_in_space import needs_space, path_in_plane, problem_in_space, told_in_plane
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.pose_beginnings import any_motion
from ccm_opt.planning.refinement import nominal_task, refine_space_motion
from ccm_opt.planning.resuming import (
    bent_keyframes,
    bent_onto,
    known_motion,
    moved_end,
    nearest_known,
    resumed,
    same_route,
    tracked_to,
)
from ccm_opt.planning.search import Strategy, clearance_cost
from ccm_opt.planning.settings import (
    DEFAULT_CURVE_PLANNER,
    CurvePlannerSettings,
    SpaceMotionSettings,
)
from ccm_opt.planning.smooth_path import joint_path
from ccm_opt.planning.space_task import SpaceTask, coarse_problem, space_task
from ccm_opt.planning.strategies import SAMPLED_WAYS, SAMPLERS, STRATEGIES, WAYS, find_by_ways, find_motion
from ccm_opt.planning.tool_problem import bodies_as_links
from ccm_opt.planning.tracking import tracked
from ccm_opt.planning.way_strategies import SpaceRun
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import GoalPoseRecord, JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.contact_finder import CertificateSettings

_SHARE_IN_THE_PLANE = 0.9
"""Fraction of the time limit that the search in the plane may use. Heuristic: the rest is for timing and checks."""
_SHARE_IN_SPACE = 0.8
"""Fraction of the time limit that the search in space may use: the rest is for timing, simulation and diagnosis."""
_SPACE_SHARE, _LEAST_IN_SPACE = 0.1, 5.0
"""Time in which a motion that was not found in the plane is sought in space: a fraction of the time limit, and at least
so long [s]. Heuristic: of random arms that never leave their guide tube wholly, most take less than a second."""
_KNOWN_SHARE = 0.4
"""Fraction of the time limit in which a known motion of a fed arm in the plane is adapted in space. Heuristic."""
_ADAPTING_SHARE = 0.7
"""Fraction of the time left in the plane that adapting a known motion may use: the rest is for the smooth path, which
takes a tenth as long in the swan's neck. Heuristic."""
_ADAPTING_SHARE_IN_SPACE = 0.45
"""Fraction of the time left in space that adapting a known motion may use: the rest is for a search. Heuristic."""
_SLOWER = 1.1
"""Ratio of the durations of a path on which a fed arm follows its tip and of the last path from which on the last one
is deformed too. Heuristic."""
_FOUND_SHARE = 0.7
"""Fraction of the time left then in which the first motion has to be found if no other is wanted. Derived: the smooth
path takes up to 0.1 of the second in which a drag is answered."""
_SHORTENING_SHARE = 0.4
"""Fraction of the time left in space that optimising an adapted motion may use: the rest is for the smooth path."""
_SHORTENING_LEFT = 0.55
"""Fraction of the time limit that has to be left for it: an answer that took long is not delayed further. Heuristic."""
_SHORTENING_GAIN = 0.05
"""Least gain of such an optimisation, as a fraction of the cost of the motion, that counts as notable. Heuristic."""
_SHORTENING_ROUNDS = 4
"""Maximum number of steps of this optimisation. Measured in a wing box: a motion of 11.2 s takes 7.4 s after it, and
7.3 s after as many steps as ``solve`` makes, in one and a half times the time."""
_OPTIMISATION_SHARE = 0.5
"""Fraction of the time left in space that the optimisation may use: the rest is for the smooth path. Heuristic."""
_FURTHER_SHARE = 0.6
"""Fraction of the time for improving a path that the optimisation may use, likewise."""
_GAINED = 0.02
"""Least gain of clearance, as a fraction of the preferred one, for which a path is replaced. Heuristic."""
_IMPROVABLE = frozenset(("steps", "time", "smooth path"))
"""Causes of lacking clearance that more time may remove."""
_LOOKS = 5
"""Number of samples per keyframe at which the clearance that a path lacks is measured. Heuristic."""
_CONTACT_SHARE = 0.5
"""Fraction of the problem's contact tolerance up to which planning accepts penetration. Heuristic."""


@dataclass(frozen=True)
class _Planned:
    """Result of planning in space.

    Attributes:
        motions: certified motions, of which the first with a certified smooth path is used.
        end: record of the goal pose by the NLP, or None.
        behind_tip: path to the goal on which the arm follows the path of its tip and which is not optimised, or None.
    """

    motions: tuple[SpaceMotion, ...]
    end: GoalPoseRecord | None = None
    behind_tip: JointPath | None = None


@dataclass(frozen=True)
class PlannedPath:
    """Certified path of a problem, with the motion from which a path for a similar problem can be made.

    Attributes:
        path: the smooth path.
        motion: the motion that the path follows, in the plane in units of the arm.
        resumed: whether the motion was adapted from a known one or, in space, can be deformed into it, so that it takes
            the same route.
        shortened: whether an optimisation of the adapted motion lowered its cost notably.
    """

    path: JointPath
    motion: CurveMotion[Any]
    resumed: bool = False
    shortened: bool = False

    def mapped(self, change: Callable[[JointPath], JointPath]) -> "PlannedPath":
        """Return the plan with its path changed by a function; the motion stays that of the arm as planned."""
        return replace(self, path=self.path.mapped(change))


@dataclass(frozen=True)
class MotionPlanner:
    """Plans certified motions; satisfies the ``Planner`` protocol.

    Attributes:
        stages: measures the durations of the stages.
        terms: the user's constraints and costs, or None.
        refuse: raises an error if the goal is proved unreachable; called when no tip path is found, and for goals of
            the whole arm that are not reached at once.
        plane: settings of every stage in the plane.
        space: settings of every stage in space.
        first_found: whether, in space, the first motion found is smoothed without optimisation.
        sampled: whether RRT-Connect is the only method of searching for a motion.
    """

    stages: Stages = field(default_factory=Stages)
    terms: UserTerms | None = None
    refuse: Callable[[Problem], None] = field(default=lambda _: None)
    plane: CurvePlannerSettings = DEFAULT_CURVE_PLANNER
    space: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    first_found: bool = False
    sampled: bool = False

    @property
    def user(self) -> UserLimit | None:
        """The user's constraints and costs as a limit of motions in the plane; usually None."""
        return None if self.terms is None else UserLimit(self.terms)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion to the problem's goal.

        Raises:
            ProblemError: the start violates a limit, or RRT-Connect is the only method for an arm on a feed axis.
            NoPlanFound: no motion was found; gives the reason and advice.
        """
        if problem.goal.look_at is not None:
            raise ProblemError("this planner takes goals for the tip; goal.look_at is taken by ccm_opt.solve")
        if problem.coverage is not None and problem.planner.order == "free":
            raise ProblemError("this planner takes goals for the tip; goal.see is taken by ccm_opt.solve")
        if self.sampled and problem.arm.feed is not None:
            raise ProblemError(
                "the method rrt-connect does not support a feed axis; use planner.method nlp, or leave arm.feed out"
            )
        if problem.dimension == 3 and problem.goal.path is not None:
            return self._along_path(problem, problem.goal.path)
        return self.replanned(problem).path

    def replanned(
        self, problem: Problem, known: Sequence[CurveMotion[Any]] = (), *, shortened: bool = False
    ) -> PlannedPath:
        """Plan a certified motion to the problem's goal, from a known one if that can be adapted.

        Args:
            problem: the problem, with a goal for the tip or the whole arm.
            known: motions for slightly different problems, as planned by this method or from ``known_motion``.
            shortened: whether a motion adapted in space is optimised as far as time permits, if most of it is left.

        Raises:
            ProblemError: the start violates a limit.
            NoPlanFound: no motion was found; gives the reason and advice.
        """
        arm = problem.arm
        if problem.dimension == 3 or needs_space(arm):
            return self.planned_in_space(problem, known, shortened=shortened)
        if arm.rigid_bodies:
            whole, back = bodies_as_links(problem)
            deadline = Deadline.after(problem.planner.time_limit)
            return self._or_in_space(problem, deadline, lambda: self.replanned(whole, known).mapped(back))
        if arm.feed is not None:
            return self._fed_in_plane(problem, known)
        with planning_units(problem) as units:
            planned = self.planned(units.scaled(problem), known)
        return planned.mapped(partial(units.path_in_metres, arm=arm))

    def _fed_in_plane(self, problem: Problem, known: Sequence[SpaceMotion]) -> PlannedPath:
        """Return a path of a fed arm in the plane, sought as one in space too: first if a motion is known, else last.

        Raises:
            NoPlanFound: no motion was found; gives the reason and advice.
        """
        limit = problem.planner.time_limit
        deadline = Deadline.after(limit)
        in_space = self.terms is None and problem.goal.path is None

        def within(seconds: float) -> Problem:
            return replace(problem, planner=replace(problem.planner, time_limit=min(deadline.left, seconds)))

        if known and in_space:
            with suppress(NoPlanFound):
                return replace(self, refuse=_nothing_proved_of).planned_in_space(within(_KNOWN_SHARE * limit), known)

        def planned() -> PlannedPath:
            with planning_units(problem) as units:
                path = self.planned(units.scaled(within(limit))).path
            path = units.path_in_metres(path, problem.arm)
            return PlannedPath(path, known_motion(problem.arm, path.keyframes))

        return planned() if known else self._or_in_space(problem, deadline, planned)

    def _or_in_space(self, problem: Problem, deadline: Deadline, planned: Callable[[], PlannedPath]) -> PlannedPath:
        """Return the path that a function finds in the plane, or where it finds none, one found in space.

        Args:
            problem: the problem, in the plane.
            deadline: its deadline, by which a path in space has to be found too.
            planned: returns the path in the plane.

        Raises:
            NoPlanFound: no motion was found; gives the reason in the plane.
        """
        try:
            return planned()
        except MotionNotFound:
            if self.terms is not None or problem.goal.path is not None or deadline.passed():
                raise
            limit = min(deadline.left, max(_SPACE_SHARE * problem.planner.time_limit, _LEAST_IN_SPACE))
            with suppress(NoPlanFound):
                options = replace(problem.planner, time_limit=limit)
                path = self.planned_in_space(replace(problem, planner=options)).path
                return PlannedPath(path, known_motion(problem.arm, path.keyframes))
            raise

    def planned_in_space(
        self, problem: Problem, known: Sequence[SpaceMotion] = (), *, shortened: bool = False
    ) -> PlannedPath:
        """Plan a certified motion in space and a smooth path along it.

        Args:
            problem: the problem, without a path for the tip; one in the plane is planned as one in space.
            known: motions for slightly different problems, of which the nearest is adapted; a new motion is searched
                for if there is none or it cannot be adapted.
            shortened: whether an adapted motion is optimised as far as time permits, if most of it is left.

        Raises:
            ProblemError: the start violates a limit.
            NoPlanFound: no motion was found; gives the reason and advice.
        """
        arm = problem.arm
        if arm.dimension == 2:
            if self.terms is not None:
                raise ProblemError(
                    "constraints and costs are not supported for a planar arm of sections that bend evenly, or on a "
                    "feed axis with a tool, bodies or locked joints; leave them out"
                )
            with told_in_plane():
                in_space = self.planned_in_space(problem_in_space(problem), known, shortened=shortened)
            return in_space.mapped(partial(path_in_plane, arm=arm))
        if arm.rigid_bodies:
            whole, back = bodies_as_links(problem)
            return self.planned_in_space(whole, known, shortened=shortened).mapped(back)
        problem, task = self._space_task(problem)
        nearest = nearest_known(known, problem)
        adapted = None if nearest is None else self._adapted(problem, task, nearest)
        if adapted is not None:
            enough = task.deadline.left > _SHORTENING_LEFT * problem.planner.time_limit
            return self._shortened(problem, task, adapted) if shortened and enough else adapted
        hurried = task.deadline_within(_FOUND_SHARE * task.deadline.left)
        try:
            found = _Planned((any_motion(hurried),)) if self.first_found else self._refined(problem, task)
            planned = found or self._planned(problem, task)
        except NoPlanFound as none:
            raise annotate_clamped_base(none, problem) from none
        if planned.behind_tip is not None:
            return PlannedPath(replace(planned.behind_tip, goal_pose=planned.end), planned.motions[0])
        with self.stages("smooth path"):
            # What limits the clearance takes up to a fifth of a second to tell.
            smooth = _smoothed(problem, task, planned.motions, limited=nearest is None)
            if nearest is not None:
                before = nearest.configurations if nearest.instead is None else nearest.instead
                smooth = replace(smooth, resumed=same_route(before, smooth.path.keyframes, task))
        return self._improvable(problem, task, replace(smooth, path=replace(smooth.path, goal_pose=planned.end)))

    def _adapted(self, problem: Problem, task: SpaceTask, known: SpaceMotion) -> PlannedPath | None:
        """Return the plan whose motion is a known one adapted to the task's goal, or None if it cannot be adapted.

        Where the arm follows its tip, only that path is certified: the adapted motion gives its end. Else the last path
        is deformed, or the motion. Where nothing is certified, the motion is tracked by steps that avoid obstacles.
        """
        hurried = task.deadline_within(_ADAPTING_SHARE_IN_SPACE * task.deadline.left)
        with self.stages("motion"):
            rows = known.configurations if known.instead is None else known.instead
            end = moved_end(known if known.instead is None else known_motion(task.arm, rows), hurried)
        if end is None:
            return None
        adapted = None
        if task.follows:
            bent = next(end[0].bent_to(end[1][-1].v))
            adapted = self._behind_tip(problem, hurried, bent)
            most = _SLOWER * travel_time(rows, task)
            if adapted is None or travel_time(adapted.path.keyframes, task) > most:
                other = self._bent(problem, hurried, rows, bent, end[1])
                adapted = min(filter(None, (adapted, other)), key=lambda each: _cost(each, task), default=None)
        if adapted is None:
            with self.stages("motion"):
                motion = bent_onto(*end, hurried)
            adapted = self._resumed(problem, task, motion)
        if adapted is not None:
            return adapted
        with self.stages("motion"):
            begun, poses = end
            motion = tracked_to(begun, poses[-1].v, hurried)
        return self._resumed(problem, task, motion)

    def _behind_tip(self, problem: Problem, task: SpaceTask, bent: SpaceMotion) -> PlannedPath | None:
        """Return the plan on which the arm follows its tip to the end of a deformed motion."""
        with self.stages("smooth path"):
            behind = path_behind_tip(_bounded(problem, task), bent, optimised=True)
        if behind is None:
            return None
        # A control polygon of a spline keeps joints straight in the tube; places on the spline hardly show where.
        return PlannedPath(behind, replace(bent, instead=np.asarray(behind.spline.c)), resumed=True)

    def _bent(
        self, problem: Problem, task: SpaceTask, rows: FloatArray, motion: SpaceMotion, poses: Sequence[Pose]
    ) -> PlannedPath | None:
        """Return the plan along keyframes (K, c) that are deformed or extended to end in the last of some poses.

        Args:
            problem: the problem.
            task: its search task.
            rows: the keyframes, which are left where the poses begin.
            motion: deformed motion to the same end.
            poses: poses onto the goal.
        """
        name = motion.candidate
        rows = rows[: 1 + int(np.argmin(np.max(np.abs(rows - poses[0].q), axis=1)))]
        limits = _following(problem, task.arm)
        with self.stages("smooth path"):
            for bent in bent_keyframes(rows, poses, task):
                path = None if any(len(limit.failures(bent)) for limit in limits) else certified_path(bent, name, task)
                if path is not None:
                    return PlannedPath(path, replace(motion, instead=np.asarray(path.spline.c)), resumed=True)
        return None

    def _resumed(self, problem: Problem, task: SpaceTask, motion: SpaceMotion | None) -> PlannedPath | None:
        """Return the plan with the smooth path along an adapted motion; None without a motion or a certified path."""
        if motion is not None:
            with suppress(MotionNotFound), self.stages("smooth path"):
                return replace(_smoothed(problem, replace(task, follows=False), (motion,)), resumed=True)
        return None

    def _shortened(self, problem: Problem, task: SpaceTask, planned: PlannedPath) -> PlannedPath:
        """Return an adapted plan with its motion optimised in the same homotopy class, or the plan if that costs less.

        A motion that is not certified itself, as that of an arm that follows its tip, is tracked first.
        """
        hurried = task.deadline_within(_SHORTENING_SHARE * task.deadline.left)
        motion: SpaceMotion | None = planned.motion
        with self.stages("optimisation"):
            if len(task.failures(planned.motion.curve, planned.motion.unknowns)) > 0:
                motion = tracked_to(planned.motion, planned.motion.unknowns[-1], hurried)
            if motion is None or hurried.deadline.passed():
                return planned
            motion = optimise(motion, hurried, rounds=_SHORTENING_ROUNDS)
        with suppress(MotionNotFound), self.stages("smooth path"):
            other = replace(_smoothed(problem, task, (motion,)), resumed=True)
            if (gained := _cost(planned, task) - _cost(other, task)) > 0.0:
                return replace(other, shortened=gained > _SHORTENING_GAIN * _cost(planned, task))
        return planned

    def _improvable(self, problem: Problem, task: SpaceTask, planned: PlannedPath) -> PlannedPath:
        """Return a plan in space whose path has a function that optimises it further, if that may gain clearance."""
        path = planned.path
        if path.clearance_limit not in _IMPROVABLE:
            return planned
        lacking = _lacking(planned, task)
        further = partial(self._optimised_further, problem, task, planned.motion, replace(path, lacking=lacking))
        return replace(planned, path=replace(path, lacking=lacking, further=further))

    def _optimised_further(
        self, problem: Problem, task: SpaceTask, motion: SpaceMotion, path: JointPath, seconds: float
    ) -> JointPath:
        """Return a path in space with the ends of a known one and more clearance, or the known one.

        Args:
            problem: the problem.
            task: search task of the problem.
            motion: motion of the known path.
            path: the known path, with the clearance that it lacks.
            seconds: CPU time that this may take [s].
        """
        task = replace(task, deadline=Deadline.after(seconds))
        ended = replace(task.deadline_within(_FURTHER_SHARE * seconds), goal_pose=motion.configurations[-1])
        with self.stages("optimisation"):
            more = with_more_clearance(optimise(motion, ended), ended, begun=motion)
        try:
            with self.stages("smooth path"):
                smooth = _smoothed(problem, task, (more,))
        except MotionNotFound:
            return path
        ends = path.spline.c[[0, -1]]
        apart = float(np.max(np.abs(smooth.path.spline.c[[0, -1]] - ends)))
        if apart > ROUNDING or _lacking(smooth, task) > path.lacking - _GAINED:
            return path
        smooth.path.spline.c[[0, -1]] = ends
        smooth = replace(smooth, path=replace(smooth.path, goal_pose=path.goal_pose))
        return self._improvable(problem, task, smooth).path

    def _space_task(self, problem: Problem) -> tuple[Problem, SpaceTask]:
        """Return a problem in space, with the base clamped if its mount requires that, and its search task.

        Raises:
            ProblemError: the start or the goal violates a limit.
        """
        deadline = Deadline.after(_SHARE_IN_SPACE * problem.planner.time_limit)
        with self.stages("free space"):
            tree = problem.workspace.surface_tree
            problem = with_clamped_base(problem, tree)
            task = space_task(problem, tree, deadline, self.space, self.terms)
            refuse_ends(problem, task)
            # The proofs are about arms that no axes carry but a feed axis.
            task = task if problem.arm.carrier else replace(task, refuse=partial(self.refuse, problem))
        return problem, task

    def planned(self, problem: Problem, known: Sequence[Motion] = ()) -> PlannedPath:
        """Plan a certified motion in the plane and a smooth path along it.

        Args:
            problem: the problem, in units of its arm.
            known: motions for slightly different problems, of which the nearest is adapted; a new motion is searched
                for if there is none or it cannot be adapted.

        Raises:
            NoPlanFound: no motion was found; gives the reason and advice.
        """
        deadline = Deadline.after(_SHARE_IN_THE_PLANE * problem.planner.time_limit)
        with self.stages("mapping"):
            ends = resolve_ends(problem)
            if self.user is not None:
                self.user.refuse_ends(ends.start, ends.goal_pose)
            near = neighbourhood(problem, ends)

        # Routes and guesses of goal poses, then the certified motion of the links, then the smooth path along it.
        end_poses = EndPoses(near, ends, self.stages, self.terms, self.plane.goal_pose)
        nearest = nearest_known(known, problem)
        if nearest is not None:
            with self.stages("motion"):
                task = replace(self.task_without_routes(near, ends, deadline), end_poses=end_poses)
                motion = resumed(nearest, replace(task, deadline=deadline.within(_ADAPTING_SHARE * deadline.left)))
                if motion is not None:
                    path = joint_path(task, motion)
                    path = replace(path, goal_pose=end_poses.record(motion.end_pose))
                    return PlannedPath(path, motion, resumed=True)
        strategies = SAMPLERS if self.sampled else STRATEGIES
        if problem.arm.base_axes:
            task = self.task_without_routes(problem, ends, deadline)
            task = replace(task, refuse=partial(self.refuse, problem))
            strategies = fed_strategies(problem, self.shape_change)
        else:
            task = replace(self.motion_task(near, ends, deadline, problem), end_poses=end_poses)
        with self.stages("motion"):
            motion = find_motion(task, strategies)
            path = joint_path(task, motion)
        return PlannedPath(replace(path, goal_pose=end_poses.record(motion.end_pose)), motion)

    def motion_task(self, problem: Problem, ends: Ends, deadline: Deadline, asked: Problem | None = None) -> MotionTask:
        """Return the search task for a motion between ends that are already resolved.

        Args:
            problem: the problem, perhaps with only the walls of the neighbourhood.
            ends: the ends of the motion.
            deadline: deadline of the search.
            asked: the problem with all its original walls, for proofs; None if it is ``problem``.

        Raises:
            NoPlanFound: there is no route, and a proof that there can be none.
        """
        with self.stages("free space"):
            room = route_room(problem, ends)
            routes = find_routes(problem, ends, room) if ends.goal_pose is None else ()
            tip_paths = tip_paths_along(problem, ends, routes, room)
            if not tip_paths:
                self.refuse(problem if asked is None else asked)
        # Without a goal for the whole arm, the only available proof has already been tried above.
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
        """Return the search task without guesses and tip paths, for callers that already know a motion.

        Args:
            problem: the problem.
            ends: the ends of the motion.
            deadline: deadline of the search.
        """
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
            held=_limits_of_feed(arm, problem),
            # In this space, travel of the base is weighted by the time that it takes.
            fed_space=FedSpace.of_arm(arm, turn_per_link(problem)) if arm.base_axes else None,
            settings=replace(settings.motion, certificate=certificate_settings(problem, settings.motion.certificate)),
        )

    def shape_change(self, problem: Problem, ends: Ends, deadline: Deadline) -> Motion:
        """Return a motion of an arm on a fixed base, such as the part beyond the feed axis's hole, without user terms.

        Args:
            problem: problem of this arm.
            ends: the ends of the motion.
            deadline: deadline of the search.

        Raises:
            NoPlanFound: no motion was found.
        """
        return find_motion(MotionPlanner(plane=self.plane).motion_task(problem, ends, deadline))

    def _in_stage(self, configurations: Iterator[FloatArray]) -> Iterator[FloatArray]:
        """Yield the given configurations (c,), and record the time that each takes as the stage "configuration"."""
        while True:
            with self.stages("configuration"):
                found = next(configurations, None)
            if found is None:
                return
            yield found

    # ------------------------------------------------------------ in space
    @property
    def _ways(self) -> tuple[Strategy[SpaceRun, SpaceMotion], ...]:
        return SAMPLED_WAYS if self.sampled else WAYS

    def _planned(self, problem: Problem, task: SpaceTask) -> _Planned:
        """Return the optimised motion in space and those from which it was made, with the record of the goal pose.

        These are kept because their smooth paths may be certified if that of the shorter, optimised motion lacks
        clearance. If the arm can simply follow its tip, only that motion and its path are returned.

        Raises:
            NoPlanFound: no motion was found.
        """
        with self.stages("motion"):
            found = find_by_ways(task, self._ways)
        with self.stages("configuration"):
            ending = ended_by_nlp(problem, task, found)
            motion = tracked(task, ending.motion)
        if task.follows:
            with self.stages("smooth path"):
                path = path_behind_tip(_bounded(problem, task), motion, optimised=False)
            if path is not None:
                return _Planned((motion,), ending.record, path)
        with self.stages("optimisation"):
            ended = ending.task
            ended = replace(ended, deadline=ended.deadline.within(_OPTIMISATION_SHARE * ended.deadline.left))
            optimised = optimise(motion, ended)
            roomy = with_more_clearance(optimised, ended, begun=motion)
        # Motions that are tied to the path parameter differ from the one that was found.
        before = (optimised, motion, found) if motion.u is None else (optimised, motion)
        return _Planned((roomy, *(each for each in before if each is not roomy)), ending.record)

    def _along_path(self, problem: Problem, path: FloatArray) -> JointPath:
        """Return the motion in space whose tip follows the goal's path, shape (m, 3) [m].

        Raises:
            ProblemError: something else is asked for that such a motion does not take into account.
            NoPlanFound: the arm cannot follow the path.
        """
        if self.terms is not None or self.sampled or problem.planner.retiming == "paul":
            raise ProblemError(
                "goal.path fixes the motion: leave out constraints, costs, the method rrt-connect and the retiming paul"
            )
        if problem.arm.rigid_bodies:
            whole, back = bodies_as_links(problem)
            return self._along_path(whole, path).mapped(back)
        task = self._space_task(problem)[1]
        with self.stages("motion"):
            return motion_along(task, path, problem.tolerances.position, problem.planner.follow_within)

    def _refined(self, problem: Problem, task: SpaceTask) -> _Planned | None:
        """Return the motion in space of an arm with many links, planned with few links and then refined, or None.

        The result is None if the task is to be planned with its own links (see ``nominal_task``), or if planning or
        refinement fails.
        """
        few = nominal_task(task)
        if few is None:
            return None
        try:
            planned = self._planned(coarse_problem(problem, few), replace(few, refuse=lambda: None, follows=False))
        except NoPlanFound:
            return None
        with self.stages("lifting"):
            refined = refine_space_motion(task, planned.motions[0])
        return None if refined is None else replace(planned, motions=(refined,))


def _following(problem: Problem, arm: Arm) -> tuple[FollowingLimit, ...]:
    """Return the limit on how far the arm may deviate from the path of its tip; none unless the problem sets one."""
    within = problem.planner.follow_within
    return () if within is None else (FollowingLimit(arm, within),)


def _bounded(problem: Problem, task: SpaceTask) -> SpaceTask:
    """Return the task with the limit, if any, on how far the arm may deviate from the path of its tip."""
    return replace(task, held=(*task.held, *_following(problem, task.arm)))


def _cost(planned: PlannedPath, task: SpaceTask) -> float:
    """Return a measure of the cost of a path in space by its duration and clearance; see ``clearance_cost``."""
    lack = float(np.max(task.clearance_shortfall(planned.path.keyframes), initial=0.0)) / max(task.wanted_gap, TINY)
    return clearance_cost(travel_time(planned.path.keyframes, task), lack)


def _lacking(planned: PlannedPath, task: SpaceTask) -> float:
    """Return how much of the preferred clearance a path lacks more than at its worse end, as a fraction of it."""
    looks = np.linspace(0.0, 1.0, _LOOKS * len(planned.motion.unknowns) + 1)
    return task.shortfall_on_the_way(np.asarray(planned.path.spline(looks))) / task.wanted_gap


def _smoothed(
    problem: Problem, task: SpaceTask, motions: tuple[SpaceMotion, ...], *, limited: bool = True
) -> PlannedPath:
    """Return the follow-the-leader path, if any, or the smooth path along the first motion that has a certified one.

    Args:
        problem: the problem.
        task: its search task.
        motions: certified motions, in order of preference.
        limited: whether to find out what limits the clearance of the path.

    Raises:
        MotionNotFound: no path can be certified.
    """
    bounded = _bounded(problem, task)
    behind = path_behind_tip(bounded, motions[0], optimised=True) if task.follows else None
    if behind is not None:
        return PlannedPath(behind, motions[0])
    limits = _following(problem, task.arm)
    kept = [motion for motion in motions if not any(len(limit.failures(motion.configurations)) for limit in limits)]
    if not kept:
        raise MotionNotFound(not_behind_tip(task, limits[0], motions[0]))
    for motion in kept:
        try:
            path = joint_path(bounded, motion, legs=problem.planner.retiming == "paul")
        except MotionNotFound:
            if motion is kept[-1]:
                raise
            continue
        if motion is kept[0]:
            path = path if not limited else replace(path, clearance_limit=clearance_limit(motion, bounded))
        else:
            path = with_clearance_limit(path, "smooth path", bounded)
        break
    return PlannedPath(path, motion)


def _limits_of_feed(arm: Arm, problem: Problem) -> tuple[LimitOf[Any], ...]:
    """Return the limits of a planar arm on a feed axis (guide tube, following its tip); none if the base is fixed."""
    if not arm.base_axes:
        return ()
    tube = GuideTubeLimit(arm, travel_between_samples(arm, problem.limits))
    return (tube, *_following(problem, arm))


def _nothing_proved_of(_: Problem) -> None:
    """Raise no error: nothing is proved of a problem."""


def _nothing_proved() -> None:
    """Raise no error: there is no proof of unreachability to try."""


def certificate_settings(problem: Problem, settings: CertificateSettings) -> CertificateSettings:
    """Return certificate settings with the contact tolerance set to a fraction of the problem's."""
    return replace(settings, contact=_CONTACT_SHARE * problem.contact_tolerance)


def slowness(problem: Problem) -> JointSlowness:
    """Return the cost of moving each joint and the base of a planar arm, from velocity and acceleration limits.

    Planar bends are rotations about the second of the three axes that the limits list for each joint.
    """
    limits = problem.limits
    speeds, accelerations = limits.velocity[1::3], limits.acceleration[1::3]
    if problem.arm.base_axes:
        per_turn = turn_per_link(problem) / problem.arm.link_length  # rad a metre
        speeds = np.append(speeds, per_turn * (limits.feed_velocity or 1.0))
        accelerations = np.append(accelerations, per_turn * (limits.feed_acceleration or 1.0))
    return JointSlowness.from_limits(speeds, accelerations)


def turn_per_link(problem: Problem) -> float:
    """Return the turn of a joint at the mean speed limit while the base travels one link length at its own [rad]."""
    speed = problem.limits.feed_velocity or 1.0
    return float(problem.limits.velocity[1::3].mean() * problem.arm.link_length / speed)
