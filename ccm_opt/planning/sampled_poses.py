"""Random poses at the goal, and RRT-Connect between poses in the unknowns of a curve.

A curled arm sweeps much of its surroundings when its base turns, a straight one little. So trees that hardly ever meet
between two curled poses soon meet between the same poses straightened.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.native import NativeCall
from ccm_opt.ik.tip_roll import TipRoll
from ccm_opt.planning.continuation import Stalled, follow
from ccm_opt.planning.followable_ways import WayEnd
from ccm_opt.planning.goal import GoalPose, moved_onto
from ccm_opt.planning.guides import PoseLed
from ccm_opt.planning.link_chains import CHAIN_GAPS, LinkChains
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.rrt_connect import ConnectSearch, PointTree
from ccm_opt.planning.sampled_motions import SampledMotions
from ccm_opt.planning.section_map import SectionMap
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.step import SpaceStepper
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.inverse_kinematics import bends_from_directions
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_DRAWS = 200
"""Maximum number of random poses that are moved towards the goal."""
POLISH_TURN = 0.3
"""Largest turn of a link in a step of Newton's method onto the goal [rad]."""

_STEPS = 40
"""Maximum number of QP steps that move a random pose towards the goal."""


_SHAPES = 4096
"""Number of smooth shapes that are sampled together; a shape and its tip take some 4 µs."""
_NEAREST = 256
"""Number of the sampled smooth shapes, those nearest to the goal, that are moved onto the goal. Heuristic: it takes a
tenth
of a millisecond each. Measured among bars: of these one in a hundred is free, of shapes with the tip anywhere one in a
thousand."""
_NEAREST_FED = 32
"""The same for an arm on a feed axis, whose shapes are moved one by one. Heuristic: it takes some milliseconds each."""
_FACING = 0.3
"""Position error that is equivalent to a direction error of one radian, in arm lengths. Heuristic."""
_ROLLED = 0.1
"""Position error that is equivalent to a roll of one radian, in arm lengths. Heuristic: links roll by many bends."""
_NEWTON_STEPS = 20
"""Maximum number of steps of Newton's method onto the goal. Heuristic: it converges in some six or never."""
_NEWTON_TURN = 1.5
"""Maximum norm of a step of Newton's method onto the goal, in changes of link headings [rad]. Heuristic."""
_ARRIVED = 1e-4
"""Error of the tip up to which poses are passed on to the exact method, in arm lengths and radians."""
_CHAIN_STRAYS = (0.0, 0.3, 1.0)
"""Weights, one for each growth of chains in turn, of the difference between a node's number of links and the number
that its target requires. Measured among bars: each weight finds poses where the others find none."""
_CHAIN_GAP = 1.5
"""Largest distance between the part of a chain grown from the start and that grown from the goal, in links.
Heuristic."""
_MOST_CHAINED = 6
"""Maximum number of new poses at the goal from one growth of chains. Heuristic: each takes up to 40 QP steps."""
_CHAIN_BENDS = 0.98
"""Largest bend of the joints of a chain, as a fraction of the joint limit."""
_ALIKE = 0.03
"""Largest distance between joints of two poses up to which the poses count as one, in arm lengths. Heuristic."""
_AXIS_SHARE = 0.1
"""Cost of moving a base axis by itself, relative to that of moving all links with it. Heuristic."""
_CONTROLS = (3, 9)
"""Least number of control values of a smooth shape's curvature, which is linear in between, and one more than the
greatest."""
_BENT = 0.7
"""Maximum standard deviation of the curvature at a control, as a fraction of the largest one that the joints permit.
Measured in two confined scenes: with half as much, trees take twice as long to meet."""


def goal_poses(task: SpaceTask, stepper: SpaceStepper, rng: np.random.Generator) -> Iterator[Pose]:
    """Yield random poses at the goal that touch nothing and respect the joint limits.

    Poses are sampled until the deadline has passed or the maximum number of samples is reached.

    Args:
        task: task with a goal for the tip.
        stepper: solver of QP steps; gives the space of unknowns.
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
    task: SpaceTask, points: "CurvePoints", motions: SampledMotions, rng: np.random.Generator
) -> list[Pose]:
    """Return poses at the goal, smooth random shapes moved onto it, that touch nothing and respect the joint limits.

    Args:
        task: task with a goal for the tip.
        points: scaled unknowns in which the shapes are moved.
        motions: sampled check of contact.
        rng: random generator.
    """
    goal = task.limited_goal
    stepper = points.stepper
    shapes = smooth_unknowns(stepper, rng, _SHAPES)
    near = np.argsort(_off_goal(stepper, goal, shapes))[:_NEAREST]
    if not stepper.space.affine:
        onto = (moved_onto(stepper.space, goal, stepper.pose(v)) for v in shapes[near[:_NEAREST_FED]])
        return [pose for pose in onto if goal.reached(pose) and _free(stepper, pose)]
    moved = shapes[near] @ points.root
    moved = points.unknowns(moved[points.moved_onto(goal, moved) < _ARRIVED])
    q = stepper.space.configurations(moved)
    # A base bent by more than a right angle points the same way as one turned half round and bent by less.
    direct = np.abs(q[:, 1]) <= 0.5 * np.pi
    moved, q = moved[direct], q[direct]
    poses = [moved_onto(stepper.space, goal, stepper.pose(v)) for v in moved[motions.free_shares(q, q) >= 1.0]]
    return [pose for pose in poses if goal.reached(pose) and _free(stepper, pose)]


def chained_goal_poses(
    task: SpaceTask, points: "CurvePoints", known: list[Pose], turn: int, rng: np.random.Generator
) -> list[Pose]:
    """Return further poses at the goal, made from chains of links, that touch nothing and respect the joint limits.

    Chains pass between many obstacles, where hardly any smooth random shape is free.

    Args:
        task: task with a goal for the tip, of an arm on a fixed base.
        points: scaled unknowns in which shapes are moved.
        known: known poses at the goal; poses close to one of them are omitted.
        turn: index of the growth, which determines how nodes are chosen.
        rng: random generator.
    """
    goal = task.limited_goal
    stepper = points.stepper
    arm = task.arm
    each = arm.bend_limits.reshape(arm.links, -1).mean(axis=1)
    limits = _CHAIN_BENDS * each
    limits[0] = each[0]
    # The last limit is also that of all joints of the tree from the goal, which must be able to bend.
    limits[-1] = limits[-1] or _CHAIN_BENDS * arm.joint_limit
    chains = LinkChains.in_box(arm, task.tree, task.box, limits, exact=True)
    ends = (WayEnd(arm.base, arm.direction), WayEnd(goal.position, goal.direction))
    found: list[Pose] = []
    kept = task.kept + task.spare + float(rng.choice(CHAIN_GAPS)) * task.wanted_gap
    strays = _CHAIN_STRAYS[turn % len(_CHAIN_STRAYS)]
    grown = chains.grown(*ends, kept, _CHAIN_GAP * arm.link_length, strays, rng)
    if not grown:
        return []
    bends = bends_from_directions(arm, np.stack([chain.directions for chain in grown]))
    shapes = np.stack([stepper.space.fitted(q) for q in bends.reshape(len(grown), -1)]) @ points.root
    for v in points.unknowns(shapes[points.moved_onto(goal, shapes) < _ARRIVED]):
        if len(found) == _MOST_CHAINED or task.deadline.passed():
            break
        pose = stepper.pose(v)
        if not _is_new(arm, pose, (*known, *found)):
            continue
        brought = _brought_onto_goal(stepper, goal, pose)
        if brought is not None and _is_new(arm, brought, (*known, *found)):
            found.append(brought)
    return found


def _is_new(arm: Arm, pose: Pose, known: Iterable[Pose]) -> bool:
    """Return whether a joint is farther than a small fraction of the arm's length from that of every known pose."""
    apart = (np.linalg.norm(pose.points - other.points, axis=1) for other in known)
    return all(np.max(each) >= _ALIKE * arm.length for each in apart)


def _off_goal(stepper: SpaceStepper, goal: GoalPose, shapes: FloatArray) -> FloatArray:
    """Return the error of the tip at the goal for each of m shapes, given by unknowns (m, p), in arm lengths, (m,).

    Direction errors are converted to equivalent position errors and added.
    """
    arm = stepper.space.arm
    q = stepper.space.configurations(shapes)
    joints = arm.joint_positions_at(q)
    away = np.linalg.norm(joints[:, -1] - goal.position, axis=1) / arm.length
    if goal.direction is None:
        return np.asarray(away)
    ahead = (joints[:, -1] - joints[:, -2]) @ goal.direction / arm.lengths[-1]
    away = away + _FACING * np.arccos(np.clip(ahead, -1.0, 1.0))
    if goal.roll is None:
        return np.asarray(away)
    return np.asarray(away + _ROLLED * np.abs(goal.roll.of_frames(arm.link_rotations(q)[:, -1])))


@dataclass(frozen=True, eq=False)
class CurvePoints:
    """Linear map from unknowns of a curve to points whose Euclidean distances approximate rotations of the links.

    Attributes:
        stepper: solver of QP steps in the unknowns.
        start: pose at which the metric of the unknowns is evaluated.
    """

    stepper: SpaceStepper
    start: Pose

    @cached_property
    def root(self) -> FloatArray:
        """Cholesky factor of the metric; a row of unknowns times this matrix is the point, shape (p, p)."""
        curve = self.stepper.space
        start = self.start
        if not curve.affine:
            # All of the arm moves once it is out of the guide tube.
            out = start.v.copy()
            out[curve.feed_column] = curve.arm.base_range[1] / curve.scale[curve.feed_column]
            start = self.stepper.pose(out)
        metric = curve.metric(start)
        # A joint on an axis parallel to its own may turn back by what the axis turns it, which moves no link.
        axes = np.arange(curve.dimension)[curve.axis_columns]
        metric[axes, axes] *= 1.0 + _AXIS_SHARE
        return np.linalg.cholesky(metric + 1e-6 * np.trace(metric) / len(metric) * np.eye(len(metric)))

    @cached_property
    def configurations(self) -> tuple[FloatArray, FloatArray]:
        """Configuration at point zero, shape (c,), and its derivatives with respect to the point, shape (p, c).

        On a feed axis, bends are those out of the guide tube.
        """
        curve = self.stepper.space
        slopes = np.asarray(np.linalg.solve(self.root, curve.drive_rows.T), dtype=np.float64)
        return curve.configuration(np.zeros(curve.dimension)), slopes

    def unknowns(self, points: FloatArray) -> FloatArray:
        """Return the unknowns of points, both of shape (m, p)."""
        return np.asarray(np.linalg.solve(self.root.T, points.T).T)

    def moved_onto(self, goal: GoalPose, points: FloatArray) -> FloatArray:
        """Move points in place by Newton's method so that the tip is at a goal, without regard to obstacles and limits.

        Args:
            goal: goal for the tip.
            points: points, shape (m, p).

        Returns:
            Remaining errors of the tip, in arm lengths and radians, shape (m,).
        """
        arm = self.stepper.space.arm
        offset, slopes = self.configurations
        missed = np.empty(len(points))
        directed = goal.direction is not None
        roll = goal.roll or TipRoll(*np.zeros((3, 3)))
        NativeCall(
            "shapes_onto_goal",
            links=arm.links, size=points.shape[1], shapes=len(points), directed=directed,
            rolled=goal.roll is not None, steps=_NEWTON_STEPS,
            whole=arm.length, lengths=arm.lengths, turns=arm.turns, arcs=arm.arcs, largest=_NEWTON_TURN,
            carrier=arm.carrier_for_c, offset=offset, slopes=slopes, low=arm.lower_limits, high=arm.upper_limits,
            inverse=np.linalg.pinv(slopes), position=goal.position,
            direction=goal.direction if directed else np.zeros(3),
            up=roll.up, beside=roll.beside, own=roll.own, room=roll.room,
            work=np.empty(28 * arm.links + 8 * (points.shape[1] + len(arm.base_axes)) + 12), points=points,
            missed=missed,
        )()  # fmt: skip
        return missed


def smooth_unknowns(stepper: SpaceStepper, rng: np.random.Generator, count: int) -> FloatArray:
    """Return the unknowns of ``count`` curves with smooth random curvature up to the joint limits, shape (count, p).

    The rotations of the first joint are normally distributed, the positions of base axes evenly.
    """
    curve = stepper.space
    if isinstance(curve, SectionMap):
        return curve.drawn(rng, count)
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
    v[:, 1] = np.clip(v[:, 1], -0.5 * np.pi, 0.5 * np.pi)
    v[:, 2 : 2 + 2 * knots] = (largest * ((1.0 - share) * low + share * high)).reshape(count, 2 * knots)
    v[:, 2 : 2 + 2 * knots] /= curve.scale[2 : 2 + 2 * knots]
    v[:, curve.axis_columns] = curve.drawn_axes(rng, count)
    v[:, len(curve.scale) :] = rng.uniform(size=(count, 1))
    return v


def random_unknowns(stepper: SpaceStepper, rng: np.random.Generator) -> FloatArray:
    """Return the unknowns of a curve with smooth random curvature and random base axes or rotation, shape (p,)."""
    curve = stepper.space
    if isinstance(curve, SectionMap):
        return np.asarray(curve.drawn(rng, 1)[0])
    arm = curve.arm
    k = curve.knots
    controls = rng.normal(size=(2, 4)) * rng.uniform(0.1, 1.0)
    places = np.linspace(0.0, 1.0, 4)
    # Curvature as the bend of a nominal link; three quarters of the limit is a strong bend already.
    largest = 0.4 * min(arm.joint_limit * arm.links / NOMINAL_LINKS, 1.0) / stepper.space.nominal_length
    curvature = [largest * np.interp(np.linspace(0.0, 1.0, k), places, row) for row in controls]
    v = np.zeros(curve.dimension)
    turned = 0 if arm.feed else 2
    if turned:
        v[:2] = rng.normal(size=2) * 0.5 * min(arm.base_limit, 1.5)
    v[turned : turned + 2 * k] = np.concatenate(curvature) / curve.scale[turned : turned + 2 * k]
    v[curve.axis_columns] = curve.drawn_axes(rng, 1)[0]
    return v


def _brought_onto_goal(stepper: SpaceStepper, goal: GoalPose, pose: Pose) -> Pose | None:
    """Return the pose moved onto the goal by steps, free of contact and within limits; None on failure."""
    for k in range(_STEPS):
        pose = stepper.step(pose, goal.terms(stepper.space, pose, 1.0 + k), checked=False)
        distance, turn = goal.errors(pose)
        if distance < 0.1 * stepper.space.nominal_length and turn < 0.05:
            break
    onto = moved_onto(stepper.space, goal, pose, POLISH_TURN)
    return onto if goal.reached(onto) and _free(stepper, onto) else None


def _free(stepper: SpaceStepper, pose: Pose) -> bool:
    """Return whether a pose is certified to be free of contact and within the limits."""
    return stepper.safe(pose.q, pose.q)


_SWING_EXTENSIONS = 1000
"""Maximum number of extensions of trees between straightened poses: the trees meet after few extensions or not at all.
Measured for curled arms next to a post: some hundred are enough."""
_BASE_SHARE = 0.8
"""Fraction of the targets, for trees between straightened poses, in which the base has a random direction and the curve
is between those of the start and a goal."""
_EXTENSION = 2.0
"""Maximum length of an extension, in the norm of points [rad]. Measured among bars: with 1 it takes twice as long until
the trees meet."""
_BATCH = (8, 16)
"""Minimum and maximum number of targets in a batch, between checks of the deadline. Heuristic."""
_SMOOTH = 0.8
"""Fraction of the trees' targets that are smooth random shapes. Measured among bars: with half as many, trees meet
later."""
_ATTRACTED = 0.1
"""Fraction of targets that are nodes of the other tree. Measured among bars: with none, trees meet after twice the
time."""


@dataclass(frozen=True, eq=False)
class CurveDraws:
    """Sampler of targets for RRT-Connect in the unknowns of a curve.

    Attributes:
        points: scaled unknowns that are the nodes of the trees.
        motions: sampled check of motions.
        goals: poses at the goal.
        base_share: fraction of the targets near start and goals in which the base points in a random direction.
        smooth: fraction of all targets that are smooth random shapes.
        batch: minimum and maximum number of targets sampled together.
        longest: maximum length of an extension, in the norm of points [rad].
    """

    points: CurvePoints
    motions: SampledMotions
    goals: list[Pose]
    base_share: float = 0.0
    smooth: float = _SMOOTH
    batch: tuple[int, int] = _BATCH
    longest: float = _EXTENSION

    @property
    def stepper(self) -> SpaceStepper:
        """Solver of QP steps that gives the space of unknowns."""
        return self.points.stepper

    @property
    def start(self) -> Pose:
        """Start pose of the motion."""
        return self.points.start

    @cached_property
    def goal_points(self) -> FloatArray:
        """Points of the poses at the goal, shape (m, p)."""
        return np.stack([goal.v for goal in self.goals]) @ self.points.root

    def way(self, rng: np.random.Generator, draws: int, deadline: Deadline) -> list[Pose] | None:
        """Return the poses of a certified motion from the start to one of the goals, by RRT-Connect.

        Args:
            rng: random generator.
            draws: maximum number of extensions.
            deadline: deadline of the search.

        Returns:
            None if no motion is found.
        """
        root = self.points.root
        trees = (PointTree.empty(len(root)), PointTree.empty(len(root)))
        trees[0].add((self.start.v @ root)[None], np.array([-1]))
        search = ConnectSearch(
            partial(self.motions.connection, *self.points.configurations),
            self,
            self._unproved,
            iter((self.goal_points,)),
            deadline.passed,
            rng,
            trees,
        )
        found = search.run(draws)
        if found is None:
            return None
        return [self.stepper.pose(v) for v in self.stepper.space.in_pieces(self._between_ends(found))]

    def draw(self, rng: np.random.Generator, count: int, tree: PointTree, other: PointTree) -> FloatArray:
        """Return random targets for a tree, shape (count, p).

        They are smooth shapes, nodes of the other tree, and points near or between the start and the goals.

        Args:
            rng: random generator.
            count: number of targets.
            tree: the tree; unused.
            other: the other tree.
        """
        del tree
        root = self.points.root
        smooth, attracted, rest = rng.multinomial(count, self._shares)
        shapes = smooth_unknowns(self.stepper, rng, smooth) @ root
        nodes = other.nodes[rng.integers(len(other), size=attracted)]
        targets = np.vstack((shapes, nodes, *(self._drawn(rng) @ root for _ in range(rest))))
        return rng.permutation(targets)

    @property
    def _shares(self) -> FloatArray:
        """Fractions of targets that are smooth shapes, nodes of the other tree, and other points, shape (3,)."""
        others = max(1.0 - self.smooth - _ATTRACTED, 0.0)
        return np.array([self.smooth, _ATTRACTED, others])

    def _drawn(self, rng: np.random.Generator) -> FloatArray:
        goal = self.goals[int(rng.integers(len(self.goals)))]
        middle = self.start.v + rng.uniform(-0.2, 1.2) * (goal.v - self.start.v)
        if self.base_share > 0.0 and rng.uniform() < self.base_share:
            # The base points in a random direction.
            most = np.minimum(self.stepper.space.arm.base_limit, (np.pi, 0.5 * np.pi))
            return np.concatenate((rng.uniform(-most, most), middle[2:]))
        spread = rng.normal(size=len(middle))
        apart = float(np.linalg.norm((goal.v - self.start.v) @ self.points.root))
        size = rng.uniform(0.1, 1.0) * max(apart, 1.0)
        return np.asarray(middle + self.points.unknowns(size * spread[None] / np.sqrt(len(middle)))[0])

    def _unproved(self, way: FloatArray) -> IntArray:
        """Return the indices of the intervals of a path of points (K, p) that are not certified."""
        return self.stepper.failing_edges(self._between_ends(way))

    def _between_ends(self, way: FloatArray) -> FloatArray:
        """Return the unknowns (K, p) of a path of points (K, p), with exactly those of start and goal at its ends."""
        goal = self.goals[int(np.argmin(np.linalg.norm(self.goal_points - way[-1], axis=1)))]
        return np.vstack((self.start.v, self.points.unknowns(way[1:-1]), goal.v))


def swung(
    stepper: SpaceStepper,
    motions: SampledMotions,
    start: Pose,
    goals: list[Pose],
    rng: np.random.Generator,
    deadline: Deadline,
) -> list[Pose] | None:
    """Return the poses of a motion that straightens the arm, turns it at its base, and bends it to one of the goals.

    The result is None if the search finds no motion between the straightened poses.

    Args:
        stepper: solver of QP steps of an arm on a fixed base.
        motions: sampled check of motions.
        start: start pose of the motion.
        goals: poses at the goal, one or more.
        rng: random generator.
        deadline: deadline of the search.
    """
    unbent = unbending_poses(stepper, start, deadline)
    of_goals = [unbending_poses(stepper, goal, deadline) for goal in goals]
    trees = CurveDraws(CurvePoints(stepper, unbent[-1]), motions, [poses[-1] for poses in of_goals], _BASE_SHARE, 0.0)
    between = trees.way(rng, _SWING_EXTENSIONS, deadline)
    if between is None:
        return None
    bent = next(poses for poses in of_goals if np.array_equal(poses[-1].v, between[-1].v))
    # A motion is as safe in reverse.
    return [*unbent, *between[1:], *bent[-2::-1]]


def unbending_poses(stepper: SpaceStepper, pose: Pose, deadline: Deadline) -> list[Pose]:
    """Return the poses from a given one towards that with a straight curve, as far as obstacles permit.

    Args:
        stepper: solver of QP steps.
        pose: the given pose.
        deadline: deadline of the steps.
    """
    guide = PoseLed(stepper.space, pose.v, stepper.space.unbent(pose.v))
    try:
        return follow(stepper, guide, pose, deadline)
    except Stalled as stalled:
        return stalled.poses
