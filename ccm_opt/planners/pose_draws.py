"""Cheap poses at the goal that cross nothing: drawn from the normal distribution of the objective without walls.

The best pose of all usually lies in some class that the search did not come by. What the goal-pose NLP minimises is,
walls and torque left aside, a quadratic form; with the tip at the goal it has a few minima, one for each number of
whole turns and each elbow. Poses are drawn about these with costs up to what is known already, brought onto the goal,
and those that cross a wall or themselves are thrown away. The cheapest that are left begin in the classes that are
worth a solution of the NLP.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from ccm_opt.freespace.wall_segments import WallSegments
from ccm_opt.ground.angles import WHOLE_TURN
from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.motion.link_space import fit_coordinates
from ccm_opt.planners.pose_draw_settings import PoseDrawSettings
from ccm_opt.planners.pose_energy import PoseEnergy
from ccm_opt.planners.tip_equations import TipEquations


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
        costs = np.where(self._there(equations, self.energy.space.headings(v)), self.energy.cost(v), np.inf)
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
        change, multipliers = equations.correction(self.energy.space.headings(v), self.energy.inverse, down)
        step = self._shortened(down + change)
        price = np.maximum(settings.forgetting * price, settings.penalty * np.abs(multipliers).max(axis=1))
        tried = v + np.array(settings.line)[:, None, None] * step
        miss = np.abs(equations.miss(self.energy.space.headings(tried))).sum(axis=-1)
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
        return self.energy.space.headings(found[order])

    def _batch(self, pose: CheapestPose, cost: float) -> FloatArray:
        """The same, drawn once about one of them."""
        settings = self.settings
        space = self.energy.space
        shares = self._rng.uniform(0.0, settings.spread, settings.draws)
        shares[0] = 0.0
        v = self.energy.drawn(self._rng, pose.coordinates, shares * (cost - pose.cost))
        equations = self._equations(np.full(len(v), pose.heading))
        for _ in range(settings.newton_steps):
            v = v + self._shortened(equations.correction(space.headings(v), self.energy.inverse)[0])
        v = v[self._there(equations, space.headings(v)) & (self.energy.cost(v) < cost)]
        return v[self._crossing_nothing(space.headings(v))]

    def _shortened(self, step: FloatArray) -> FloatArray:
        """Steps that turn no link too far, shape (m, p)."""
        turns = np.abs(step @ self.energy.space.matrix.T).max(axis=1)
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
        return fit_coordinates(space.matrix, headings - space.offset, space.arm.length)
