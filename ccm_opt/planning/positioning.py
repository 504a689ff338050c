"""Planning for arms that axes carry: from a place to which the axes bring the arm, or with axes and joints together.

The axes first move, with the joints at rest, to positions from which the goal looks near. From there the arm is planned
for as one on a fixed base or, if the last axis is prismatic along the straight arm, as one on a feed axis. Places are
tried in the order of how long the way is that is left to the tip, around the obstacles, once the arm is driven straight
ahead, as far as nothing is in its way. Both parts of the path are certified, and the arm rests between them.

If the most promising place fails, a motion of axes and joints together is searched for, in which the axes are unknowns
beside those of the arm. For an arm that bends in one plane alone, which must be turned to face the goal, and for a pose
of the whole arm on an axis along it, this comes first.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline
from scipy.stats import qmc

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, NoPlanFound, ProblemError, TimeLimitReached, UnreachableGoal
from ccm_opt.core.length_words import file_length, long_length, short_length
from ccm_opt.core.progress import Stages
from ccm_opt.planning.grid_ways import GridDistances, TipGrid
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.planner import PlannedPath
from ccm_opt.planning.resuming import known_motion, nearest_known
from ccm_opt.planning.surface_certificate import SpaceCertificate
from ccm_opt.planning.tool_problem import bodies_as_links
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed, ShortAxis, nearest_base, short_axes
from ccm_opt.scene.distances.surface_tree import SurfaceTree

_PLACES = 9
"""Base-2 logarithm of the number of places that are looked at. Heuristic."""
_TRIED = 16
"""Number of places from which a motion of the arm is looked for. Heuristic."""
_TRY_SHARE = 0.2
"""Fraction of the time left for planning that one place may take. Heuristic."""
_TOGETHER_SHARE = 0.5
"""Fraction of the time left for planning that a motion of axes and joints together may take. Heuristic."""
_LEAST_TRY = 1.0
"""Time that a place may take at least [s]. Heuristic."""
_ALIGNED = 1e-9
"""Largest difference of the directions of an axis and the arm at which the arm counts as fed by the axis."""
_BRANCHES = 400
"""Number of nodes of the trees of positions of the axes. Heuristic."""
_STEP = 0.15
"""Largest step of these trees, as a fraction of the ranges of the axes. Heuristic."""
_STEPS_AHEAD = 64
"""Number of parts of the way straight ahead that are tested for obstacles. Heuristic."""
_CELLS = 300_000
"""Number of cells of the grid by which ways of the tip are measured. Heuristic."""
_NEARNESS = 1.0
"""Extra cost per length of these ways in contact with a surface. Heuristic."""
_SAME = 1e-6
"""Largest difference of coordinates that count as equal [rad, m]. Derived: files round them to less."""
_DEGREE = 3
"""Degree of the splines of paths."""


class ArmPlanner(Protocol):
    """Interface of planners of an arm on a fixed base, on a feed axis, or together with the axes that carry it."""

    def plan(self, problem: Problem) -> JointPath:
        """Return a certified path for a problem.

        Raises:
            NoPlanFound: no path was found.
        """
        ...

    def replanned(self, problem: Problem, known: Sequence[SpaceMotion] = (), *, shortened: bool = False) -> PlannedPath:
        """Return a certified path for a problem, adapted from a known motion if possible; see ``MotionPlanner``."""
        ...


@dataclass(frozen=True)
class PositioningPlanner:
    """Plans motions of arms in space that axes carry; satisfies the ``Planner`` protocol.

    Attributes:
        stages: measures the durations of the stages.
        planner: planner of the arm from where the axes have brought it, and of axes and joints together.
    """

    stages: Stages
    planner: ArmPlanner

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion of axes and arm to the problem's goal.

        Raises:
            ProblemError: the arm is planar.
            NoPlanFound: no motion was found.
        """
        if problem.dimension == 2:
            raise ProblemError("in the plane, no motions of arms on arm.base.axes are planned; use a feed axis")
        if problem.goal.path is not None:
            return self.planner.plan(problem)
        if problem.arm.rigid_bodies:
            whole, back = bodies_as_links(problem)
            return self.plan(whole).mapped(back)
        deadline = Deadline.after(problem.planner.time_limit)
        with self.stages("free space"):
            axes = CarrierMotions(problem, problem.workspace.surface_tree)
            axes.refuse_start()
            axes.refuse_distant_goal()
            places = itertools.islice(axes.places(), _TRIED)
            first = [] if axes.face_goal else list(itertools.islice(places, 1))
        found = self._from_places(axes, first, deadline)
        if found is not None:
            return found
        self.stages.tell(candidate="base axes and joints together")
        share = _TOGETHER_SHARE if problem.goal.whole(problem.arm) is None or axes.face_goal else 1.0
        try:
            return self.planner.plan(_within(problem, max(share * deadline.left, _LEAST_TRY)))
        except UnreachableGoal:
            raise
        except NoPlanFound as failure:
            others = list(places)
            found = self._from_places(axes, others, deadline)
            if found is None:
                raise _not_found(failure, len(first) + len(others), passed=deadline.passed()) from None
        return found

    def replanned(self, problem: Problem, known: Sequence[SpaceMotion] = (), *, shortened: bool = False) -> PlannedPath:
        """Plan a certified motion of axes and arm to a goal of the tip or the whole arm, from a known one if possible.

        Where the axes of the known motion first bring the arm to a place, they do so again, and its motion from there
        is adapted. Any other motion is adapted as one of axes and joints together.

        Args:
            problem: the problem.
            known: motions for slightly different problems, from ``known_motion``; a motion is searched for without any.
            shortened: whether an adapted motion is optimised as far as time permits, if most of it is left.

        Raises:
            NoPlanFound: no motion was found.
        """
        if problem.arm.rigid_bodies:
            whole, back = bodies_as_links(problem)
            return self.replanned(whole, known, shortened=shortened).mapped(back)
        nearest = nearest_known(known, problem)
        if nearest is None:
            path = self.plan(problem)
            return PlannedPath(path, known_motion(problem.arm, path.keyframes))
        axes = CarrierMotions(problem, problem.workspace.surface_tree)
        alone = axes.from_place(nearest.configurations)
        deadline = Deadline.after(problem.planner.time_limit)
        way = None if alone is None else axes.way_to(alone[0][axes.arm.coordinates.base], deadline)
        if alone is None or way is None:
            return self.planner.replanned(problem, known, shortened=shortened)
        values = way[-1]
        standing = axes.standing(values, deadline.left)
        moved = (known_motion(standing.arm, axes.of_arm_alone(alone)),)
        planned = self.planner.replanned(standing, moved, shortened=shortened)
        path = axes.joined(way, axes.lifted(planned.path, values))
        return replace(planned, path=path, motion=known_motion(problem.arm, path.keyframes))

    def _from_places(
        self, axes: "CarrierMotions", places: Sequence[FloatArray], deadline: Deadline
    ) -> JointPath | None:
        """Return a path by way of the first of some places of the base from which a motion is found; None in vain."""
        for values in places:
            if deadline.passed():
                return None
            self.stages.tell(candidate=f"base axes at {', '.join(f'{value:.3g}' for value in values)}")
            way = axes.way_to(values, deadline)
            if way is None:
                continue
            try:
                found = self.planner.plan(axes.standing(values, max(_TRY_SHARE * deadline.left, _LEAST_TRY)))
            except NoPlanFound:
                continue
            return axes.joined(way, axes.lifted(found, values))
        return None


def _within(problem: Problem, time_limit: float) -> Problem:
    return replace(problem, planner=replace(problem.planner, time_limit=time_limit))


def _not_found(together: NoPlanFound, count: int, *, passed: bool) -> NoPlanFound:
    """Return the error for a search from several places of the base, from the failure with axes and joints together."""
    found = together.diagnosis
    tried = f"from {count} place{'s' * (count != 1)} of the base no motion was found; " if count else ""
    kind = TimeLimitReached if passed else MotionNotFound
    reason = f"{tried}with base axes and joints together: {found.reason}"
    return kind(replace(found, reason=reason, findings=(), relaxations=()))


@dataclass(frozen=True, eq=False)
class CarrierMotions:
    """Motions of the axes that carry an arm whose joints rest in the pose of the start.

    Attributes:
        problem: problem in space with one goal.
        tree: distances from the surfaces of the workspace.
    """

    problem: Problem
    tree: SurfaceTree

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.problem.arm

    @cached_property
    def start(self) -> FloatArray:
        """Configuration of the start, shape (c,) [rad, m]."""
        return self.problem.start.configuration(self.arm)

    @cached_property
    def certificate(self) -> SpaceCertificate:
        """Proof that the arm touches nothing while its coordinates change evenly."""
        return SpaceCertificate(self.arm, self.tree, self.problem.workspace.clearance)

    @property
    def fed(self) -> bool:
        """Whether the last axis moves the arm along its straight direction, and the start is straight.

        Sections that bend evenly do not follow their tip on an axis: it brings them to a place like the others.
        """
        if self.arm.drives is not None:
            return False
        last = self.arm.carrier[-1]
        along = not last.revolute and float(np.linalg.norm(last.direction - self.arm.direction)) < _ALIGNED
        return along and not np.any(self.start[self.arm.coordinates.bends])

    def refuse_start(self) -> None:
        """Raise an error if the arm touches something at the start.

        Raises:
            UnreachableGoal: it does.
        """
        if not self.certificate.safe(self.start, self.start):
            reason = "the arm touches an obstacle, or itself, at the start"
            raise UnreachableGoal(Diagnosis(reason, "start", ("move the start, or its axes",)))

    @property
    def face_goal(self) -> bool:
        """Whether axes and joints are moved together before the base is brought to any place.

        All joints bend about one axis, so that the arm must be turned to face its goal; or the goal is a pose of the
        whole arm on an axis along it, as on a feed axis joints would be straight that need not be.
        """
        one_plane = not np.all(np.any(self.arm.bend_limits.reshape(-1, 2) > 0.0, axis=0))
        return one_plane or (self.fed and self.problem.goal.whole(self.arm) is not None)

    def refuse_distant_goal(self) -> None:
        """Raise an error if the goal is farther than the arm is long from wherever the axes may bring its base.

        Raises:
            UnreachableGoal: it is; names the axes that end too early, and by how much.
        """
        arm, goal = self.arm, self.problem.goal.for_tip
        if goal is None:
            return
        within = arm.length + self.problem.tolerances.position
        if np.linalg.norm(arm.carried(self.start).place - goal.position) <= within:
            return
        values, distance = nearest_base(arm.carrier, arm.base, goal.position)
        if distance <= within:
            return
        missing = short_length(distance - arm.length)
        found = [self._short_words(each) for each in short_axes(arm.carrier, arm.base, goal.position, values, within)]
        reason = (
            f"the goal is out of reach: the base axes bring the base no nearer to it than {long_length(distance)}, and "
            f"the arm is only {long_length(arm.length)} long"
        )
        advice = (*(f"widen {words}" for words in found), f"move the goal nearer by {missing} at least")
        raise UnreachableGoal(
            Diagnosis(reason, "necessary checks", (*advice, f"lengthen the arm by {missing} at least"))
        )

    def _short_words(self, short: ShortAxis) -> str:
        """Return the key of an axis whose range ends too early, with that end and what is missing beyond it."""
        turns = self.arm.carrier[short.number].revolute
        key = f"arm.base.axes[{short.number}].range{'_deg' * turns}"
        if turns:
            return f"{key} beyond {np.rad2deg(short.limit):.4g} by {np.rad2deg(short.missing):.3g}° at least"
        return f"{key} beyond {file_length(short.limit)} by {short_length(short.missing)} at least"

    # ------------------------------------------------------------ places
    def places(self) -> Iterator[FloatArray]:
        """Yield positions of the axes from which the arm could reach the goal, most promising first, each (k,)."""
        base = self.arm.coordinates.base
        goal = self.problem.goal.whole(self.arm)
        if goal is not None:
            yield goal[base]
            return
        now = self.start[base]
        low, high = self.arm.lower_limits[base], self.arm.upper_limits[base]
        moving = len(now) - self.fed
        values = np.tile(now, (1 + 2**_PLACES, 1))
        if moving:
            drawn = qmc.Sobol(moving, seed=self.problem.planner.seed).random_base2(_PLACES)
            values[1:, :moving] = low[:moving] + drawn * (high - low)[:moving]
        if not moving:
            values = values[:1]
        score = self._scores(values)
        kept = [values[0]] if np.isfinite(score[0]) and np.any(self.start[self.arm.coordinates.bends]) else []
        yield from kept
        for k in np.argsort(score, kind="stable"):
            if not np.isfinite(score[k]):
                return
            refined = self._refined(values[k], float(score[k]), moving)
            if not self._stands_free(refined):
                continue
            # Places next to those tried before promise the same.
            spread = np.abs(np.array(kept).reshape(-1, len(now)) - refined) / (high - low)
            if kept and np.min(np.max(spread, axis=1)) < 0.5 * _STEP:
                continue
            kept.append(refined)
            yield refined

    def _refined(self, values: FloatArray, score: float, moving: int) -> FloatArray:
        """Return positions of the axes near given ones whose score is best by a search along one axis at a time."""
        base = self.arm.coordinates.base
        low, high = self.arm.lower_limits[base], self.arm.upper_limits[base]
        step = 0.5 ** (_PLACES / max(moving, 1)) * (high - low)
        for _ in range(4):
            around = np.repeat(values[None], 2 * moving, axis=0)
            for axis in range(moving):
                around[2 * axis : 2 * axis + 2, axis] += np.array([step[axis], -step[axis]])
            around = np.clip(around, low, high)
            if not moving:
                break
            scores = self._scores(around)
            best = int(np.argmin(scores))
            if scores[best] < score:
                values, score = around[best], float(scores[best])
            else:
                step = 0.5 * step
        return values

    def _scores(self, values: FloatArray) -> FloatArray:
        """Return the shortest ways left to the tip after straight motions ahead from m places (m, k), shape (m,) [m].

        A place from which the goal is out of reach has the score ∞.
        """
        arm = self.arm
        q = np.tile(self.start, (len(values), 1))
        q[:, arm.coordinates.base] = values
        frames = arm.carried(q)
        place, ahead = frames.place, frames.rotation[..., 0]
        goal = self.problem.goal.tip(arm)
        fed = arm.carrier[-1].high - values[:, -1] if self.fed else np.zeros(len(values))
        off = goal - place
        along = np.clip(np.einsum("md,md->m", off, ahead), 0.0, fed)
        near = np.linalg.norm(off - along[:, None] * ahead, axis=1)
        # The arm reaches as far ahead as it is fed and long, up to the first obstacle.
        far = np.linspace(0.0, 1.0, _STEPS_AHEAD + 1)
        length = (fed + arm.length)[:, None] * far
        points = place[:, None] + length[..., None] * ahead[:, None]
        segments = np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3)
        kept = arm.radius + self.problem.workspace.clearance
        gaps = self.tree.distances(segments, 1.01 * kept + 1e-6, 0.1 * kept).reshape(len(values), -1)
        blocked = gaps < kept
        blocked[length[:, 1:] <= arm.mount_length] = False
        free = np.where(np.any(blocked, axis=1), np.argmax(blocked, axis=1), _STEPS_AHEAD)
        run = length[np.arange(len(values)), free]
        missed = np.min(np.where(length <= run[:, None], self._ways_left(points), np.inf), axis=1)
        # Cells may close a way that is open; such places come last.
        missed = np.where(np.isfinite(missed), missed, 10.0 * arm.length + near)
        moved = np.max(np.abs(values - self.start[arm.coordinates.base]), axis=1, initial=0.0)
        score = missed + 1e-3 * moved
        return np.where(near <= arm.length + self.problem.tolerances.position, score, np.inf)

    @cached_property
    def _grid(self) -> tuple[TipGrid, FloatArray | None]:
        """Cells in reach of the goal, and the cost of the way of the tip from each of them, or None."""
        problem = self.problem
        goal = problem.goal.tip(self.arm)
        low, high = goal - self.arm.length, goal + self.arm.length
        if problem.workspace.bounds is not None:
            low, high = np.maximum(low, problem.workspace.bounds[0]), np.minimum(high, problem.workspace.bounds[1])
        kept = self.arm.tip_radius + problem.workspace.clearance
        far = 2.0 * self.arm.radius
        finest = max(0.5 * kept, 0.01 * self.arm.length)
        distances = GridDistances.over(self.tree, (low, high), _CELLS, kept + far, finest)
        grid = TipGrid.from_distances(distances, kept, far)
        return grid, grid.costs_to_go(goal, grid.prices(_NEARNESS))

    def _ways_left(self, points: FloatArray) -> FloatArray:
        """Return the lengths of ways of the tip from points (m, n, 3) to the goal, with a price on nearness, (m, n)."""
        grid, costs = self._grid
        if costs is None:
            return np.asarray(np.linalg.norm(points - self.problem.goal.tip(self.arm), axis=-1))
        cells = np.rint((points - grid.low) / grid.cell).astype(np.intp)
        inside = np.all((cells >= 0) & (cells < grid.gaps.shape), axis=-1)
        x, y, z = np.moveaxis(np.where(inside[..., None], cells, 0), -1, 0)
        return np.where(inside, costs[x, y, z], np.inf)

    def _stands_free(self, values: FloatArray) -> bool:
        q = self._at(values)
        return self.certificate.safe(q, q)

    def _at(self, values: FloatArray) -> FloatArray:
        """Return the configuration of the start with the axes at other positions, shape (c,)."""
        q = self.start.copy()
        q[self.arm.coordinates.base] = values
        return q

    # ------------------------------------------------------------ ways of the axes
    def way_to(self, values: FloatArray, deadline: Deadline) -> list[FloatArray] | None:
        """Return positions of the axes between which they may move evenly from the start to given ones, or None.

        Straight motions are tried first, then trees from both ends (RRT-Connect; Kuffner and LaValle, 2000).
        """
        start = self.start[self.arm.coordinates.base]
        if np.array_equal(start, values):
            return [start]
        if self._free_between(start, values):
            return [start, values]
        # One axis after the other, and all but one before and after it.
        for order in itertools.islice(itertools.permutations(range(len(values))), 24):
            way = [start]
            for axis in order:
                corner = way[-1].copy()
                corner[axis] = values[axis]
                if not np.array_equal(corner, way[-1]):
                    way.append(corner)
            if all(self._free_between(*pair) for pair in itertools.pairwise(way)):
                return way
        return self._grown(start, values, deadline)

    def _free_between(self, before: FloatArray, after: FloatArray) -> bool:
        return self.certificate.safe(self._at(before), self._at(after))

    def _grown(self, start: FloatArray, values: FloatArray, deadline: Deadline) -> list[FloatArray] | None:
        base = self.arm.coordinates.base
        low, high = self.arm.lower_limits[base], self.arm.upper_limits[base]
        random = np.random.default_rng(self.problem.planner.seed)
        trees = (_Tree([start], [-1]), _Tree([values], [-1]))
        for turn in range(_BRANCHES):
            if deadline.passed():
                return None
            one, other = trees[turn % 2], trees[1 - turn % 2]
            grown = one.extend(random.uniform(low, high), high - low, self._free_between)
            if grown is None:
                continue
            while (met := other.extend(one.places[grown], high - low, self._free_between)) is not None:
                if np.array_equal(other.places[met], one.places[grown]):
                    first, last = (grown, met) if turn % 2 == 0 else (met, grown)
                    way = trees[0].back(first)[::-1] + trees[1].back(last)[1:]
                    return self._shortened(way)
        return None

    def _shortened(self, way: list[FloatArray]) -> list[FloatArray]:
        """Return a way without the places that straight motions between others make superfluous."""
        short = [way[0]]
        k = 0
        while k < len(way) - 1:
            k = next(j for j in range(len(way) - 1, k, -1) if j == k + 1 or self._free_between(way[k], way[j]))
            short.append(way[k])
        return short

    # ------------------------------------------------------------ the arm at a place
    def standing(self, values: FloatArray, time_limit: float) -> Problem:
        """Return the problem of the arm alone from where the axes have brought it.

        Args:
            values: positions of the axes, shape (k,) [m, rad].
            time_limit: time limit of its planning [s].
        """
        problem, arm = self.problem, self.arm
        fed, place = self.fed, values.copy()
        if fed:
            place[-1] = 0.0
        frames = arm.carried(self._at(place))
        last = arm.carrier[-1]
        alone = replace(
            arm,
            base=frames.place,
            direction=frames.rotation[:, 0],
            up=frames.rotation[:, 2],
            carrier=(),
            feed=Feed(last.low, last.high, last.high) if fed else None,
        )
        bounds, limits = problem.limits.axes, replace(problem.limits, axes=None)
        if fed and bounds is not None:
            limits = replace(
                limits, feed_velocity=float(bounds.velocity[-1]), feed_acceleration=float(bounds.acceleration[-1])
            )
        at = float(values[-1]) if fed else 0.0
        goal = problem.goal
        if goal.for_joints is not None:
            goal = JointPose(goal.for_joints.bends, at)
        return replace(
            problem,
            arm=alone,
            limits=limits,
            start=JointPose(problem.start.bends, at),
            goal=goal,
            planner=replace(problem.planner, time_limit=time_limit),
        )

    def from_place(self, rows: FloatArray) -> FloatArray | None:
        """Return the part of a motion (K, c) from the place to which the axes bring the arm, or None without such.

        Until then the joints rest in the pose of the start, and from then on the axes but one that feeds the arm.
        """
        resting = rows[:, self.arm.coordinates.base][:, : len(self.arm.carrier) - self.fed]
        moved = np.flatnonzero(np.any(np.abs(resting - resting[-1]) > _SAME, axis=1))
        first = int(moved[-1]) + 1 if len(moved) else 0
        bends = self.arm.coordinates.bends
        return rows[first:] if np.max(np.abs((rows[first] - self.start)[bends])) <= _SAME else None

    def of_arm_alone(self, rows: FloatArray) -> FloatArray:
        """Return configurations (K, c) without the axes that rest while the arm moves, shape (K, c')."""
        bends = self.arm.coordinates.joints
        return np.concatenate((rows[:, :bends], rows[:, rows.shape[1] - self.fed :]), axis=1)

    def lifted(self, path: JointPath, values: FloatArray) -> JointPath:
        """Return a path of the arm alone as one of arm and axes, which rest but for one that feeds the arm.

        Args:
            path: path of the problem ``standing`` at these positions.
            values: positions of the axes, shape (k,) [m, rad].
        """
        resting = values[:-1] if self.fed else values
        bends = self.arm.coordinates.joints

        def with_axes(rows: FloatArray) -> FloatArray:
            between = np.broadcast_to(resting, (*rows.shape[:-1], len(resting)))
            return np.concatenate((rows[..., :bends], between, rows[..., bends:]), axis=-1)

        spline = path.spline
        return replace(
            path,
            spline=BSpline(spline.t, with_axes(spline.c), spline.k),
            keyframes=with_axes(path.keyframes),
            parts=tuple(self.lifted(part, values) for part in path.parts),
            lacking=0.0,
            further=None,
        )

    def joined(self, way: Sequence[FloatArray], after: JointPath) -> JointPath:
        """Return a path along straight motions of the axes, and then another path."""
        straight = [self._straight(*pair) for pair in itertools.pairwise(way)]
        if not straight:
            return after
        parts = (*straight, *(after.parts or (after,)))
        splines = [part.spline for part in parts]
        degree = splines[0].k
        knots, control = splines[0].t, splines[0].c
        for number, spline in enumerate(splines[1:], start=1):
            knots = np.concatenate((knots[:-1], spline.t[spline.k + 1 :] + number))
            control = np.concatenate((control, spline.c[1:]))
        return replace(
            after,
            spline=BSpline(knots / len(parts), control, degree),
            keyframes=np.concatenate([part.keyframes for part in parts]),
            candidate=f"positioned, then {after.candidate}",
            curves=(),
            spare=0.0,
            parts=parts,
        )

    def _straight(self, before: FloatArray, after: FloatArray) -> JointPath:
        ends = np.stack((self._at(before), self._at(after)))
        knots = np.repeat([0.0, 1.0], _DEGREE + 1)
        # Both ends are exact: an axis that stands at its limit does not exceed it by rounding.
        control = np.linspace(ends[0], ends[1], _DEGREE + 1)
        return JointPath(BSpline(knots, control, _DEGREE), ends, (), "base axes")


@dataclass
class _Tree:
    """Tree of positions of axes, each reached by a straight motion from its parent.

    Attributes:
        places: positions, each of shape (k,).
        parents: index of each one's parent; −1 for the root.
    """

    places: list[FloatArray]
    parents: list[int]

    def extend(self, to: FloatArray, ranges: FloatArray, free: Callable[[FloatArray, FloatArray], bool]) -> int | None:
        """Grow by one step towards a place; return the index of the new node, or None if something is in the way."""
        away = (np.array(self.places) - to) / ranges
        near = int(np.argmin(np.sum(away**2, axis=1)))
        far = float(np.max(np.abs(away[near])))
        if far == 0.0:
            return near
        place = to if far <= _STEP else self.places[near] + _STEP / far * (to - self.places[near])
        if not free(self.places[near], place):
            return None
        self.places.append(place)
        self.parents.append(near)
        return len(self.places) - 1

    def back(self, node: int) -> list[FloatArray]:
        """Return the places from a node back to the root."""
        places = []
        while node >= 0:
            places.append(self.places[node])
            node = self.parents[node]
        return places
