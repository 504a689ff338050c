"""Random poses at the goal, trees and swings between poses.

A curled arm sweeps its surroundings wherever its base turns it, while a straight one passes whatever it can point past.
So trees that hardly ever meet between two curled poses meet soon between the same poses unbent.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.rrt_connect import ConnectSearch, PointTree
from ccm_opt.planning.sampled_motions import SampledMotions
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_DRAWS = 200
"""Most random poses that are brought onto the goal."""
POLISH_TURN = 0.3
"""Largest turn of a link in a step of Newton's method onto the goal [rad]."""

_STEPS = 40
"""Most steps of a random pose towards the goal."""


_SHAPES = 2000
"""Smooth shapes sampled at once; those of them that are free and nearest to the goal are brought onto it."""
_NEAREST = 30
"""Number of free shapes, nearest to the goal first, that are brought onto it."""
_CONTROLS = (3, 9)
"""Number of control values between which the curvature of a smooth shape is linear: least, and one more than most."""
_BENT = 0.7
"""Largest standard deviation of the curvature at a control, as a share of what the joints can do. Measured on two
confined scenes: with half as much trees take twice as long."""


def goal_poses(task: SpaceTask, stepper: SpaceStepper, rng: np.random.Generator) -> Iterator[Pose]:
    """Yield poses at the goal that touch nothing and keep the joint limits.

    They are sampled until the deadline passes or the number of samples is used up.

    Args:
        task: task with a goal for the tip.
        stepper: stepper in whose unknowns the poses are given.
        rng: random generator.
    """
    goal = task.limited_goal
    for _ in range(_DRAWS):
        if task.deadline.passed():
            return
        pose = _brought_onto_goal(stepper, goal, stepper.pose(random_unknowns(stepper, rng)))
        if pose is not None:
            yield pose


def free_goal_poses(
    task: SpaceTask, stepper: SpaceStepper, motions: SampledMotions, rng: np.random.Generator
) -> Iterator[Pose]:
    """Yield poses at the goal, as ``goal_poses``, found from free smooth shapes, nearest to the goal first.

    Args:
        task: task with a goal for the tip, of an arm on a fixed base.
        stepper: stepper in whose unknowns the poses are given.
        motions: sampled check that selects the shapes that touch nothing.
        rng: random generator.
    """
    goal = task.limited_goal
    curve = stepper.space
    shapes = smooth_unknowns(stepper, rng, _SHAPES)
    q = curve.configurations(shapes)
    shapes = shapes[motions.free_shares(q, q) >= 1.0]
    if len(shapes) == 0:
        return
    tips = curve.arm.joint_positions_at(curve.configurations(shapes))[:, -1]
    away = np.linalg.norm(tips - goal.position, axis=1)
    for v in shapes[np.argsort(away)[:_NEAREST]]:
        if task.deadline.passed():
            return
        pose = _brought_onto_goal(stepper, goal, stepper.pose(v))
        if pose is not None:
            yield pose


def smooth_unknowns(stepper: SpaceStepper, rng: np.random.Generator, count: int) -> FloatArray:
    """Return the unknowns of curves with smooth random curvature up to the joint limits, shape (count, p).

    The base turns are normally distributed.
    """
    curve = stepper.space
    arm, knots = curve.arm, curve.knots
    # Curvature is linear between a random number of controls; those beyond the last have no effect.
    controls = rng.normal(size=(count, 2, _CONTROLS[1])) * rng.uniform(0.0, _BENT, (count, 1, 1))
    at = np.linspace(0.0, 1.0, knots) * (rng.integers(*_CONTROLS, size=count)[:, None] - 1)
    before = np.minimum(at.astype(np.intp), _CONTROLS[1] - 2)
    share = (at - before)[:, None]
    np.clip(controls, -1.0, 1.0, out=controls)
    low, high = (np.take_along_axis(controls, (before + k)[:, None], axis=2) for k in (0, 1))
    largest = arm.joint_limit * arm.links / NOMINAL_LINKS / curve.nominal_length
    v = np.empty((count, curve.dimension))
    v[:, :2] = rng.normal(size=(count, 2)) * 0.5 * min(arm.base_limit, 2.0)
    v[:, 2 : 2 + 2 * knots] = (largest * ((1.0 - share) * low + share * high)).reshape(count, 2 * knots)
    v[:, 2 : 2 + 2 * knots] /= curve.scale[2 : 2 + 2 * knots]
    v[:, 2 + 2 * knots :] = rng.uniform(size=(count, 1))
    return v


def random_unknowns(stepper: SpaceStepper, rng: np.random.Generator) -> FloatArray:
    """Return the unknowns of a curve with smooth random curvature, and a random feed, shape (p,)."""
    curve = stepper.space
    arm = curve.arm
    k = curve.knots
    controls = rng.normal(size=(2, 4)) * rng.uniform(0.1, 1.0)
    places = np.linspace(0.0, 1.0, 4)
    # Curvature as the bend of a nominal link; three quarters of the limit is a strong bend already.
    largest = 0.4 * min(arm.joint_limit * arm.links / NOMINAL_LINKS, 1.0) / stepper.space.nominal_length
    curvature = [largest * np.interp(np.linspace(0.0, 1.0, k), places, row) for row in controls]
    v = np.zeros(curve.dimension)
    turned = 0 if arm.base_axes else 2
    if turned:
        v[:2] = rng.normal(size=2) * 0.5 * min(arm.base_limit, 1.5)
    v[turned : turned + 2 * k] = np.concatenate(curvature) / curve.scale[turned : turned + 2 * k]
    if arm.base_axes:
        low, high = arm.base_range
        v[turned + 2 * k] = rng.uniform(low, high) / curve.scale[turned + 2 * k]
    return v


def _brought_onto_goal(stepper: SpaceStepper, goal: GoalPose, pose: Pose) -> Pose | None:
    """Return the pose moved onto the goal, clear of walls and within limits; None where that fails."""
    for k in range(_STEPS):
        pose = stepper.step(pose, goal.terms(stepper.space, pose, 1.0 + k), checked=False)
        distance, turn = goal.errors(pose)
        if distance < 0.1 * stepper.space.nominal_length and turn < 0.05:
            break
    onto = moved_onto(stepper.space, goal, pose, POLISH_TURN)
    return onto if goal.on_goal(onto) and goal.limits_met(onto) and _free(stepper, onto) else None


def _free(stepper: SpaceStepper, pose: Pose) -> bool:
    """Return whether a pose touches nothing and is within the limits."""
    return stepper.safe(pose.q, pose.q)


_SWING_EXTENSIONS = 1000
"""Most extensions of trees between poses that have been unbent: the trees meet after few extensions or not at all.
Measured on curled arms next to a post, where some hundred are enough."""
_BASE_SHARE = 0.8
"""Share of the targets of such trees in which only the base turns, anywhere, and the curve lies between those of the
start and a goal."""
_LONGEST_EDGES = 1000.0
"""Longest edge that is checked, in extensions. Taste: all links of an arm turned right round are far less."""
_EXTENSION = 2.0
"""Longest edge, in the norm of the turns of the links [rad]."""


@dataclass(frozen=True, eq=False)
class CurveDraws:
    """Samples targets and certifies edges for RRT-Connect in the unknowns of a curve.

    Points are unknowns times a root of the metric by the turns of the links, so that their distances are those of the
    turns.

    Attributes:
        stepper: stepper in whose unknowns the trees grow.
        start: pose where the motion begins.
        goals: poses at the goal.
        base_share: share of targets in which the base is turned at random.
        batch: least and greatest number of targets sampled at once; one where each edge is certified by itself.
        longest: longest extension [rad].
        motions: sampled check of how far edges are free; None to certify edges instead.
        smooth: share of targets that are smooth random shapes.
    """

    stepper: SpaceStepper
    start: Pose
    goals: list[Pose]
    base_share: float = 0.0
    batch: tuple[int, int] = (1, 1)
    longest: float = _EXTENSION
    motions: SampledMotions | None = None
    smooth: float = 0.0

    @cached_property
    def root(self) -> FloatArray:
        """Matrix that takes unknowns to points, shape (p, p)."""
        metric = self.stepper.space.metric(self.start)
        return np.linalg.cholesky(metric + 1e-6 * np.trace(metric) / len(metric) * np.eye(len(metric)))

    @cached_property
    def goal_points(self) -> FloatArray:
        """Points of the goals, shape (m, p)."""
        return np.stack([goal.v for goal in self.goals]) @ self.root

    def way(self, rng: np.random.Generator, draws: int, deadline: Deadline) -> list[Pose] | None:
        """Return the poses from the start to one of the goals.

        None where ``draws`` extensions, or the time, do not suffice.
        """
        trees = (PointTree.empty(len(self.root)), PointTree.empty(len(self.root)))
        trees[0].add((self.start.v @ self.root)[None], np.array([-1]))
        search = ConnectSearch(
            self.free_shares,
            self,
            self._unproved,
            iter((self.goal_points,)),
            deadline.passed,
            rng,
            trees,
            ends_first=self.motions is not None,
        )
        found = search.run(draws)
        if found is None:
            return None
        return [self.stepper.pose(v) for v in self.stepper.space.in_pieces(self._between_ends(found))]

    def travel(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the norm of the turns of the links along each edge, shape (m,) [rad]."""
        return np.asarray(np.linalg.norm(end - start, axis=-1))

    def within_limits(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return 1 for every edge, shape (m,): the check of edges covers the limits."""
        del end
        return np.ones(len(start))

    def free_shares(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return how far straight motions are free, as shares of the whole, shape (m,).

        Without a sampled check, how far they are certified in whole extensions.
        """
        if self.motions is not None:
            configurations = self.stepper.space.configurations
            return self.motions.free_shares(configurations(self._unknowns(start)), configurations(self._unknowns(end)))
        return np.array([self._free_share(*edge) for edge in zip(start, end, strict=True)])

    def draw(self, rng: np.random.Generator, count: int, tree: PointTree, other: PointTree) -> FloatArray:
        """Return random targets between and around the start and the goals, shape (count, p)."""
        del tree, other
        if self.smooth == 0.0:
            return np.stack([self._drawn(rng) for _ in range(count)])
        smooth = smooth_unknowns(self.stepper, rng, rng.binomial(count, self.smooth)) @ self.root
        return np.vstack((smooth, *(self._drawn(rng) for _ in range(count - len(smooth)))))

    def _free_share(self, start: FloatArray, end: FloatArray) -> float:
        apart = float(np.linalg.norm(end - start))
        if not apart < _LONGEST_EDGES * self.longest:
            return 0.0  # where hardly anything bends, unknowns have almost no weight, and targets are not motions
        step = self.longest / max(apart, self.longest)
        shares = np.append(np.arange(0.0, 1.0, step), 1.0)
        places = self._unknowns(start + shares[:, None] * (end - start))
        for share, edge in zip(shares, pairwise(places), strict=False):
            if not self.stepper.edge_is_safe(*edge, self.stepper.settings.step.proof_depth):
                return float(share) + 0.5 * step  # half an extension, so rounding down keeps the whole ones certified
        return 1.0

    def _drawn(self, rng: np.random.Generator) -> FloatArray:
        goal = self.goals[int(rng.integers(len(self.goals)))]
        middle = self.start.v + rng.uniform(-0.2, 1.2) * (goal.v - self.start.v)
        if self.base_share > 0.0 and rng.uniform() < self.base_share:
            # The base points in a random direction.
            most = np.minimum(self.stepper.space.arm.base_limit, (np.pi, 0.5 * np.pi))
            return np.concatenate((rng.uniform(-most, most), middle[2:])) @ self.root
        spread = rng.normal(size=len(middle))
        apart = float(np.linalg.norm((goal.v - self.start.v) @ self.root))
        size = rng.uniform(0.1, 1.0) * max(apart, 1.0)
        return np.asarray(middle @ self.root + size * spread / np.sqrt(len(middle)))

    def _unproved(self, way: FloatArray) -> IntArray:
        """Return the edges of a path of points that are not certified, with exact unknowns at its ends."""
        return self.stepper.failing_edges(self._between_ends(way))

    def _between_ends(self, way: FloatArray) -> FloatArray:
        """Return the unknowns of a path of points, exact at its ends, shape (K, p)."""
        goal = self.goals[int(np.argmin(np.linalg.norm(self.goal_points - way[-1], axis=1)))]
        return np.vstack((self.start.v, self._unknowns(way[1:-1]), goal.v))

    def _unknowns(self, points: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.solve(self.root.T, points.T).T)


def swung(
    stepper: SpaceStepper,
    start: Pose,
    goals: list[Pose],
    rng: np.random.Generator,
    deadline: Deadline,
) -> list[Pose] | None:
    """Return the poses of a motion that unbends the arm, swings it over and bends it to one of the goals.

    None where no tree meets between the unbent poses.

    Args:
        stepper: stepper of an arm whose base turns.
        start: pose where the motion begins.
        goals: poses at the goal, one or more.
        rng: random generator.
        deadline: time limit.
    """
    unbent = unbending_poses(stepper, start, deadline)
    of_goals = [unbending_poses(stepper, goal, deadline) for goal in goals]
    trees = CurveDraws(stepper, unbent[-1], [poses[-1] for poses in of_goals], _BASE_SHARE)
    between = trees.way(rng, _SWING_EXTENSIONS, deadline)
    if between is None:
        return None
    bent = next(poses for poses in of_goals if np.array_equal(poses[-1].v, between[-1].v))
    # A motion is as safe in reverse.
    return [*unbent, *between[1:], *bent[-2::-1]]


def unbending_poses(stepper: SpaceStepper, pose: Pose, deadline: Deadline) -> list[Pose]:
    """Return the poses from a given one to where its curve is straight, or as straight as obstacles permit."""
    guide = PoseLed(stepper.space, pose.v, stepper.space.unbent(pose.v))
    try:
        return follow(stepper, guide, pose, deadline)
    except Stalled as stalled:
        return stalled.poses
