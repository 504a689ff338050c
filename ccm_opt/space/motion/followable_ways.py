"""Ways that an arm can follow behind its tip: through a grid of places with room, with bends no sharper than it takes.

The search is hybrid A* (D. Dolgov et al., Path planning for autonomous vehicles in unknown semi-structured
environments, 2010), in space: a state is a place and a direction, from which short arcs towards some azimuths lead on;
states in one bin of places and directions count as one. What is left is estimated by the cheapest way through the grid,
whatever its bends. As soon as two arcs lead to the goal with room beside them the way ends with these.
"""

import heapq
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ccm_opt.errors import ProblemError
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.space.curve.biarc import Biarc
from ccm_opt.space.motion.grid_ways import TipGrid
from ccm_opt.space.motion.space_motion_settings import FollowableWaySettings


@dataclass(frozen=True, eq=False)
class WayEnd:
    """A place with a direction, at which a way begins or ends.

    Attributes:
        place: shape (3,) [m].
        direction: unit vector, shape (3,); None where any will do.
    """

    place: FloatArray
    direction: FloatArray | None


@dataclass(frozen=True, eq=False)
class _State:
    """A place on a way with the frame (t, n1, n2) there as columns, and how the way came there."""

    place: FloatArray
    frame: FloatArray
    cost: float
    length: float
    before: "_State | None"
    arc: int


@dataclass(frozen=True, eq=False)
class FollowableWays:
    """Finds ways through a grid.

    Attributes:
        grid: of places with room.
        price: of a way through a cell as a multiple of its length, shape of the grid; not positive where it is blocked.
        radius: of the tightest bend [m].
        unit: length of a nominal link [m].
        settings: of the search.
        deadline: when to stop.
    """

    grid: TipGrid
    price: npt.NDArray[np.float32]
    radius: float
    unit: float
    settings: FollowableWaySettings
    deadline: Deadline = field(default_factory=Deadline.never)

    def between(self, start: WayEnd, goal: WayEnd, most: float) -> FloatArray | None:
        """Places on a way, shape (m, 3) [m]; None where none is found.

        Args:
            start: where it begins; its direction counts.
            goal: where it ends.
            most: length of the longest way that makes sense [m].
        """
        left = self.grid.costs_to(goal.place, self.price)
        if left is None or start.direction is None or not np.isfinite(left[self.grid.index(start.place)]):
            return None
        first = _State(start.place, _frame(start.direction), 0.0, 0.0, None, -1)
        return self._searched(first, goal, most, left)

    def _searched(self, first: _State, goal: WayEnd, most: float, left: FloatArray) -> FloatArray | None:
        queue: list[tuple[float, int, _State]] = [(0.0, 0, first)]
        settled: set[tuple[int, ...]] = set()
        pushed = 0
        for _ in range(self.settings.most_states):
            if not queue or self.deadline.passed():
                return None
            _, _, state = heapq.heappop(queue)
            key = self._bin(state)
            if key in settled:
                continue
            settled.add(key)
            landing = self._landing(state, goal)
            if landing is not None:
                return np.concatenate((self._places(state), landing))
            for following, estimate in self._following(state, goal, most, left):
                if self._bin(following) not in settled:
                    pushed += 1
                    heapq.heappush(queue, (estimate, pushed, following))
        return None

    def _following(self, state: _State, goal: WayEnd, most: float, left: FloatArray) -> list[tuple[_State, float]]:
        """States one arc on from a state, each with the estimate of a whole way through it."""
        settings = self.settings
        step = settings.step * self.unit
        if state.length + step + float(np.linalg.norm(goal.place - state.place)) > most + step:
            return []
        arcs, turns, dear = self._arcs
        places = state.place + arcs @ state.frame.T
        cells = self._cells(places)
        prices = self.price[cells]
        found = []
        ends = left[tuple(axis[:, -1] for axis in cells)]
        clear = np.all(prices > 0.0, axis=1) & np.isfinite(ends)
        costs = state.cost + step * dear * np.mean(prices, axis=1)
        for k in np.flatnonzero(clear):
            following = _State(
                places[k, -1], state.frame @ turns[k], float(costs[k]), state.length + step, state, int(k)
            )
            found.append((following, float(costs[k] + ends[k])))
        return found

    def _landing(self, state: _State, goal: WayEnd) -> FloatArray | None:
        """Places on two arcs from a state to the goal; None where they bend too much or there is no room."""
        away = float(np.linalg.norm(goal.place - state.place))
        if away > self.settings.landing * self.unit:
            return None
        if away < 1e-9:
            return goal.place[None]
        direction = goal.direction
        if direction is None:
            # One arc ends so: the direction is mirrored at the chord.
            chord = (goal.place - state.place) / away
            direction = 2.0 * (chord @ state.frame[:, 0]) * chord - state.frame[:, 0]
        try:
            biarc = Biarc.between(state.place, state.frame, goal.place, direction)
        except ProblemError:
            return None
        if any(arc.turn * self.radius > 1.001 * arc.length for arc in (biarc.first, biarc.second)):
            return None
        if biarc.length > self.settings.longest_landing * away:
            return None
        places = _along(state.frame, state.place, biarc, 0.5 * self.grid.cell)
        return places if bool(np.all(self.price[self._cells(places)] > 0.0)) else None

    def _places(self, state: _State) -> FloatArray:
        """Places from the start to a state, shape (m, 3) [m]."""
        parts = []
        arcs = self._arcs[0]
        now = state
        while now.before is not None:
            parts.append(now.before.place + arcs[now.arc] @ now.before.frame.T)
            now = now.before
        return np.concatenate((now.place[None], *parts[::-1]))

    @cached_property
    def _arcs(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Arcs that lead on: places in the frame at their beginning, (a, m, 3), its turn, (a, 3, 3), and how dear."""
        settings = self.settings
        step = settings.step * self.unit
        samples = step * np.arange(1, 1 + max(2, int(np.ceil(2.0 * step / self.grid.cell))))
        samples = samples / len(samples)
        places = [np.column_stack((samples, np.zeros((len(samples), 2))))]
        turns = [np.eye(3)]
        dear = [1.0]
        for share in settings.bends:
            curvature = share / self.radius
            for k in range(settings.azimuths):
                azimuth = 2.0 * np.pi * k / settings.azimuths
                side = np.array([np.cos(azimuth), np.sin(azimuth)])
                angle = curvature * samples
                bulge = (1.0 - np.cos(angle)) / curvature
                places.append(np.column_stack((np.sin(angle) / curvature, bulge[:, None] * side)))
                turns.append(_turn_towards(side, float(angle[-1])))
                dear.append(1.0 + settings.bend_price * share**2)
        return np.stack(places), np.stack(turns), np.array(dear)

    def _bin(self, state: _State) -> tuple[int, ...]:
        """What states are told apart by."""
        place = np.floor(state.place / (self.settings.place_bin * self.unit)).astype(int)
        t = state.frame[:, 0]
        face = int(np.argmax(np.abs(t)))
        across = np.delete(t, face) / t[face]
        bins = np.floor(across * self.settings.direction_bins).astype(int)
        return (*place.tolist(), face, int(t[face] > 0.0), *bins.tolist())

    def _cells(self, places: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
        """Cells of places, shape (..., 3); the nearest one where a place lies outside."""
        found = np.rint((places - self.grid.low) / self.grid.cell).astype(np.intp)
        found = np.clip(found, 0, np.array(self.price.shape) - 1)
        return found[..., 0], found[..., 1], found[..., 2]


def _along(frame: FloatArray, start: FloatArray, biarc: Biarc, spacing: float) -> FloatArray:
    """Places along two arcs, the first not among them, shape (m, 3) [m]."""
    places = []
    for arc in (biarc.first, biarc.second):
        count = max(2, int(np.ceil(arc.length / spacing)))
        s = np.arange(1, count + 1) / count
        side = np.array([np.cos(arc.azimuth), np.sin(arc.azimuth)])
        angle = arc.turn * s
        # sin(x) / x and (1 − cos(x)) / x, also where the arc is straight
        forward = arc.length * s * np.sinc(angle / np.pi)
        aside = arc.length * s * np.sinc(0.5 * angle / np.pi) * np.sin(0.5 * angle)
        local = np.column_stack((forward, aside[:, None] * side))
        places.append(start + local @ frame.T)
        start = places[-1][-1]
        frame = frame @ _turn_towards(side, arc.turn)
    return np.concatenate(places)


def _frame(direction: FloatArray) -> FloatArray:
    """A frame whose first axis is a direction, as columns, shape (3, 3)."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    second = np.cross(direction, helper)
    second /= np.linalg.norm(second)
    return np.column_stack((direction, second, np.cross(direction, second)))


def _turn_towards(side: FloatArray, angle: float) -> FloatArray:
    """The rotation that turns the first axis by an angle towards a side across it, shape (3, 3)."""
    t = np.array([np.cos(angle), *(np.sin(angle) * side)])
    c, s = side
    cos = np.cos(angle)
    n1 = np.array([-c * np.sin(angle), s * s + c * c * cos, c * s * (cos - 1.0)])
    n2 = np.array([-s * np.sin(angle), c * s * (cos - 1.0), c * c + s * s * cos])
    return np.column_stack((t, n1, n2))
