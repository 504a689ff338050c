"""Paths for a leader: the feed axis to beyond the hole, then a curve to the goal that the arm can follow.

Elastic bands are tried first. Where they are too short or bend too much, configurations of the continuous curve are
asked for (section 4.1 of the paper and the multiple-shooting NLP), only that the base is a place on the feed axis and
the length is free within what the range of the feed leaves.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.collision.walls import Walls
from ccm_opt.continuum.configuration import Configuration
from ccm_opt.errors import ConfigurationNotFound
from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.geometry.polygons import path_length
from ccm_opt.jointed.arm import Arm, Feed
from ccm_opt.motion.continuation import Deadline
from ccm_opt.nlp.configuration_task import ConfigurationTask
from ccm_opt.nlp.find_configuration import find_configuration
from ccm_opt.planners.curve import CORNER_DISTANCE
from ccm_opt.planners.following.elastic_band import ElasticBand
from ccm_opt.planners.following.leader import FINENESS, LeaderPath
from ccm_opt.planners.following.path_of_shape import path_through
from ccm_opt.problem import Problem, TipGoal

SPARES = (1.0, 0.4, 0.1)
"""Room that free space keeps beyond radius and clearance, as shares of a link's sagitta at its joint limit."""
STRETCHES = (1.03, 1.1, 1.25, 1.5, 2.0)
"""Lengths of the curve that are tried, over that of the taut way."""
ATTEMPTS = 3
"""Attempts of the NLP at one curve."""
CURVATURE_SHARE = 0.9
"""Share of the tightest bend that the curve may use."""
BAND_MARGINS = (0.2, 0.05, 0.01)
"""Room that elastic bands keep beyond radius and clearance where there is so much, in link lengths."""
BAND_SPACING, LEAST_SPACING = 1.0 / 3.0, 1.0 / 96.0
"""Distance between the points of a band, in link lengths; but for many links this share of the arm's length."""
EVENNESS = 1.0 / 16.0
"""Length over which a band's change of curvature weighs as much as its curvature, as a share of the arm's length."""
CHORD_SPARE = 1e-2
"""Share of the curve's length by which chords may be shorter than their arcs."""


@dataclass(frozen=True)
class Reach:
    """Between which arc lengths a leader's path has to end, so that the base is in the range of the feed then [m]."""

    least: float
    most: float

    @classmethod
    def of(cls, arm: Arm, feed: Feed) -> "Reach":
        """The bounds for an arm on a feed axis."""
        return cls(feed.low + arm.length, feed.high + arm.length)


@dataclass
class LeaderPaths:
    """Finds paths for the leader of one problem.

    Attributes:
        problem: with a feed axis.
        goal: where the tip has to arrive.
        deadline: when to stop.
        shortest: length of the shortest way seen, from the arm's own base position [m]; for the diagnosis.
        refusals: why the NLP found no curve, one line each.
    """

    problem: Problem
    goal: TipGoal
    deadline: Deadline
    shortest: float = np.inf
    refusals: tuple[str, ...] = ()

    def bands(self, straight: float, reach: Reach) -> Iterator[LeaderPath]:
        """Taut ways drawn smooth, shortest first: quick, and at home in narrow ducts.

        Args:
            straight: arc length at which the path may leave the axis [m].
            reach: between which arc lengths it has to end.
        """
        seen = set[float]()
        for room, routes in self._routes_in_rooms(straight, reach):
            for (k, route), margin in product(enumerate(routes, start=1), BAND_MARGINS):
                path = self._band(room, route, straight, margin, f"band {k}")
                if reach.least <= path.end <= reach.most * (1.0 + CHORD_SPARE) and round(path.end, 6) not in seen:
                    seen.add(round(path.end, 6))
                    yield path

    def curves(self, straight: float, reach: Reach, most: int) -> Iterator[LeaderPath]:
        """Configurations of the continuous curve, shortest first; they may be longer than their way is.

        Args:
            straight: arc length at which the path may leave the axis [m].
            reach: between which arc lengths it has to end.
            most: how many are asked for at most.
        """
        for k, (room, route, length) in enumerate(islice(self._candidates(straight, reach), most), start=1):
            if self.deadline.passed():
                return
            curve = self._curve(room, route, *self._curve_ends(straight), length)
            if curve is not None:
                yield self._path(straight, curve, f"curve {k} of {length:.3f} m")

    def _band(self, room: FreeSpace, route: Route, straight: float, margin: float, name: str) -> LeaderPath:
        """A band from the feed axis along a route to the goal; with a heading there the last link is straight."""
        arm, (begin, end) = self.problem.arm, self._curve_ends(straight)
        band = ElasticBand(
            Walls.of(self.problem.workspace),
            arm.radius + self.problem.workspace.clearance + margin * arm.link_length,
            arm.link_length,
            self._curvature_limit,
            max(BAND_SPACING * arm.link_length, LEAST_SPACING * arm.length),
            EVENNESS * arm.length,
        )
        taut = room.path_of_sleeve(route.sleeve, begin, end)
        points = band.smoothed(taut, (arm.base_heading, self.goal.heading))
        tail = [self.goal.position] if self._tail else []
        return path_through(arm, straight, np.vstack((points[1:], *tail)), name, self.goal.heading)

    def _candidates(self, straight: float, reach: Reach) -> Iterator[tuple[FreeSpace, Route, float]]:
        """Free space, a route through it and a length of the curve, in the order they are tried."""
        for room, routes in self._routes_in_rooms(straight, reach):
            yield from ((room, *pair) for pair in self._lengths(routes, straight, reach))

    def _routes_in_rooms(self, straight: float, reach: Reach) -> Iterator[tuple[FreeSpace, tuple[Route, ...]]]:
        """Free space with less and less to spare, and the routes through it."""
        for spare in SPARES:
            room, ends = self._room(spare), self._curve_ends(straight)
            if room.contains(np.stack(ends)).all():
                yield room, self._routes(room, *ends, reach.most - straight)

    @property
    def _curvature_limit(self) -> float:
        """What paths may bend [1/m]: chords of a link on an arc of curvature κ bend by 2 asin(κ l/2)."""
        arm = self.problem.arm
        return float(CURVATURE_SHARE * 2.0 * np.sin(0.5 * min(arm.joint_limit, np.pi)) / arm.link_length)

    def _room(self, spare: float) -> FreeSpace:
        arm = self.problem.arm
        sagitta = 0.125 * arm.joint_limit * arm.link_length
        return FreeSpace.of(
            self.problem.workspace, max(arm.radius + self.problem.workspace.clearance + spare * sagitta, 1e-6)
        )

    def _curve_ends(self, straight: float) -> tuple[FloatArray, FloatArray]:
        """Where the curve begins and ends; with a goal heading the last link lies straight behind the goal."""
        arm = self.problem.arm
        return arm.base + straight * arm.feed_direction, self.goal.position - self._tail * self._goal_direction

    @property
    def _tail(self) -> float:
        return 0.0 if self.goal.heading is None else self.problem.arm.link_length

    @property
    def _goal_direction(self) -> FloatArray:
        heading = self.goal.heading or 0.0
        return np.array([np.cos(heading), np.sin(heading)])

    def _routes(self, room: FreeSpace, begin: FloatArray, end: FloatArray, longest: float) -> tuple[Route, ...]:
        shrink = CORNER_DISTANCE * self.problem.arm.length
        routes = room.routes(begin, end, self.problem.planner.routes, shrink=shrink)
        if routes:
            before = float(np.hypot(*(begin - self.problem.arm.base)))
            self.shortest = min(self.shortest, before + routes[0].length + self._tail)
        return tuple(route for route in routes if route.length + self._tail <= longest)

    def _lengths(self, routes: tuple[Route, ...], straight: float, reach: Reach) -> list[tuple[Route, float]]:
        """Routes with lengths of the curve to try along them, shortest first."""
        least = (reach.least - straight - self._tail) * (1.0 + CHORD_SPARE)
        most = reach.most - straight - self._tail
        found = []
        for route in routes:
            lengths = np.clip(route.length * np.array(STRETCHES), least, most)
            lengths = np.unique(np.round(lengths[lengths > route.length], 9))
            found += [(route, float(length)) for length in lengths]
        return sorted(found, key=lambda pair: pair[1])

    def _curve(
        self, room: FreeSpace, route: Route, begin: FloatArray, end: FloatArray, length: float
    ) -> Configuration | None:
        arm = self.problem.arm
        taut = room.path_of_sleeve(route.sleeve, begin, end)
        task = ConfigurationTask(
            base=begin,
            base_heading_range=(arm.base_heading, arm.base_heading),
            length=length,
            curvature_limit=self._curvature_limit,
            goal=end,
            goal_heading=self.goal.heading,
            corridor=room.corridor(Route(route.sleeve, taut, path_length(taut))),
        )
        try:
            return find_configuration(task, ATTEMPTS)
        except ConfigurationNotFound as refused:
            self.refusals = (*self.refusals, refused.diagnosis.reason)
            return None

    def _path(self, straight: float, curve: Configuration, name: str) -> LeaderPath:
        """The feed axis, the curve and the last link, sampled."""
        arm = self.problem.arm
        first = min(arm.feed.low if arm.feed is not None else 0.0, 0.0) - arm.link_length
        spacing = arm.link_length / FINENESS
        inner = np.linspace(0.0, curve.length, max(2, int(np.ceil(curve.length / spacing))) + 1)
        before = np.arange(first, straight - 0.5 * spacing, arm.link_length)
        points = [arm.base + before[:, None] * arm.feed_direction, curve.positions_at(inner)]
        headings = [np.full(len(before), arm.base_heading), curve.heading_at(inner)]
        arcs = [before, straight + inner]
        if self._tail:
            points.append(self.goal.position[None])
            headings.append(headings[-1][-1:])
            arcs.append(arcs[-1][-1:] + self._tail)
        return LeaderPath(np.concatenate(arcs), np.concatenate(points), np.concatenate(headings), straight, name)
