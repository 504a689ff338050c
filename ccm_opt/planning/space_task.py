"""The task of a motion in space."""

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis
from ccm_opt.core.length_words import short_length
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.curve_map import CurveMap
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.limits.limit import LimitOf
from ccm_opt.planning.limits.limit_stack import ContactLimit, FeedLimit, assembled_limits, within_limits
from ccm_opt.planning.limits.motion_certificate import MotionCertificate
from ccm_opt.planning.limits.surface_rows import distance_lacking, motion_rows, room_lacking
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.optimisation.interval_rows import Sweep
from ccm_opt.planning.optimisation.objective import normalised
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.space_certificate import SpaceCertificate
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.planning.via_places import PassedPlaces, first_violation
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.contact_finder import SurfaceFinder, nearest_links
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_LEAD = 0.04
"""Of the path parameter, by which planning keeps a constraint before and behind its interval; taste."""
_PATH_SAMPLES = 4
"""Of a span of a path at which it is looked whether the tip passes its places."""
_PASSING = 0.5
"""How near the tip stays to the places that it passes, as a share of what counts as passing."""
_ROW_MARGIN = 0.02
"""Gap that rows of the optimisation ask for beyond contact [u]."""
_ROW_SEEN = 0.3
"""Rows nearer to their bound than this enter its QP [u]."""
_GROUPS = 24
"""Arms with more links than this have rows for groups of neighbouring joints."""
_REACH = 0.35
"""Gap beyond that from which on surfaces, and links from each other, are left out of a step [u]."""
_MARGIN = 0.06
"""Gap that steps keep beyond contact [u]."""
_LEAST_SPARE = 1.2e-5
"""The same where a start or a goal of the whole arm has no more than twice as much [u]; measured: a straight arm of a
metre is lifted off a table 1.5 µm below it, and hardly off one at 1 µm."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SpaceTask(SearchTask):
    """One motion to be found in space; configurations are bends [rad], and then the base's way [m].

    Attributes:
        tree: of the surfaces of the scene.
        via_reach: how near the tip has to come to pass them [m].
        clearance: gap that the user asks for beyond the arm's radius [m].
        box: where the tip may go, lower and upper corner, shape (2, 3) [m].
        scene: extent of all surfaces, lower and upper corner, shape (2, 3) [m]; empty where there are none.
        names: of the owners of surfaces.
        slowness: how dear a unit of each coordinate is, by the speed that it allows, shape (c,); of bends about 1.
        settings: numbers of the search.
        stage: curve and unknowns, shape (p,), that a longer motion has come to; None where it begins at the start.
    """

    tree: SurfaceTree
    via_reach: float
    clearance: float
    box: FloatArray
    scene: FloatArray
    names: tuple[str, ...]
    slowness: FloatArray
    settings: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    stage: tuple[CurveMap, FloatArray] | None = None

    @property
    def kept(self) -> float:
        """Distance from the arm's axis that walls have to keep [m]."""
        return self.arm.radius + self.clearance

    @property
    def advice(self) -> str:
        """What may help where nothing better is known."""
        return "add goal.via places on the way"

    @property
    def unit(self) -> float:
        """u, length of a nominal link [m]."""
        return self.arm.length / NOMINAL_LINKS

    def deadline_within(self, seconds: float) -> "SpaceTask":
        """Return the same task with a deadline after so much CPU time from now on, or its own if that is earlier."""
        return replace(self, deadline=self.deadline.within(seconds))

    @cached_property
    def contact_certificate(self) -> SpaceCertificate:
        """Of contact; it spares a little gap for what the path between samples may use."""
        return SpaceCertificate(self.arm, self.tree, self.clearance + self.spare, self.spare, self.settings.certificate)

    @cached_property
    def certificate(self) -> MotionCertificate:
        """The certificate of all limits that motions must pass."""
        return MotionCertificate(self.arm, self.spare, self.limits(self.finder(0.0, 0.0)))

    def finder(self, margin: float, reach: float) -> SurfaceFinder:
        """Return a finder of contacts, beyond what is proved, with a planning margin and a reach [m]."""
        return SurfaceFinder(self.arm, self.tree, self.names, self.contact_certificate.gap, margin, reach)

    def limits(self, finder: SurfaceFinder, wanted_gap: float = 0.0) -> tuple[LimitOf[Any], ...]:
        """All limits of the motion, contact by a finder's margin and reach, and by a gap that is asked for [m]."""
        rows = partial(motion_rows, finder=finder)
        contact = ContactLimit(finder, self.contact_certificate, self.settings.step, rows, wanted_gap)
        feed = (FeedLimit(),) if self.arm.base_axes else ()
        return assembled_limits(self.arm, contact, self.settings.step, (*feed, *self.user_limits, *self.held))

    @cached_property
    def spare(self) -> float:
        """Gap that is proved beyond the clearance: as asked, or half of what there is where the motion ends [m]."""
        most = self.settings.certificate.spare * self.unit
        ends = (self.start,) if self.goal_pose is None else (self.start, self.goal_pose)
        room = min(self._room(q, 2.0 * most) for q in ends)
        return most if room >= most else max(0.5 * room, self.least_spare)

    @property
    def least_spare(self) -> float:
        """No smaller gap is proved [m]."""
        return _LEAST_SPARE * self.unit

    def _room(self, q: FloatArray, most: float) -> float:
        """Return the least gap of a configuration beyond the clearance, or between its links, up to so much [m]."""
        arm = self.arm
        points = arm.joint_positions_at(q)
        _, axes = arm.exposed_links(points)
        reach = self.kept + most
        room = float(np.min(self.tree.distances(axes, reach), initial=reach)) - self.kept
        if arm.self_collision:
            nearest = nearest_links(arm, points[None], 2.0 * arm.radius + most)
            room = min(room, float(nearest.distance[0]) - 2.0 * arm.radius)
        return room

    @property
    def margin(self) -> float:
        """Gap that steps keep beyond the clearance [m]."""
        return _MARGIN * self.unit

    def program(self, motion: SpaceMotion, margin: float | None = None) -> MotionProgram[Sweep]:
        """Return the program of optimising a motion, its keyframes still to be chosen."""
        kept = _ROW_MARGIN * self.unit if margin is None else margin * self.arm.length
        goal = self.limited_goal
        exact = moved_onto(motion.curve, goal, motion.curve.pose(motion.unknowns[-1]))
        # The last keyframe stays where no tip counts, or limits keep it a little off its goal.
        on_goal = goal.on_goal(exact) and goal.limits_met(exact) and within_limits(self.arm, exact.q)
        passed = (PassedPlaces(np.stack(self.via), _PASSING * self.via_reach),) if self.via else ()
        return MotionProgram(
            curve=motion.curve,
            sweep=partial(Sweep, motion.curve),
            limits=(*self.limits(self.finder(kept, _ROW_SEEN * self.unit), self.wanted_gap), *passed),
            failures=partial(self.failures, motion.curve),
            goal=goal,
            end_fixed=self.goal_pose is not None or not on_goal,
            u=np.zeros(0),
            deadline=self.deadline,
            weights=normalised(self.weights),
            wanted_gap=self.wanted_gap,
            seen=_ROW_SEEN * self.unit,
            groups=_GROUPS,
            steps=self.settings.optimisation.steps,
            scale=self.slowness,
            lack=self._lack,
        )

    def _lack(self, sweep: Sweep) -> float:
        """Return the room that a motion lacks over all its intervals, in nominal links."""
        return float(np.sum(room_lacking(sweep, self.finder(0.0, 0.0), self.wanted_gap))) / self.unit

    def room_lacking(self, q: FloatArray) -> FloatArray:
        """Return by how much configurations, shape (k, c), lack the wanted room, shape (k,) [m]."""
        return distance_lacking(self.arm, self.tree, self.arm.joint_positions_at(q), self.kept + self.wanted_gap)

    def free(self, q: FloatArray) -> FloatArray:
        """Return the 1 for what a knot may move, 0 for joints that are clamped, shape (c,); the base is fixed."""
        return (np.arange(len(q)) >= self.arm.bends_a_joint * self.arm.clamped_joints).astype(np.float64)

    def keyframes_along(
        self, keyframes: FloatArray, spline: BSpline, *, legs: bool
    ) -> tuple[FloatArray, BSpline, tuple[Configuration, ...]]:
        """Return the path as it is.

        Drawn in the unknowns, that of a fed arm may pass configurations of the motion by.
        """
        if self.arm.base_axes and not legs:
            keyframes = np.asarray(spline(np.linspace(0.0, 1.0, len(keyframes))))
        return keyframes, spline, ()

    def violated_place(self, spline: BSpline) -> Diagnosis | None:
        """Return which place the tip does not pass on a path, in words; None where it passes all."""
        if not self.via:
            return None
        spans = len(spline.t) - 2 * spline.k - 1
        u = np.linspace(0.0, 1.0, spans * _PATH_SAMPLES + 1)
        tips = self.arm.joint_positions_at(np.asarray(spline(u)))[:, -1]
        missed = first_violation(tips, np.stack(self.via), self.via_reach)
        if missed is None:
            return None
        number, away = missed
        reason = (
            f"the tip comes within {short_length(away)} of goal.via {number + 1}, "
            f"{short_length(away - self.via_reach)} too far off to pass it"
        )
        return Diagnosis(reason, "motion", ("move the place to where an arm as long and stiff as this can pass it",))

    def stepper(self, curve: CurveMap, margin: float = 1.0) -> SpaceStepper:
        """Return the takes steps in the unknowns of a curve, with a share of the margin."""
        gap = margin * self.margin
        return SpaceStepper(curve, self.limits(self.finder(gap, gap + _REACH * curve.nominal_length)), self.settings)


def reach_box(arm: Arm, bounds: FloatArray | None) -> FloatArray:
    """Corners of where any of the arm can be: within the arm's length of its base, and in the room, (2, d) [m]."""
    low, high = arm.base_range
    return _box_about(arm, low, high, arm.length, bounds)


def tip_box(arm: Arm, bounds: FloatArray | None) -> FloatArray:
    """Return the corners of where the tip can be, (2, 3) [m].

    An arm is straight in its guide tube and turns about its end.
    """
    low, high = arm.base_range
    if not arm.base_axes:
        return reach_box(arm, bounds)
    first = max(low, arm.hole)
    return _box_about(arm, first, max(first, high), arm.length - max(first - high, 0.0), bounds)


def _box_about(arm: Arm, low: float, high: float, reach: float, bounds: FloatArray | None) -> FloatArray:
    """Return the corners of what is within reach of a part of the line of the base, and in the room, (2, d) [m]."""
    ends = arm.base + np.outer([low, high], arm.direction)
    box = np.stack((ends.min(axis=0) - reach, ends.max(axis=0) + reach))
    if bounds is None:
        return box
    return np.stack((np.maximum(box[0], bounds[0]), np.minimum(box[1], bounds[1])))


def space_task(
    problem: Problem,
    tree: SurfaceTree,
    deadline: Deadline,
    settings: SpaceMotionSettings,
    terms: UserTerms | None = None,
) -> SpaceTask:
    """Return what the search is asked for a problem.

    Args:
        problem: with one goal.
        tree: of its surfaces.
        deadline: when to stop.
        settings: numbers of the search.
        terms: the user's constraints and costs, or None.
    """
    arm = problem.arm
    goal = problem.goal
    goal_pose = goal.whole(arm)
    if goal_pose is not None:
        tip = GoalPose(arm.joint_positions_at(goal_pose)[-1], arm.link_rotations(goal_pose)[-1][:, 0])
    else:
        # Half of the tolerances is left to what comes after planning.
        near_enough = (0.5 * problem.tolerances.position, 0.5 * problem.tolerances.heading)
        tip = GoalPose(goal.tip(arm), goal.direction, near_enough=near_enough)
    return SpaceTask(
        arm=arm,
        tree=tree,
        start=problem.start.configuration(arm),
        goal=tip,
        goal_pose=goal_pose,
        via=goal.via,
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
        user=None if terms is None else UserLimit(terms, lead=_LEAD),
        optimiser=problem.planner.optimiser,
        weights=problem.planner.weights,
    )


def coarse_problem(problem: Problem, few: SpaceTask) -> Problem:
    """Return the problem as the search for nominal links sees it; torques are left to the arm itself."""
    limits = problem.limits
    revolutes = 3 * few.arm.links
    return replace(
        problem,
        arm=few.arm,
        workspace=replace(problem.workspace, clearance=few.clearance),
        planner=replace(problem.planner, wanted_gap=few.wanted_gap),
        start=JointPose.from_configuration(few.start, few.arm.coordinates),
        limits=replace(
            limits,
            velocity=limits.velocity[:revolutes],
            acceleration=limits.acceleration[:revolutes],
            torque=None,
            jerk=None,
        ),
    )


def slowness(problem: Problem) -> FloatArray:
    """How dear a unit of each coordinate is: the usual speed of a bend over that of the coordinate, shape (c,)."""
    arm = problem.arm
    speeds = problem.limits.of_coordinates(arm.coordinates).velocity
    usual = float(np.median(speeds[: 2 * arm.links]))
    # A feed without a limit counts as one that goes a nominal link while a joint bends by a radian.
    speeds = np.where(np.isfinite(speeds), speeds, usual * arm.length / NOMINAL_LINKS)
    return np.asarray(usual / speeds)
