"""Search task of a motion in space: arm, surfaces, start, goal and limits, with the certificates built from them."""

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
from ccm_opt.planning.ends import tip_goal
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.limits.limit import LimitOf
from ccm_opt.planning.limits.limit_stack import AxisLimit, ContactLimit, FeedLimit, assembled_limits, within_limits
from ccm_opt.planning.limits.motion_certificate import MotionCertificate
from ccm_opt.planning.limits.surface_rows import clearance_shortfall, distance_shortfall, motion_rows
from ccm_opt.planning.limits.user_limit import UserLimit
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.optimisation.interval_rows import Sweep
from ccm_opt.planning.optimisation.objective import normalised
from ccm_opt.planning.optimisation.sequential_convex import MotionProgram
from ccm_opt.planning.search import SearchTask
from ccm_opt.planning.settings import SpaceMotionSettings
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.planning.surface_certificate import SpaceCertificate
from ccm_opt.planning.via_places import PassedPlaces, first_violation
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.contact_finder import SurfaceFinder, nearest_links
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_LEAD = 0.04
"""Extension, in units of the path parameter, on both sides of the interval in which planning applies a user's
constraint. Heuristic."""
_PATH_SAMPLES = 4
"""Number of samples per span of a path at which the distance of the tip from its via points is checked."""
_PASSING = 0.5
"""Distance within which planning makes the tip pass its via points, as a fraction of the distance that counts as
passing."""
_ROW_MARGIN = 0.02
"""Gap beyond contact that the contact constraints of the optimisation require, in nominal links."""
_ROW_SEEN = 0.3
"""Distance to its bound below which a contact constraint enters the QP of the optimisation, in nominal links."""
_GROUPS = 24
"""Number of links above which the optimisation has one contact constraint per group of neighbouring joints."""
_REACH = 0.35
"""Gap beyond the margin above which surfaces, and pairs of links, are left out of a step, in nominal links."""
_MARGIN = 0.06
"""Gap that steps keep beyond contact, in nominal links."""
_LEAST_SPARE = 1.2e-5
"""Certified gap beyond the required clearance if the start or the goal is hardly clear of contact, in nominal
links. Measured: a straight
arm of one metre can be raised off a table 1.5 µm below the arm, and hardly off one 1 µm below."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SpaceTask(SearchTask):
    """Inputs of the search for a motion in space.

    Configurations are bends [rad], followed by the positions of the axes that carry the base [m, rad].

    Attributes:
        tree: distance tree of the surfaces of the scene.
        via_reach: distance within which the tip has to pass a via point [m].
        clearance: gap that the user requires beyond the arm's radius [m].
        box: box in which the tip may be, lower and upper corner, shape (2, 3) [m].
        scene: extent of all surfaces, lower and upper corner, shape (2, 3) [m]; empty without surfaces.
        names: names of the objects to which the surfaces belong.
        slowness: cost of a unit of each coordinate, from its speed limit, shape (c,); about 1 for bends.
        follows: whether the arm may be led along the path of its tip, whichever motion to the goal is found.
        settings: settings of the search.
        knots: number of knots of the curve; None if any number suits.
        stage: curve and unknowns, shape (p,), from which a longer motion continues; None if the motion begins at the
            start.
    """

    tree: SurfaceTree
    via_reach: float
    clearance: float
    box: FloatArray
    scene: FloatArray
    names: tuple[str, ...]
    slowness: FloatArray
    follows: bool = False
    settings: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    knots: int | None = None
    stage: tuple[CurveMap, FloatArray] | None = None

    @property
    def kept(self) -> float:
        """Required distance of surfaces from the centre line of the last link: its radius plus the clearance [m]."""
        return self.arm.tip_radius + self.clearance

    @property
    def advice(self) -> str:
        """Advice to the user if no motion is found and nothing more specific is known."""
        return "add goal.via: places that the tip passes on its way (not tried)"

    @property
    def unit(self) -> float:
        """Length of a nominal link, a twenty-fourth of the arm's length [m]."""
        return self.arm.length / NOMINAL_LINKS

    def deadline_within(self, seconds: float) -> "SpaceTask":
        """Return the task with a deadline ``seconds`` of CPU time from now, or its present one if that is earlier."""
        return replace(self, deadline=self.deadline.within(seconds))

    @cached_property
    def contact_certificate(self) -> SpaceCertificate:
        """Certificate against contact, with a small extra gap in reserve for the path between samples."""
        return SpaceCertificate(self.arm, self.tree, self.clearance + self.spare, self.spare, self.settings.certificate)

    @cached_property
    def certificate(self) -> MotionCertificate:
        """Certificate of all limits, which every motion must pass."""
        return MotionCertificate(self.arm, self.spare, self.limits(self.finder(0.0, 0.0)))

    def finder(self, margin: float, reach: float) -> SurfaceFinder:
        """Return a finder of contacts; its planning margin and search distance are beyond the certified gap [m]."""
        return SurfaceFinder(self.arm, self.tree, self.names, self.contact_certificate.gap, margin, reach)

    def limits(self, finder: SurfaceFinder, wanted_gap: float = 0.0) -> tuple[LimitOf[Any], ...]:
        """Return all limits of the motion.

        Args:
            finder: finder of contacts, with the planning margin and search distance of the contact limit.
            wanted_gap: preferred gap beyond contact [m].
        """
        rows = partial(motion_rows, finder=finder)
        contact = ContactLimit(finder, self.contact_certificate, self.settings.step, rows, wanted_gap)
        axes = () if not self.arm.base_axes else (AxisLimit() if self.arm.feed is None else FeedLimit(),)
        return assembled_limits(self.arm, contact, self.settings.step, (*axes, *self.user_limits, *self.held))

    @cached_property
    def spare(self) -> float:
        """Certified gap beyond the required clearance [m].

        It is the gap of the settings, or half of the least gap at the start and at a whole-arm goal if that is smaller,
        but at least ``least_spare``.
        """
        most = self.settings.certificate.spare * self.unit
        ends = (self.start,) if self.goal_pose is None else (self.start, self.goal_pose)
        room = min(self._room(q, 2.0 * most) for q in ends)
        return most if room >= most else max(0.5 * room, self.least_spare)

    @property
    def least_spare(self) -> float:
        """Lower bound of ``spare``, the certified gap beyond the required clearance [m]."""
        return _LEAST_SPARE * self.unit

    def _room(self, q: FloatArray, most: float) -> float:
        """Return the least gap of a configuration (c,) to surfaces and between links, capped at ``most`` [m].

        The clearance is already subtracted from gaps to surfaces, so that the result may be negative.
        """
        arm = self.arm
        points = arm.joint_positions_at(q)
        first, axes = arm.exposed_links(points)
        kept = arm.radii[first:] + self.clearance
        reach = arm.radius + self.clearance + most
        room = float(np.min(self.tree.distances(axes, reach) - kept, initial=most))
        if arm.self_collision:
            room = min(room, float(nearest_links(arm, points[None], most).gap[0]))
        return room

    @property
    def margin(self) -> float:
        """Gap that steps keep beyond the clearance [m]."""
        return _MARGIN * self.unit

    def program(self, motion: SpaceMotion, margin: float | None = None) -> MotionProgram[Sweep]:
        """Return the optimisation problem for a motion: limits, goal and weights, without its keyframes.

        Args:
            motion: certified motion.
            margin: gap beyond contact that constraints require, as a fraction of the arm's length; the default if None.
        """
        kept = _ROW_MARGIN * self.unit if margin is None else margin * self.arm.length
        goal = self.limited_goal
        exact = moved_onto(motion.curve, goal, motion.curve.pose(motion.unknowns[-1]))
        # The last keyframe is fixed for a goal of the whole arm, or where limits keep it a little off its goal.
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
            row_reach=_ROW_SEEN * self.unit,
            groups=_GROUPS,
            steps=self.settings.optimisation.steps,
            scale=self.slowness,
            shortfall=self._shortfall,
        )

    def _shortfall(self, sweep: Sweep) -> float:
        """Return the shortfall of a motion from the preferred clearance, in nominal links.

        The shortfall is averaged over the parts of each interval and summed over the intervals.
        """
        shortfall = clearance_shortfall(sweep, self.finder(0.0, 0.0), self.wanted_gap)
        return float(np.sum(shortfall)) / (self.unit * sweep.parts)

    def clearance_shortfall(self, q: FloatArray) -> FloatArray:
        """Return the shortfall of configurations (k, c) from the preferred clearance, at least 0, shape (k,) [m]."""
        kept = self.arm.radii + self.clearance + self.wanted_gap
        return distance_shortfall(self.arm, self.tree, self.arm.joint_positions_at(q), kept)

    def free(self, q: FloatArray) -> FloatArray:
        """Return 1.0 for each coordinate of a configuration (c,) that may change, 0.0 for clamped joints, (c,)."""
        return (np.arange(len(q)) >= self.arm.bends_a_joint * self.arm.clamped_joints).astype(np.float64)

    def keyframes_along(
        self, keyframes: FloatArray, spline: BSpline, *, legs: bool
    ) -> tuple[FloatArray, BSpline, tuple[Configuration, ...]]:
        """Return keyframes that lie on a smooth path (K, c), the unchanged path, and an empty tuple of curves.

        The path of a fed arm is built in the unknowns and may bypass the keyframes of the motion, which are therefore
        sampled anew from the path.

        Args:
            keyframes: configurations at the keyframes of the motion, shape (K, c).
            spline: smooth path of configurations.
            legs: whether the path consists of straight legs between the keyframes.
        """
        if self.arm.feed is not None and not legs:
            keyframes = np.asarray(spline(np.linspace(0.0, 1.0, len(keyframes))))
        return keyframes, spline, ()

    def violated_place(self, spline: BSpline) -> Diagnosis | None:
        """Return a diagnosis of the first via point that the tip misses on a path, or None if all are passed."""
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
            f"the tip passes goal.via {number + 1} at a distance of {short_length(away)}, of "
            f"{short_length(self.via_reach)} allowed"
        )
        return Diagnosis(reason, "motion", ("move the place to where an arm as long and stiff as this can pass it",))

    def stepper(self, curve: CurveMap, margin: float = 1.0) -> SpaceStepper:
        """Return the solver of QP steps in the unknowns of a curve; ``margin`` is a fraction of the planning margin."""
        gap = margin * self.margin
        return SpaceStepper(curve, self.limits(self.finder(gap, gap + _REACH * curve.nominal_length)), self.settings)


def reach_box(arm: Arm, bounds: FloatArray | None) -> FloatArray:
    """Return the corners of a box that contains the arm in any pose, clipped to bounds (2, d) if given, (2, d) [m]."""
    low, high = arm.base_range
    return _box_about(arm, low, high, arm.length + (0.0 if arm.feed else arm.base_travel), bounds)


def tip_box(arm: Arm, bounds: FloatArray | None) -> FloatArray:
    """Return the corners of a box that contains the tip in any pose, clipped to bounds (2, 3) if given, (2, 3) [m].

    An arm on a feed axis is straight in its guide tube and turns only beyond the end of the tube.
    """
    low, high = arm.base_range
    if arm.feed is None:
        return reach_box(arm, bounds)
    first = max(low, arm.hole)
    return _box_about(arm, first, max(first, high), arm.length - max(first - high, 0.0), bounds)


def _box_about(arm: Arm, low: float, high: float, reach: float, bounds: FloatArray | None) -> FloatArray:
    """Return the box of all points within ``reach`` of a section of the feed axis, clipped to bounds, (2, d) [m].

    Args:
        arm: the arm.
        low: first position of the section on the axis [m].
        high: last position of the section [m].
        reach: distance from the section [m].
        bounds: lower and upper corner of the bounds, shape (2, d) [m], or None.
    """
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
    """Return the search task of a problem in space.

    Args:
        problem: problem with one goal.
        tree: distance tree of the surfaces of the workspace.
        deadline: time at which the search stops.
        settings: settings of the search.
        terms: compiled constraints and costs of the user, or None.
    """
    arm = problem.arm
    goal = problem.goal
    options = problem.planner
    goal_pose = goal.whole(arm)
    if goal_pose is not None:
        tip = GoalPose(arm.joint_positions_at(goal_pose)[-1], arm.link_rotations(goal_pose)[-1][:, 0])
    else:
        assert goal.for_tip is not None  # noqa: S101 - a goal is for the tip or for all joints
        tip = tip_goal(problem, goal.for_tip)
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
        scene=problem.workspace.extent if len(problem.workspace.triangle_soup) else np.zeros((0, 3)),
        names=problem.workspace.triangle_soup.names,
        slowness=slowness(problem),
        follows=arm.feed is not None
        and arm.drives is None
        and terms is None
        and options.optimiser != "none"
        and options.retiming != "paul",
        deadline=deadline,
        seed=problem.planner.seed,
        settings=settings,
        user=None if terms is None else UserLimit(terms, lead=_LEAD),
        optimiser=problem.planner.optimiser,
        weights=problem.planner.weights,
    )


def coarse_problem(problem: Problem, few: SpaceTask) -> Problem:
    """Return a problem for the arm with few links of a task, without torque and jerk limits.

    Those limits only apply to the arm with all its links.

    Args:
        problem: problem of the arm with many links.
        few: search task with few links.
    """
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
    """Return the cost of a unit of each coordinate: median speed limit of the bends over its own speed limit, (c,)."""
    arm = problem.arm
    speeds = problem.limits.of_coordinates(arm.coordinates).velocity
    usual = float(np.median(speeds[: 2 * arm.links]))
    # An axis without a speed limit is taken to travel a nominal link while a joint bends by a radian.
    speeds = np.where(np.isfinite(speeds), speeds, usual * arm.length / NOMINAL_LINKS)
    return np.asarray(usual / speeds)
