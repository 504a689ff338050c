"""Generation of tip paths in space, along which the search for a motion leads the tip or the whole arm.

Many lengths are given in nominal links, each a twenty-fourth of the arm's length.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import arc_lengths, path_length, points_at, without_repeats
from ccm_opt.planning.elastic_ways import ElasticBand, ElasticWay
from ccm_opt.planning.followable_ways import FollowableWays, WayEnd
from ccm_opt.planning.grid_ways import TipGrid, shortened
from ccm_opt.planning.guides import ONTO_TRACK, ArmTrack
from ccm_opt.planning.link_chains import CHAIN_GAPS, LinkChains
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.tip_grids import FAR, TipGrids, cells_in_cube, closed_about, prices_near
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import bend_shares

_FOLLOWABLE_CELLS = (200000, 1500000)
"""Numbers of cells of the grids in which paths that a fed arm can follow are sought, in turn."""

_TIGHTEST = 1.5
"""Smallest bend radius of a path, in nominal links, at which the knots of the arm's curve can still represent a right
angle."""
_LIMIT_SHARES = (1.15, 0.75, 1.6)
"""Assumed bend radii, tried in turn, as multiples of that of the circle through the joints of an arm bent to its
limits. The circle that the links touch has cos(limit / 2) of that radius, 0.71 for right angles: with factors below 1,
links reach out of a bend on both sides."""
_APART = 0.9
"""Largest ratio of the smaller to the greater of two bend radii for both to be tried."""

_GRID_MARGINS = (1.0, 0.0)
"""Fractions of the planning margin with which grid cells are free, tried in turn until there is a path."""
_STRAIGHT_ENDS = (3.0, 0.0, 1.5, 6.0)
"""Lengths of the straight end of a path along the goal direction, tried in turn, in nominal links."""

_APPROACHES = (1.0, 0.0)
"""Lengths of the straight end along the goal direction of paths that a fed arm follows, tried in turn, in nominal
links, or in links where these are longer."""
_PRICES = ((3.0, 1.0), (1.0, 0.0))
"""Pairs tried in turn: relative extra cost of a path along a wall, and the fraction of the planning margin with which
grid cells are free."""
_CELLS = (200_000, 1_500_000, 8_000_000)
"""Numbers of cells of the grids in which paths are sought, the coarse one first."""
_NEARNESS = (3.0, 20.0)
"""Relative extra costs of a path along a wall, tried in turn."""
_CLOSE = 0.4
"""Fraction of the planning margin that steps keep after the full margin has failed."""

_CLOSE_ONTO_TRACK = 3.0
"""Weight with which all joints are pulled onto the tip's track if the usual weight fails because walls block the arm;
links that are long relative to the bends of a duct pass with the usual one (measured in pipes and slots with 8 and 12
links)."""
_BANDS = 6
"""Maximum number of elastic bands made through one grid."""
_CHAIN_SEED = 1000
"""Second number of the seeds of chains of links, after the task's seed and before the growth's number."""
_CHAIN_GAP = 0.6
"""Largest distance between the part of a chain grown from the start and that grown from the goal, in links.
Heuristic."""
_BEND_SHARE = 0.9
"""Largest bend of the joints of a chain, as a fraction of the joint limit. Heuristic."""
_GROWTHS = (8, 64)
"""Numbers of growths of random trees of links in the first attempt, and in both attempts together. Heuristic: a growth
takes a hundredth of a second."""
_CHAINS = 16
"""Maximum number of elastic bands made from chains in one attempt. Heuristic: one takes a twentieth of a second."""
_PASSAGE = 0.6
"""Distance in nominal links above which walls add no cost to the grid path from which an elastic band is made."""
_CLOSED = 1.0
"""Radius of the region that is closed to further elastic bands, about the point at which a band is hardest to follow,
in nominal links. Heuristic."""
_TURNED = 1.5
"""Radius of the half-balls that are closed to elastic bands: behind the start and beyond the goal, in nominal links."""
_SIDESTEP = 0.5
"""Distance by which a grid path may enter the torus of cells that only too sharp a bend reaches, since grid paths bend
more sharply than the arm, in nominal links."""
_SHARP_PRICE = 10.0
"""Relative extra cost of cells that only too sharp a bend reaches from the start or the goal. Heuristic."""
_BENT_OVER = 1.2
"""Largest bend of a joint on a band, as a multiple of its limit there, for the band to be tried; the next joint
compensates for the excess."""
_SHORTCUT_GAP = 0.5
"""Gap to surfaces that a straight piece keeps if it replaces corners of a grid path, in nominal links."""
_DETOUR_PRICE = 4.0
"""Relative extra cost of a path near one that has failed."""
_DETOURS = 3
"""Maximum number of paths through one grid that are sought away from earlier paths."""
_SPARE_LENGTH = 2.0
"""Allowed excess of the length of a path over the feed that is left, in nominal links."""


def bend_allowances(arm: Arm, unit: float) -> list[tuple[float, float]]:
    """Return pairs of a smallest bend radius and an extra clearance with which followable paths are sought, in order.

    Args:
        arm: the arm.
        unit: length of a nominal link [m].

    Returns:
        Pairs of the smallest bend radius that a path may have [m], and the clearance that a path needs beyond the usual
        one, since straight links cut the bends (their sagitta, or 0) [m].
    """
    # Half of the largest bend; a link that spans a right angle and more counts as one that spans a right angle.
    half = 0.5 * min(arm.joint_limit, np.pi / 2.0)
    through_joints = 0.5 * arm.link_length / float(np.sin(half))
    radii: list[float] = []
    for share in _LIMIT_SHARES:
        radius = max(_TIGHTEST * unit, share * through_joints)
        if all(radius < _APART * other or other < _APART * radius for other in radii):
            radii.append(radius)
    found = []
    for radius in radii:
        height = max(arm.link_length**2 - unit**2, 0.0) / (8.0 * radius)
        found += [(radius, beside) for beside in dict.fromkeys((height, 0.0))]
    return found


@dataclass(frozen=True)
class TipWay:
    """Tip path in space, a polyline, with the parameters of a motion along the path.

    Attributes:
        name: name of the path in the record of candidates.
        corners: vertices of the path, shape (m, 3) [m].
        margin: fraction of the planning margin that steps along the path keep.
        followed: weight with which all joints are pulled onto the path of the tip; 0 if they are not.
    """

    name: str
    corners: FloatArray
    margin: float = 1.0
    followed: float = 0.0


@dataclass
class SpaceTipWays:
    """Generator of tip paths in space for a search task; grids are built on first use.

    Args:
        task: search task.
        tip: position of the tip at the start, shape (3,) [m].
        goal: position of the tip at the goal, shape (3,) [m].
        direction: direction of the last link at the goal, a unit vector of shape (3,); None if any is acceptable.
        heading: direction of the last link at the start, a unit vector of shape (3,).
        fed: remaining feed of the base [m]; None if the base is fixed.
        straight: distance by which the tip moves straight until the first joint is out of the guide tube [m].
        joints: joints and tip of a fed arm at the start, shape (links + 1, 3) [m].
        out: length of the arm outside the guide tube at the start, negative if the tip is inside the tube [m].
    """

    task: SpaceTask
    tip: FloatArray
    goal: FloatArray
    direction: FloatArray | None
    heading: FloatArray
    fed: float | None = None
    straight: float = 0.0
    joints: FloatArray | None = None
    out: float = 0.0
    _followed: list[FloatArray] = field(default_factory=list)  # followable paths tried so far
    _tried: set[float] = field(default_factory=set)  # cell sizes of grids already searched [m]
    _seen: list[FloatArray] = field(default_factory=list)  # paths through them
    _seen_chains: list[FloatArray] = field(default_factory=list)

    @cached_property
    def start(self) -> FloatArray:
        """Position of the tip at which it can leave its initial straight path, shape (3,) [m]."""
        return self.tip + self.straight * self.heading

    @cached_property
    def grids(self) -> TipGrids:
        """Grids in which the paths are sought."""
        return TipGrids(self.task, self.start, self.goal, max(_APPROACHES))

    def first(self) -> Iterator[TipWay]:
        """Yield the tip paths that are tried first: the straight path and, for a fed arm, paths that it can follow."""
        yield TipWay("straight", self._joined([self.start, *self._ends(_STRAIGHT_ENDS[0])]))
        yield from self._elastic(_CELLS[0])
        yield from self._chained(range(_GROWTHS[0]))
        yield from self._behind_the_tip(_FOLLOWABLE_CELLS[0])

    def others(self) -> Iterator[TipWay]:
        """Yield the tip paths that are not tried first.

        In order: paths from finer grids that a fed arm can follow, cheapest paths whatever their bends, detours from
        these, and paths with another straight end at the goal.
        """
        yield from self._elastic(_CELLS[1])
        yield from self._chained(range(*_GROWTHS))
        for cells in _FOLLOWABLE_CELLS[1:]:
            yield from self._behind_the_tip(cells)
        for cells in _CELLS[:-1]:
            yield from self._through_cells(cells)
        for approach in _STRAIGHT_ENDS[1:]:
            way = self._through_grid(_CELLS[0], _NEARNESS[0], _GRID_MARGINS[-1], approach, None)
            if way is not None:
                yield TipWay("with another approach", way, _CLOSE)

    def finest(self) -> Iterator[TipWay]:
        """Yield tip paths through the finest grid, which takes longer than all coarser grids together."""
        yield from self._through_cells(_CELLS[-1])

    def _through_cells(self, cells: int) -> Iterator[TipWay]:
        """Yield the cheapest tip paths through a grid of about ``cells`` cells, then detours from them.

        Yields nothing if a grid with the same cell size has been searched before.
        """
        size = self.grids.grid(cells, _GRID_MARGINS[-1]).cell
        if size in self._tried:
            return
        self._tried.add(size)
        seen = self._seen
        for nearness in _NEARNESS:
            for margin in _GRID_MARGINS:
                way = self._through_grid(cells, nearness, margin, _STRAIGHT_ENDS[0], None)
                if way is None:
                    continue
                if not any(_alike(way, other, self.task.unit) for other in seen):
                    seen.append(way)
                    yield TipWay(f"through free space ({len(way)} corners)", way)
                    yield TipWay("through free space, closer to walls", way, _CLOSE)
                break
        yield from self._detours(cells, seen)

    def _elastic(self, cells: int) -> Iterator[TipWay]:
        """Yield elastic bands that a fed arm may be able to follow, made from cheapest paths through a grid.

        After each band, the cells about the point at which that band is hardest to follow are closed.
        """
        band = self._band
        if band is None:
            return
        task = self.task
        grid = self._passages(cells)
        sharp = self._sharp_turns(grid)
        seen: list[FloatArray] = []
        for _ in range(_BANDS):
            places = [self.start, *task.via, self._before_goal(task.arm.link_length / task.unit)]
            parts = [grid.cheapest_way(*ends, _NEARNESS[0], sharp) for ends in pairwise(places)]
            found = [part for part in parts if part is not None]
            if len(found) < len(parts):
                return
            way = band(self._joined([*found, self.goal]))
            if way is None:
                return
            known = any(_alike(way.places, other, 0.5 * task.unit) for other in seen)
            seen.append(way.places)
            if not known and self._followable_band(way):
                yield TipWay("behind the tip", self._joined([way.places]), _CLOSE, ONTO_TRACK)
            grid = closed_about(grid, way.worst, _CLOSED * task.unit)
            if known:
                grid = closed_about(grid, way.worst, 2.0 * _CLOSED * task.unit)

    @cached_property
    def _band(self) -> Callable[[FloatArray], ElasticWay | None] | None:
        """Function that makes an elastic band from a path's corners, (k, 3) [m], the first the tip; None if not fed."""
        if self.joints is None:
            return None
        task = self.task
        band = ElasticBand(task.arm, task.tree, task.unit, task.kept + task.spare, task.wanted_gap)
        track = ArmTrack.behind(self.joints, np.stack((self.tip, self.start)))
        behind = track.at(track.length - band.piece * np.arange(band.pieces, 0, -1.0))
        first = int(self.straight > 0.0)  # the straight part is not deformed
        return lambda way: band.along(behind, way[first:], self.out + self.straight, self.direction, task.via)

    def _followable_band(self, way: ElasticWay) -> bool:
        """Return whether an elastic band is free of collision, bent little enough and short enough to be tried."""
        return way.gap > 0.0 and way.bend < _BENT_OVER and way.length < self._longest_followed

    def _chained(self, growths: range) -> Iterator[TipWay]:
        """Yield elastic bands made from chains of links that random trees connect from start to goal.

        Yields nothing if there are via points or the base is fixed.

        Args:
            growths: serial numbers of the growths of random trees, which are part of their seeds.
        """
        band = self._band
        if band is None or self.task.via:
            return
        task = self.task
        unit = task.unit
        tried = 0
        for number in growths:
            if task.deadline.passed():
                return
            rng = np.random.default_rng((task.seed, _CHAIN_SEED, number))
            kept = task.kept + task.spare + float(rng.choice(CHAIN_GAPS)) * task.wanted_gap
            ends = (WayEnd(self.start, self.heading), WayEnd(self.goal, self.direction))
            for chain in self._chains.grown(*ends, kept, _CHAIN_GAP * task.arm.link_length, 0.0, rng):
                if task.deadline.passed():
                    return
                corners = self._joined([self.start, chain.places])
                if any(_alike(corners, other, unit) for other in self._seen_chains):
                    continue
                self._seen_chains.append(corners)
                way = band(corners)
                if way is not None and self._followable_band(way):
                    yield TipWay("behind the tip, along a chain", self._joined([way.places]), _CLOSE, ONTO_TRACK)
                tried += 1
                if tried >= _CHAINS:
                    return

    @cached_property
    def _chains(self) -> LinkChains:
        arm = self.task.arm
        links = max(1, int(self._longest_followed / arm.link_length))
        places = self.out + self.straight + arm.link_length * np.arange(links)
        limits = _BEND_SHARE * arm.joint_limit * bend_shares(arm, np.asarray(places, dtype=np.float64))
        if arm.proportions is not None:
            # The joint that ends up at a place, and all beyond it, pass there; locked ones cannot follow any bend.
            shares = np.where(arm.limit_shares > 0.0, arm.limit_shares, 1.0)
            joint = np.searchsorted(-arm.places_from_tip[:-1], places - self._longest_followed, side="left")
            limits *= np.minimum.accumulate(shares[::-1])[::-1][np.minimum(joint, arm.links - 1)]
        return LinkChains.in_box(arm, self.task.tree, self.grids.box, limits, exact=False)

    def _passages(self, cells: int) -> TipGrid:
        """Return the grid from whose paths elastic bands are made; a cell is free if a path may pass anywhere in it.

        The centre of a free cell may be too near to a surface. Cells directly behind the start and beyond the goal are
        closed. ``cells`` is the approximate number of cells.
        """
        task = self.task
        far = _PASSAGE * task.unit
        distances = self.grids.distances(cells, self._longest_followed, task.kept + task.margin + FAR * task.unit)
        kept = max(task.kept - 0.5 * distances.cell, 0.25 * distances.cell)
        grid = self.grids.closed_behind(TipGrid.from_distances(distances, kept, far, task.deadline))
        radius = _TURNED * task.unit
        grid = closed_about(grid, self.start, radius, -self.heading)
        return grid if self.direction is None else closed_about(grid, self.goal, radius, self.direction)

    def _sharp_turns(self, grid: TipGrid) -> FloatArray:
        """Return the relative extra cost of cells near start and goal that the arm can only reach by too sharp a bend.

        These cells lie inside the torus (without a hole) formed by all circles that are tangent to the direction at
        that end and have the least radius on which joints stay within their limits.

        Args:
            grid: the grid.

        Returns:
            The costs, in the grid's shape; 0 for other cells.
        """
        arm = self.task.arm
        radius = 0.5 * arm.link_length / float(np.sin(0.5 * min(arm.joint_limit, np.pi / 2.0)))
        tube = max(radius - _SIDESTEP * self.task.unit, 0.0)
        prices = np.zeros(grid.gaps.shape)
        for end, direction in ((self.start, self.heading), (self.goal, self.direction)):
            if direction is not None:
                block, places = cells_in_cube(grid, end, radius + tube)
                apart = places - end
                along = apart @ direction
                across = np.sqrt(np.maximum(np.sum(apart**2, axis=-1) - along**2, 0.0))
                prices[block][(across - radius) ** 2 + along**2 < tube**2] = _SHARP_PRICE
        return prices

    def _behind_the_tip(self, cells: int) -> Iterator[TipWay]:
        """Yield tip paths through a grid whose bends all joints of a fed arm can follow; none for a fixed base.

        Each path is yielded three times: to pull the joints onto the path, to do so more strongly, and to lead the tip
        alone.
        """
        if self.fed is None:
            return
        seen = self._followed
        allowances = bend_allowances(self.task.arm, self.task.unit)
        for allowance, price, approach in product(allowances, _PRICES, _APPROACHES):
            way = self._followable(cells, allowance, price, approach)
            if way is not None and not any(_alike(way, other, 0.5 * self.task.unit) for other in seen):
                seen.append(way)
                yield TipWay("behind the tip", way, _CLOSE, ONTO_TRACK)
                yield TipWay("close behind the tip", way, _CLOSE, _CLOSE_ONTO_TRACK)
                yield TipWay("behind the tip, more freely", way, _CLOSE)

    def _followable(
        self, cells: int, allowance: tuple[float, float], price: tuple[float, float], approach: float
    ) -> FloatArray | None:
        """Return a tip path via all via points whose bends a fed arm can follow, shape (m, 3) [m], or None.

        Args:
            cells: approximate number of cells of the grid.
            allowance: smallest bend radius, and additional clearance for the sagitta of links [m].
            price: relative extra cost along walls, and fraction of the planning margin with which cells are free.
            approach: length of the straight end, in nominal links or in links, whichever are longer.
        """
        task = self.task
        nearness, margin = price
        radius, beside = allowance
        grid = self.grids.grid(cells, margin, beside, self._longest_followed)
        avoided = self._followed
        dear = prices_near(grid, avoided, _DETOUR_PRICE) if avoided else None
        prices = grid.prices(nearness, dear)
        search = FollowableWays(grid, prices, radius, task.unit, task.deadline)
        most = self._longest_followed
        goals = [WayEnd(place, None) for place in task.via]
        # The straight end is at least a link long, so that the last link lies on it and not on a chord of a bend.
        last = self._before_goal(approach * max(1.0, task.arm.link_length / task.unit))
        goals.append(WayEnd(last, self.direction))
        parts = [self.start[None]]
        heading = self.heading
        for goal in goals:
            part = search.between(WayEnd(parts[-1][-1], heading), goal, most)
            if part is None:
                return None
            most -= path_length(part)
            heading = part[-1] - part[-2]
            heading /= np.linalg.norm(heading)
            parts.append(part)
        return self._joined([*parts, self.goal])

    def _detours(self, cells: int, seen: list[FloatArray]) -> Iterator[TipWay]:
        """Yield tip paths through a grid that keep away from the paths ``seen``, to which each new path is appended."""
        for _ in range(_DETOURS):
            way = self._through_grid(cells, _NEARNESS[0], _GRID_MARGINS[-1], _STRAIGHT_ENDS[0], seen)
            if way is None or any(_alike(way, other, self.task.unit) for other in seen):
                return
            seen.append(way)
            yield TipWay("round another side", way, _CLOSE)

    def _ends(self, approach: float) -> list[FloatArray]:
        """Return the last points (3,) of a path: via points, beginning of the straight approach, and goal [m]."""
        if self.direction is None or approach == 0.0:
            return [*self.task.via, self.goal]
        return [*self.task.via, self._before_goal(approach), self.goal]

    def _before_goal(self, approach: float) -> FloatArray:
        """Return the point at which the straight approach along the goal direction begins, shape (3,) [m].

        Its distance from the goal is ``approach`` nominal links, or two thirds or one third of that if surfaces are too
        near to the approach; the goal itself if these fail, too, or the goal has no direction.
        """
        if self.direction is None:
            return self.goal
        task = self.task
        kept = task.kept
        for share in (1.0, 2.0 / 3.0, 1.0 / 3.0):
            place = self.goal - share * approach * task.unit * self.direction
            segment = np.stack((place, self.goal))[None]
            if task.tree.distances(segment, 2.0 * kept)[0] >= kept:
                return np.asarray(place)
        return self.goal

    def _through_grid(
        self, cells: int, nearness: float, margin: float, approach: float, avoided: list[FloatArray] | None
    ) -> FloatArray | None:
        """Return the cheapest tip path through a grid via all via points, corners cut if possible, (m, 3) [m], or None.

        Args:
            cells: approximate number of cells of the grid.
            nearness: relative extra cost of a path along a wall.
            margin: fraction of the planning margin with which cells are free.
            approach: length of the straight end, in nominal links.
            avoided: paths from which the path has to keep away, or None.
        """
        task = self.task
        if task.deadline.passed():
            return None
        grid = self.grids.grid(cells, margin)
        dear = None if avoided is None else prices_near(grid, avoided, _DETOUR_PRICE)
        places = [self.start, *self._ends(approach)]
        inner = places[:-1] if len(places) > 2 and self.direction is not None and approach > 0.0 else places
        parts = []
        for before, after in pairwise(inner):
            part = grid.cheapest_way(before, after, nearness, dear)
            if part is None:
                return None
            kept = task.kept + _SHORTCUT_GAP * task.unit
            parts.append(shortened(task.tree, part, kept, task.unit))
        parts.append(np.stack(places[len(inner) - 1 :]))
        return self._joined(parts)

    @property
    def _longest_followed(self) -> float:
        """Length of the longest path that the arm can be fed along, up to where the straight approach begins [m]."""
        return (self.fed or 0.0) - self.straight + _SPARE_LENGTH * self.task.unit

    def _joined(self, parts: list[FloatArray]) -> FloatArray:
        return without_repeats(np.vstack([np.atleast_2d(part) for part in (self.tip, *parts)]), 1e-9)


def _alike(way: FloatArray, other: FloatArray, unit: float) -> bool:
    """Return whether two polylines are nearer than ``unit`` to each other at 33 equal fractions of their lengths."""
    share = np.linspace(0.0, 1.0, 33)

    def places(corners: FloatArray) -> FloatArray:
        arcs = arc_lengths(corners)
        return points_at(corners, arcs, share * arcs[-1])

    return bool(np.max(np.linalg.norm(places(way) - places(other), axis=1)) < unit)
