"""Paths for a leader: the feed axis to beyond the hole, then a curve to the goal that the arm can follow.

Elastic bands are tried first. Where they are too short or bend too much, configurations of the continuous curve are
asked for (section 4.1 of the paper and the multiple-shooting NLP), only that the base is a place on the feed axis and
the length is free within what the range of the feed leaves.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.errors import ConfigurationNotFound
from ccm_opt.freespace.corridor import Route
from ccm_opt.freespace.free_space import FreeSpace
from ccm_opt.ground.angles import unit_vector
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.ground.length_words import long_length
from ccm_opt.ground.polyline import path_length
from ccm_opt.ground.rounding import SHORTEST
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.link_chain import Feed
from ccm_opt.nlp.configuration_task import ConfigurationTask
from ccm_opt.nlp.find_configuration import find_configuration
from ccm_opt.planners.feed.feed_settings import DEFAULT_FEED, FeedPlannerSettings
from ccm_opt.planners.following.elastic_band import ElasticBand
from ccm_opt.planners.following.leader import LeaderPath
from ccm_opt.planners.following.path_of_shape import path_through
from ccm_opt.problem import Problem, TipGoal


@dataclass(frozen=True)
class Reach:
    """Between which arc lengths a leader's path has to end, so that the base is in the range of the feed then [m]."""

    least: float
    most: float

    @classmethod
    def from_feed(cls, arm: Arm, feed: Feed) -> "Reach":
        """The bounds for an arm on a feed axis."""
        return cls(feed.low + arm.length, feed.high + arm.length)


@dataclass
class LeaderPaths:
    """Finds paths for the leader of one problem.

    Attributes:
        problem: with a feed axis.
        goal: where the tip has to arrive.
        deadline: when to stop.
        settings: of the planner.
        shortest: length of the shortest route seen, from the arm's own base position [m]; for the diagnosis.
        refusals: why the NLP found no curve, one line each.
    """

    problem: Problem
    goal: TipGoal
    deadline: Deadline
    settings: FeedPlannerSettings = DEFAULT_FEED
    shortest: float = np.inf
    refusals: tuple[str, ...] = ()

    def bands(self, straight: float, reach: Reach) -> Iterator[LeaderPath]:
        """Taut routes drawn smooth, shortest first: quick, and at home in narrow ducts.

        Args:
            straight: arc length at which the path may leave the axis [m].
            reach: between which arc lengths it has to end.
        """
        longest = reach.most * (1.0 + self.settings.leaders.chord_allowance)
        seen = set[float]()
        for free_space, routes in self._routes_in_free_spaces(straight, reach):
            for k, route in enumerate(routes, start=1):
                for margin in self._band_margins:
                    path = self._band(free_space, route, straight, margin, f"band {k}")
                    # In a duct all margins give the same band; bands are told apart by their length.
                    length = round(path.end, 6)
                    if reach.least <= path.end <= longest and length not in seen:
                        seen.add(length)
                        yield path

    def curves(self, straight: float, reach: Reach, most: int) -> Iterator[LeaderPath]:
        """Configurations of the continuous curve, shortest first; they may be longer than their route is.

        Args:
            straight: arc length at which the path may leave the axis [m].
            reach: between which arc lengths it has to end.
            most: how many are asked for at most.
        """
        begin, end = self._curve_ends(straight)
        candidates = islice(self._curve_candidates(straight, reach), most)
        for k, (free_space, route, length) in enumerate(candidates, start=1):
            if self.deadline.passed():
                return
            curve = self._curve(free_space, route, begin, end, length)
            if curve is not None:
                yield self._path(straight, curve, f"curve {k} of {long_length(length)}")

    @property
    def _band_margins(self) -> tuple[float, ...]:
        """What bands keep beyond radius and clearance, widest first [m].

        With short links, shares of them leave less room than is wanted, and turns as tight round corners.
        """
        settings = self.settings.leaders
        margins = self.problem.arm.link_length * np.array(settings.band_margins)
        wanted = settings.band_gap * self.problem.wanted_gap
        return (wanted, *margins) if wanted > margins[0] else tuple(margins)

    def _band(self, free_space: FreeSpace, route: Route, straight: float, margin: float, name: str) -> LeaderPath:
        """A band from the feed axis along a route to the goal; with a heading there the last link is straight."""
        arm = self.problem.arm
        settings = self.settings.leaders
        band = ElasticBand(
            walls=self.problem.workspace.flat_walls,
            least=arm.radius + self.problem.workspace.clearance + margin,
            chord=arm.link_length,
            curvature_limit=self._curvature_limit,
            spacing=max(settings.band_spacing * arm.link_length, settings.least_band_spacing * arm.length),
            evenness=settings.band_evenness * arm.length,
            settings=self.settings.following.band,
        )
        begin, end = self._curve_ends(straight)
        # Routes are drawn with a distance from corners; the band finds its own.
        taut = free_space.path_of_sleeve(route.sleeve, begin, end)
        points = band.smoothed(taut, (arm.base_heading, self.goal.heading))[1:]
        if self._last_link > 0.0:
            points = np.vstack((points, self.goal.position))
        return path_through(arm, straight, points, name, self.goal.heading, self.settings.following)

    def _curve_candidates(self, straight: float, reach: Reach) -> Iterator[tuple[FreeSpace, Route, float]]:
        """Free space, a route through it and a length of the curve, in the order they are tried."""
        for free_space, routes in self._routes_in_free_spaces(straight, reach):
            for route, length in self._lengths(routes, straight, reach):
                yield free_space, route, length

    def _routes_in_free_spaces(self, straight: float, reach: Reach) -> Iterator[tuple[FreeSpace, tuple[Route, ...]]]:
        """Free space with less and less margin, and the routes through it."""
        begin, end = self._curve_ends(straight)
        for margin in self.settings.leaders.free_space_margins:
            free_space = self._free_space(margin)
            if free_space.contains(np.stack((begin, end))).all():
                yield free_space, self._routes(free_space, begin, end, reach.most - straight)

    @property
    def _curvature_limit(self) -> float:
        """What paths may bend [1/m]: chords of a link on an arc of curvature κ bend by 2 asin(κ l/2)."""
        arm = self.problem.arm
        tightest = 2.0 * np.sin(0.5 * min(arm.joint_limit, np.pi))
        return float(self.settings.leaders.curvature_share * tightest / arm.link_length)

    def _free_space(self, margin: float) -> FreeSpace:
        """Free space with a margin, as a share of a link's sagitta at its joint limit, beyond radius and clearance."""
        arm = self.problem.arm
        workspace = self.problem.workspace
        sagitta = 0.125 * arm.joint_limit * arm.link_length  # κ l²/8 with κ = limit / l
        # Without any inflation, free space would touch itself at corners.
        return FreeSpace(workspace, max(arm.radius + workspace.clearance + margin * sagitta, SHORTEST))

    def _curve_ends(self, straight: float) -> tuple[FloatArray, FloatArray]:
        """Where the curve begins and ends; with a goal heading the last link lies straight behind the goal."""
        arm = self.problem.arm
        heading = self.goal.heading or 0.0
        back = self._last_link * unit_vector(heading)
        return arm.base + straight * arm.feed_direction, self.goal.position - back

    @property
    def _last_link(self) -> float:
        """Length behind the goal that the path runs straight, so that the last link takes the goal's heading [m]."""
        return 0.0 if self.goal.heading is None else self.problem.arm.link_length

    def _routes(self, free_space: FreeSpace, begin: FloatArray, end: FloatArray, longest: float) -> tuple[Route, ...]:
        """Routes between two points whose paths are not longer than ``longest`` [m]."""
        corner_distance = self.settings.curve.corner_distance * self.problem.arm.length
        routes = free_space.routes(begin, end, self.problem.planner.routes, shrink=corner_distance)
        if routes:
            before = float(np.hypot(*(begin - self.problem.arm.base)))
            self.shortest = min(self.shortest, before + routes[0].length + self._last_link)
        return tuple(route for route in routes if route.length + self._last_link <= longest)

    def _lengths(self, routes: tuple[Route, ...], straight: float, reach: Reach) -> list[tuple[Route, float]]:
        """Routes with lengths of the curve to try along them, shortest first."""
        settings = self.settings.leaders
        least = (reach.least - straight - self._last_link) * (1.0 + settings.chord_allowance)
        most = reach.most - straight - self._last_link
        pairs: list[tuple[Route, float]] = []
        for route in routes:
            lengths = np.clip(route.length * np.array(settings.curve_stretches), least, most)
            # Clipping makes several alike; rounding finds them.
            longer = np.unique(np.round(lengths[lengths > route.length], 9))
            pairs.extend((route, float(length)) for length in longer)
        return sorted(pairs, key=lambda pair: pair[1])

    def _curve(
        self, free_space: FreeSpace, route: Route, begin: FloatArray, end: FloatArray, length: float
    ) -> Configuration | None:
        """A configuration of the curve of some length along a route, or None when the NLP finds none."""
        arm = self.problem.arm
        taut = free_space.path_of_sleeve(route.sleeve, begin, end)
        task = ConfigurationTask(
            base=begin,
            base_heading_range=(arm.base_heading, arm.base_heading),
            length=length,
            curvature_limit=self._curvature_limit,
            goal=end,
            goal_heading=self.goal.heading,
            corridor=free_space.corridor(Route(route.sleeve, taut, path_length(taut))),
            settings=self.settings.curve.configuration,
        )
        try:
            return find_configuration(task, self.settings.leaders.curve_attempts)
        except ConfigurationNotFound as refused:
            self.refusals = (*self.refusals, refused.diagnosis.reason)
            return None

    def _path(self, straight: float, curve: Configuration, name: str) -> LeaderPath:
        """The feed axis, the curve and the last link, sampled."""
        arm = self.problem.arm
        spacing = arm.link_length / self.settings.following.samples_per_link
        on_curve = np.linspace(0.0, curve.length, max(2, int(np.ceil(curve.length / spacing))) + 1)

        first = min(arm.base_range[0], 0.0) - arm.link_length
        on_axis = np.arange(first, straight - 0.5 * spacing, arm.link_length)

        points = [arm.base + on_axis[:, None] * arm.feed_direction, curve.positions_at(on_curve)]
        headings = [np.full(len(on_axis), arm.base_heading), curve.heading_at(on_curve)]
        arcs = [on_axis, straight + on_curve]
        if self._last_link > 0.0:
            points.append(self.goal.position[None])
            headings.append(headings[-1][-1:])
            arcs.append(arcs[-1][-1:] + self._last_link)
        return LeaderPath(
            np.concatenate(arcs),
            np.concatenate(points),
            np.concatenate(headings),
            straight,
            name,
            self.settings.following.chords,
        )
