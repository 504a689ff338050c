"""Poses drawn at the goal, by class.

The best pose of all usually lies in some class that the search did not come by. What the goal-pose NLP minimises is,
walls and torque left aside, a quadratic form; with the tip at the goal it has a few minima, one for each number of
whole turns and each elbow. Poses are drawn about these with costs up to what is known already, brought onto the goal,
and those that cross a wall or themselves are thrown away. The cheapest that are left begin in the classes that are
worth a solution of the NLP.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.polyline import WHOLE_TURN
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose_energy import PoseEnergy
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.walls import WallSegments
from ccm_opt.scene.workspace import Workspace


@dataclass(frozen=True)
class PoseDrawSettings:
    """How poses at the goal are drawn.

    Attributes:
        starts: random poses for each number of whole turns of the tip, from which the cheapest poses without walls are
            looked for (measured: in clutter 40 find what 100 find, 12 not always).
        start_cost: mean cost of these starts above the least, in units of the objective (taste).
        descents: steps of the descent to the cheapest pose without walls (measured: 20 converge).
        line: shares of a step of the descent that are tried at once (taste).
        longest_turn: largest turn of a link in one step [rad] (taste).
        whole_turns: whole turns of the tip to either side of its heading at the start that are looked at (taste).
        draws: poses drawn about each of the cheapest poses at once (measured: in clutter a tenth cross nothing).
        batches: how often they are drawn while none of them crosses nothing (taste).
        newton_steps: that bring a drawn pose onto the goal (measured: eight bring nine of ten there).
        spread: costs of the poses drawn reach from the least to this share of what they have to stay below (taste).
        near_enough: distance from the goal, in units of the arm's length, at which a drawn pose is a start (taste).
        kept_off: share of the radius that the axis of a start keeps from walls; the NLP brings the rest (taste).
        penalty: price of missing the goal in the descent, over the largest multiplier (as in any exact penalty).
        forgetting: share of that price that stays from step to step (taste).
        drawn_solutions: drawn starts that are solved from, of different classes where there are (measured by
            ``tests.benchmarks.bench_goal_poses``).
    """

    starts: int = 40
    start_cost: float = 3.0
    descents: int = 20
    line: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1)
    longest_turn: float = 0.6
    whole_turns: int = 1
    draws: int = 200
    batches: int = 3
    newton_steps: int = 8
    spread: float = 1.5
    near_enough: float = 1e-4
    kept_off: float = 0.3
    penalty: float = 2.0
    forgetting: float = 0.7
    drawn_solutions: int = 2


TINY_SHARE = 1e-9
"""Added to the equations' matrix, which has no inverse at full stretch."""


@dataclass(frozen=True, eq=False)
class TipEquations:
    """The tip at a place, with a heading if one is given.

    Attributes:
        space: coordinates of the poses.
        position: shape (2,) [m].
        heading: of each pose's tip, whole turns included, shape (m,) [rad], or None.
    """

    space: LinkSpace
    position: FloatArray
    heading: FloatArray | None

    def take(self, poses: IntArray) -> "TipEquations":
        """The equations of some of the poses, shape (k,)."""
        return replace(self, heading=None if self.heading is None else self.heading[poses])

    def miss(self, headings: FloatArray) -> FloatArray:
        """What poses lack of the goal, in arm lengths and radians, shape (..., m, links) to (..., m, 2 or 3)."""
        arm = self.space.arm
        reached = np.stack((np.cos(headings).mean(axis=-1), np.sin(headings).mean(axis=-1)), axis=-1)
        short: FloatArray = (self.position - arm.base) / arm.length - reached
        if self.heading is None:
            return short
        turn = self.heading - headings[..., -1]
        return np.concatenate((short, turn[..., None]), axis=-1)

    def rows(self, headings: FloatArray) -> FloatArray:
        """Derivatives of what is reached by the coordinates, shape (m, links) to (m, 2 or 3, p)."""
        matrix = self.space.turns
        links = self.space.arm.links
        place = np.stack((-np.sin(headings) @ matrix, np.cos(headings) @ matrix), axis=1) / links
        if self.heading is None:
            return place
        last = np.broadcast_to(matrix[-1:], (len(headings), 1, matrix.shape[1]))
        return np.concatenate((place, last), axis=1)

    def correction(
        self, headings: FloatArray, inverse: FloatArray, step: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """The least change of coordinates, by a metric, that solves the linearised equations beside another step.

        Args:
            headings: shape (m, links) [rad].
            inverse: of the metric, shape (p, p).
            step: already to be taken, shape (m, p).

        Returns:
            The change, shape (m, p), and its multipliers, shape (m, 2 or 3).
        """
        rows = self.rows(headings)
        miss = self.miss(headings)
        if not isinstance(step, float):
            miss = miss - np.einsum("mkp,mp->mk", rows, step)
        spread = inverse @ rows.transpose(0, 2, 1)
        matrix = rows @ spread
        ridge = TINY_SHARE * np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(matrix.shape[1])
        multipliers = np.linalg.solve(matrix + ridge, miss[:, :, None])
        return (spread @ multipliers)[..., 0], multipliers[..., 0]


@dataclass(frozen=True, eq=False)
class CheapestPose:
    """The cheapest pose at the goal without walls, among those with as many whole turns of the tip.

    Attributes:
        cost: its energy.
        coordinates: shape (p,).
        heading: of the tip, whole turns included [rad]; NaN where any will do.
    """

    cost: float
    coordinates: FloatArray
    heading: float


@dataclass(frozen=True, eq=False)
class PoseDraws:
    """Draws poses at the goal.

    Attributes:
        energy: of poses.
        walls: what they must not cross.
        position: of the tip, shape (2,) [m].
        heading: of the tip [rad], or None.
        near: link headings of the pose that distance counts from, shape (links,) [rad].
        start: link headings of a pose at the goal, shape (links,) [rad].
        seed: of the random numbers.
        settings: numbers.
    """

    energy: PoseEnergy
    walls: WallSegments
    position: FloatArray
    heading: float | None
    near: FloatArray
    start: FloatArray
    seed: int = 0
    settings: PoseDrawSettings = field(default_factory=PoseDrawSettings)

    def cheapest_below(self, cost: float) -> tuple[CheapestPose, ...]:
        """The cheapest pose without walls for each number of whole turns of the tip that has one below a cost."""
        tips = self._tips(cost)
        if len(tips) == 0:
            return ()
        settings = self.settings
        v = np.tile(self._starts(), (len(tips), 1))
        of_tip = np.repeat(np.arange(len(tips)), len(v) // len(tips))
        equations = self._equations(tips[of_tip])
        price = np.zeros(len(v))
        for _ in range(settings.descents):
            v, price = self._descent(equations, v, price)
        costs = np.where(self._there(equations, self.energy.headings(v)), self.energy.cost(v), np.inf)
        found = []
        for tip, heading in enumerate(tips):
            best = int(np.argmin(np.where(of_tip == tip, costs, np.inf)))
            if costs[best] < cost:
                found.append(CheapestPose(float(costs[best]), v[best], float(heading)))
        return tuple(found)

    @cached_property
    def _rng(self) -> np.random.Generator:
        return np.random.default_rng(self.seed)

    def _tips(self, cost: float) -> FloatArray:
        """Headings of the tip with every number of whole turns that can be cheaper than a cost, shape (k,) [rad].

        NaN, once, where any heading will do.
        """
        if self.heading is None:
            return np.array([np.nan])
        nearest = self.heading + WHOLE_TURN * np.round((self.near[-1] - self.heading) / WHOLE_TURN)
        turns = WHOLE_TURN * np.arange(-self.settings.whole_turns, self.settings.whole_turns + 1)
        return np.array([tip for tip in nearest + turns if self.energy.least_with_heading(tip) < cost])

    def _equations(self, headings: FloatArray) -> TipEquations:
        return TipEquations(self.energy.space, self.position, None if self.heading is None else headings)

    def _starts(self) -> FloatArray:
        """Coordinates from which the cheapest poses are looked for, shape (m, p)."""
        ends = np.array([self._coordinates(self.near), self._coordinates(self.start)])
        costs = np.full(self.settings.starts, self.settings.start_cost)
        return np.concatenate((ends, self.energy.drawn(self._rng, ends[0], costs)))

    def _descent(self, equations: TipEquations, v: FloatArray, price: FloatArray) -> tuple[FloatArray, FloatArray]:
        """One step of sequential quadratic programming for many poses, each as far as its merit falls most.

        The merit is the energy and, at a price a little above the multipliers, what the tip misses: an exact penalty.
        """
        settings = self.settings
        down = self.energy.descent(v)
        change, multipliers = equations.correction(self.energy.headings(v), self.energy.inverse, down)
        step = self._shortened(down + change)
        price = np.maximum(settings.forgetting * price, settings.penalty * np.abs(multipliers).max(axis=1))
        tried = v + np.array(settings.line)[:, None, None] * step
        miss = np.abs(equations.miss(self.energy.headings(tried))).sum(axis=-1)
        best = np.argmin(self.energy.cost(tried) + price * miss, axis=0)
        return tried[best, np.arange(len(v))], price

    def about(self, cheapest: tuple[CheapestPose, ...], cost: float) -> FloatArray:
        """Link headings of poses that cross nothing and cost less, the cheapest first, shape (m, links) [rad].

        Args:
            cheapest: poses about which they are drawn, at least one.
            cost: to stay below.
        """
        for _ in range(self.settings.batches):
            found = np.concatenate([self._batch(pose, cost) for pose in cheapest])
            if len(found):
                break
        order = np.argsort(self.energy.cost(found), kind="stable")
        return self.energy.headings(found[order])

    def _batch(self, pose: CheapestPose, cost: float) -> FloatArray:
        """The same, drawn once about one of them."""
        settings = self.settings
        shares = self._rng.uniform(0.0, settings.spread, settings.draws)
        shares[0] = 0.0
        v = self.energy.drawn(self._rng, pose.coordinates, shares * (cost - pose.cost))
        equations = self._equations(np.full(len(v), pose.heading))
        for _ in range(settings.newton_steps):
            v = v + self._shortened(equations.correction(self.energy.headings(v), self.energy.inverse)[0])
        v = v[self._there(equations, self.energy.headings(v)) & (self.energy.cost(v) < cost)]
        return v[self._crossing_nothing(self.energy.headings(v))]

    def _shortened(self, step: FloatArray) -> FloatArray:
        """Steps that turn no link too far, shape (m, p)."""
        turns = np.abs(step @ self.energy.space.turns.T).max(axis=1)
        shortened: FloatArray = step * np.minimum(1.0, self.settings.longest_turn / np.maximum(turns, 1e-12))[:, None]
        return shortened

    def _there(self, equations: TipEquations, headings: FloatArray) -> BoolArray:
        """Which poses are at the goal and within the joint limits, shape (m, links) to (m,)."""
        arm = self.energy.space.arm
        there: BoolArray = np.abs(equations.miss(headings)).max(axis=1) < self.settings.near_enough
        within: BoolArray = np.all(np.abs(arm.bends(headings)) <= arm.bend_limits, axis=1)
        return there & within

    def _crossing_nothing(self, headings: FloatArray) -> BoolArray:
        """Which poses cross neither a wall nor themselves, shape (m, links) to (m,)."""
        arm = self.energy.space.arm
        free = np.ones(len(headings), dtype=bool)
        if len(headings) == 0:
            return free
        points = arm.joint_positions(headings)
        off = self.settings.kept_off * arm.radius
        axes: Any = shapely.linestrings(self._behind_mount(points))
        rounding = self.walls.rounding
        meeting, wall = self.walls.tree.query(axes, predicate="dwithin", distance=off + rounding.max(initial=0.0))
        gaps = shapely.distance(axes[meeting], self.walls.tree.geometries[wall]) - rounding[wall]
        free[meeting[gaps < off]] = False
        if arm.self_collision:
            free &= shapely.is_simple(shapely.linestrings(points))
        return free

    def _behind_mount(self, points: FloatArray) -> FloatArray:
        """Where the mount ends and all joints behind it, shape (m, k, 2) [m]."""
        link, share = self.energy.space.arm.mount_end
        end = points[:, link] + share * (points[:, link + 1] - points[:, link])
        return np.concatenate((end[:, None], points[:, link + 1 :]), axis=1)

    def _coordinates(self, headings: FloatArray) -> FloatArray:
        space = self.energy.space
        return space.nearest(space.arm.bends(headings))


HALF_TURN = np.pi
"""Poses whose last links differ by more than this differ by a whole turn."""


def landmarks(workspace: Workspace) -> FloatArray:
    """A point in every obstacle, shape (m, 2) [m]."""
    inside = [shapely.get_coordinates(shapely.point_on_surface(obstacle.core))[0] for obstacle in workspace.obstacles]
    return np.array(inside).reshape(-1, 2)


def same_class(arm: Arm, obstacles: FloatArray, first: FloatArray, second: FloatArray) -> bool:
    """Whether two poses with the tip in one place have the same whole turns and no obstacle between their axes.

    The axis of one and back along the other is a closed loop. Obstacles that it winds round are passed on different
    sides; a loop round two of them that undoes itself is not told apart from none.

    Args:
        arm: the arm.
        obstacles: a point in every obstacle, from ``landmarks``, shape (m, 2) [m].
        first: link headings, shape (links,) [rad].
        second: likewise.
    """
    if abs(float(first[-1] - second[-1])) > HALF_TURN:
        return False
    there = arm.joint_positions(first)
    back = arm.joint_positions(second)[::-1]
    loop = np.concatenate((there, back, there[:1]))
    return not np.any(windings(loop, obstacles))


def windings(loop: FloatArray, points: FloatArray) -> FloatArray:
    """How often a closed polyline goes round points, (k, 2) and (m, 2) to (m,)."""
    apart = loop - points[:, None]
    headings = np.arctan2(apart[..., 1], apart[..., 0])
    turns = np.diff(headings, axis=1)
    wrapped = (turns + np.pi) % (2.0 * np.pi) - np.pi
    whole: FloatArray = np.round(wrapped.sum(axis=1) / (2.0 * np.pi))
    return whole
