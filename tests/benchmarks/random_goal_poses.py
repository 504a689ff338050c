"""Random poses at a goal for the tip, over all routes, that cross nothing: starts for the goal-pose NLP.

A pose is drawn as headings along the taut path of a route, with bends of random size, number and phase on them, and
random whole turns at both ends; Newton's method brings its tip onto the goal. What crosses a wall or itself is thrown
away, what is merely too near to something is kept: the NLP draws it clear.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.polyline import WHOLE_TURN, arc_lengths, leg_headings, leg_indices, without_repeats, wrap
from ccm_opt.planning.curve_routes import find_routes, route_room
from ccm_opt.planning.ends import Ends
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.problem import Problem
from ccm_opt.scene.corridor import Route

ROUTES = 12
"""Routes that starts are drawn along, at most."""
BATCH = 400
"""Poses that are drawn at once along a route."""
BATCHES = 6
"""Batches along a route, at most."""
WAVES = 5
"""Waves of the heading along the arm that a random pose is made of."""
SWINGS = (0.2, 0.6, 1.2)
"""Sizes of the waves [rad]; every pose draws one of them."""
NEWTON_STEPS = 25
LONGEST_STEP = 0.4
"""Of Newton's method, the largest turn of a link [rad]."""
NEAR = 1e-6
"""What is still called at the goal [m], [rad]."""


@dataclass(frozen=True)
class RandomPoses:
    """Draws poses at the goal of one problem.

    Attributes:
        problem: with a goal for the tip.
        ends: its ends as planning takes them.
        rng: random numbers.
    """

    problem: Problem
    ends: Ends
    rng: np.random.Generator

    def draw(self, count: int) -> list[FloatArray]:
        """Link headings of so many poses, in turn from every route that has some; fewer where few can be drawn."""
        pools = [self._along(route, count) for route in self.routes]
        drawn: list[FloatArray] = []
        for k in range(count):
            drawn += [pool[k] for pool in pools if k < len(pool)]
        return drawn[:count]

    @cached_property
    def routes(self) -> tuple[Route, ...]:
        """Routes from the base to the goal, shortest first."""
        many = replace(self.problem, planner=replace(self.problem.planner, routes=ROUTES))
        room = route_room(many, self.ends)
        return find_routes(many, self.ends, room)

    @cached_property
    def _space(self) -> LinkSpace:
        arm = self.problem.arm
        space, _ = LinkSpace.through(arm, self.ends.start, clamped=self.ends.clamped)
        return replace(space, offset=space.offset if self.ends.clamped else arm.bends(np.zeros(arm.links)))

    def _along(self, route: Route, count: int) -> FloatArray:
        """At most so many poses along one route, shape (m, links)."""
        found: list[FloatArray] = []
        for _ in range(BATCHES):
            headings = self._onto_goal(self._waves_on(route))
            found += list(headings[self._crossing_nothing(headings)])
            if len(found) >= count:
                break
        return np.array(found).reshape(-1, self.problem.arm.links)[:count]

    def _waves_on(self, route: Route) -> FloatArray:
        """Headings of the links along a route with random waves and whole turns, shape (batch, links) [rad]."""
        taut = without_repeats(route.taut, NEAR)
        arcs = arc_lengths(taut)
        places = (np.arange(self.problem.arm.links) + 0.5) / self.problem.arm.links
        along = leg_headings(taut)[leg_indices(arcs, places * arcs[-1])]
        # Whole turns count from the start of the motion, which the objective counts them from.
        along = along + WHOLE_TURN * np.round((self.problem.arm.headings(self.ends.start)[0] - along[0]) / WHOLE_TURN)
        turns = WHOLE_TURN * self.rng.choice((-1.0, 0.0, 0.0, 0.0, 1.0), (BATCH, 1))
        swing = self.rng.choice(SWINGS, (BATCH, 1, 1)) * self.rng.standard_normal((BATCH, WAVES, 1))
        number = 0.5 * np.arange(1, WAVES + 1)[:, None]
        phase = self.rng.uniform(0.0, WHOLE_TURN, (BATCH, WAVES, 1))
        waves = (swing * np.sin(WHOLE_TURN * number * places + phase)).sum(axis=1)
        return along + turns + waves

    def _onto_goal(self, headings: FloatArray) -> FloatArray:
        """Poses of the curve with the tip at the goal, near given headings; those that do not converge are left out."""
        space = self._space
        arm = self.problem.arm
        goal = self.ends.goal
        v = (headings - arm.headings(space.offset)) @ np.linalg.pinv(space.turns).T
        last = headings[:, -1]
        if goal.heading is not None:
            last = last + wrap(goal.heading - last)
        for _ in range(NEWTON_STEPS):
            headings = arm.headings(space.configurations(v))
            rows = space.jacobians(headings)[:, -1]
            miss = goal.position - arm.joint_positions(headings)[:, -1]
            if goal.heading is not None:
                rows = np.concatenate((rows, np.broadcast_to(space.turns[-1:], (len(v), 1, rows.shape[2]))), axis=1)
                miss = np.column_stack((miss, last - headings[:, -1]))
            spread = space.inverse_metric @ rows.transpose(0, 2, 1)
            step = (spread @ np.linalg.solve(rows @ spread + NEAR**2 * np.eye(rows.shape[1]), miss[:, :, None]))[..., 0]
            largest = np.abs(step @ space.turns.T).max(axis=1)
            v = v + step * np.minimum(1.0, LONGEST_STEP / np.maximum(largest, NEAR))[:, None]
        there = np.abs(miss).max(axis=1) < NEAR
        within = np.all(np.abs(arm.bends(headings)) <= arm.bend_limits, axis=1)
        return headings[there & within]

    def _crossing_nothing(self, headings: FloatArray) -> BoolArray:
        """Which poses' axes cross neither a wall nor themselves, shape (m,)."""
        if len(headings) == 0:
            return np.zeros(0, dtype=bool)
        points = self.problem.arm.joint_positions(headings)
        axes = shapely.linestrings(points)
        walls = shapely.union_all([wall.core.buffer(wall.rounding) for wall in self.problem.workspace.walls])
        shapely.prepare(walls)
        simple = shapely.is_simple(axes) if self.problem.arm.self_collision else True
        free: BoolArray = ~shapely.intersects(walls, axes) & simple
        return free
