"""Ways that the arm can follow.

The search itself is compiled C (followable_search.c).

The search is hybrid A* (D. Dolgov et al., Path planning for autonomous vehicles in unknown semi-structured
environments, 2010), in space: a state is a place and a direction, from which short arcs towards some azimuths lead on;
states in one bin of places and directions count as one. What is left is estimated by the cheapest way through the grid,
whatever its bends. As soon as two arcs lead to the goal with room beside them the way ends with these.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.native import NativeCall, element_type
from ccm_opt.errors import ProblemError
from ccm_opt.planning.grid_ways import TipGrid
from ccm_opt.planning.settings import FollowableWaySettings
from ccm_opt.robot.biarc import Biarc

_AZIMUTHS = 8
"""Towards which arcs bend."""
_LANDING = 6.0
"""From how near two arcs to the goal are tried [u]."""

_BEND_PRICE = 1.0
"""What the tightest bend costs more than a straight way, as a multiple."""
_LONGEST_LANDING = 1.6
"""These two may be longer than the straight line by this multiple."""

_BINS = 7
"""Numbers that states are told apart by in followable_search.c."""


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
class WayArcs:
    """Arcs that lead on from a state.

    Attributes:
        places: on each arc in the frame at its beginning, the end included, shape (a, m, 3) [m].
        turns: of the frame along each, shape (a, 3, 3).
        dear: what each costs, as a multiple of its length, shape (a,).
        length: of each [m].
    """

    places: FloatArray
    turns: FloatArray
    dear: FloatArray
    length: float

    @classmethod
    def of(cls, settings: FollowableWaySettings, unit: float, radius: float, cell: float) -> "WayArcs":
        """A straight one, and bent ones towards all azimuths.

        Args:
            settings: of the search.
            unit: length of a nominal link [m].
            radius: of the tightest bend [m].
            cell: of the grid; places on an arc lie half of it apart [m].
        """
        step = settings.step * unit
        samples = step * np.arange(1, 1 + max(2, int(np.ceil(2.0 * step / cell))))
        samples = samples / len(samples)
        places = [np.column_stack((samples, np.zeros((len(samples), 2))))]
        turns = [np.eye(3)]
        dear = [1.0]
        for share in settings.bends:
            curvature = share / radius
            for k in range(_AZIMUTHS):
                azimuth = 2.0 * np.pi * k / _AZIMUTHS
                side = np.array([np.cos(azimuth), np.sin(azimuth)])
                angle = curvature * samples
                bulge = (1.0 - np.cos(angle)) / curvature
                places.append(np.column_stack((np.sin(angle) / curvature, bulge[:, None] * side)))
                turns.append(turn_towards(side, float(angle[-1])))
                dear.append(1.0 + _BEND_PRICE * share**2)
        return cls(np.stack(places), np.stack(turns), np.array(dear), step)


@dataclass(frozen=True, eq=False)
class FollowSearch:
    """What is searched.

    Attributes:
        low: centre of the grid's first cell, shape (3,) [m].
        cell: size of the cells [m].
        price: of a way through a cell as a multiple of its length, shape (nx, ny, nz); not positive where it is
            blocked.
        left: cost of the cheapest way from each cell to the goal, of the same shape, inf where there is none [m].
        arcs: that lead on.
        radius: of the tightest bend [m].
        unit: length of a nominal link [m].
        most: length of the longest way that makes sense [m].
        settings: of the search.
    """

    low: FloatArray
    cell: float
    price: npt.NDArray[np.float32]
    left: FloatArray
    arcs: WayArcs
    radius: float
    unit: float
    most: float
    settings: FollowableWaySettings

    def cells(self, places: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
        """Cells of places, shape (..., 3); the nearest one where a place lies outside."""
        found = np.rint((places - self.low) / self.cell).astype(np.intp)
        found = np.clip(found, 0, np.array(self.price.shape) - 1)
        return found[..., 0], found[..., 1], found[..., 2]

    def arcs_from(self, place: FloatArray, frame: FloatArray, goal: WayEnd) -> list[int] | None:
        """Numbers of the arcs of a way to where two more lead to the goal; None where none is found.

        Args:
            place: where it begins, shape (3,) [m].
            frame: (t, n1, n2) there as columns, shape (3, 3).
            goal: where the way ends.
        """
        settings = self.settings
        choices, samples, _ = self.arcs.places.shape
        capacity = settings.most_states * choices + 1
        table = 1 << (2 * settings.most_states).bit_length()
        nx, ny, nz = self.price.shape
        # Memory that is not written to is not taken either.
        states = np.empty(capacity, dtype=element_type("followable_way", "states"))
        states[0] = (place, frame.ravel(), 0.0, 0.0, -1, -1)
        call = NativeCall(
            "followable_way",
            nx=nx, ny=ny, nz=nz, choices=choices, samples=samples, most_states=settings.most_states, table=table,
            direction_bins=settings.direction_bins, cell=self.cell, step=self.arcs.length, most=self.most,
            place_bin=settings.place_bin * self.unit, landing=_LANDING * self.unit,
            longest=_LONGEST_LANDING, radius=self.radius, spacing=0.5 * self.cell, low=self.low,
            goal=goal.place, directed=goal.direction is not None,
            direction=np.zeros(3) if goal.direction is None else goal.direction,
            price=self.price, left=self.left, arcs=self.arcs.places, turns=self.arcs.turns, dear=self.arcs.dear,
            states=states, heap=np.empty(capacity, dtype=np.int64), key=np.empty(capacity),
            bins=np.empty((table, _BINS), dtype=np.int32), taken=np.zeros(table, dtype=np.uint8),
        )  # fmt: skip
        call()
        if call.fields.found < 0:
            return None
        found = []
        state = int(call.fields.found)
        while states["before"][state] >= 0:
            found.append(int(states["arc"][state]))
            state = int(states["before"][state])
        return found[::-1]

    def landing(self, place: FloatArray, frame: FloatArray, goal: WayEnd) -> FloatArray | None:
        """Places on two arcs from a state to the goal, shape (m, 3) [m]; None where they are too long or bent.

        Args:
            place: of the state, shape (3,) [m].
            frame: (t, n1, n2) there as columns, shape (3, 3).
            goal: where the way ends.
        """
        away = float(np.linalg.norm(goal.place - place))
        if away > _LANDING * self.unit:
            return None
        if away < 1e-9:
            return goal.place[None]
        direction = goal.direction
        if direction is None:
            # One arc ends so: the direction is mirrored at the chord.
            chord = (goal.place - place) / away
            direction = 2.0 * (chord @ frame[:, 0]) * chord - frame[:, 0]
        try:
            biarc = Biarc.between(place, frame, goal.place, direction)
        except ProblemError:
            return None
        if any(arc.turn * self.radius > 1.001 * arc.length for arc in (biarc.first, biarc.second)):
            return None
        if biarc.length > _LONGEST_LANDING * away:
            return None
        return _along(frame, place, biarc, 0.5 * self.cell)


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
        frame = frame @ turn_towards(side, arc.turn)
    return np.concatenate(places)


def turn_towards(side: FloatArray, angle: float) -> FloatArray:
    """The rotation that turns the first axis by an angle [rad] towards a side across it, shape (2,): shape (3, 3)."""
    t = np.array([np.cos(angle), *(np.sin(angle) * side)])
    c, s = side
    cos = np.cos(angle)
    n1 = np.array([-c * np.sin(angle), s * s + c * c * cos, c * s * (cos - 1.0)])
    n2 = np.array([-s * np.sin(angle), c * s * (cos - 1.0), c * c + s * s * cos])
    return np.column_stack((t, n1, n2))


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
        grid = self.grid
        search = FollowSearch(
            grid.low, grid.cell, self.price, left, self._arcs, self.radius, self.unit, most, self.settings
        )
        frame = _frame(start.direction)
        arcs = self._found(search, goal, start.place, frame)
        return None if arcs is None else self._places(search, goal, start.place, frame, arcs)

    def _found(self, search: FollowSearch, goal: WayEnd, place: FloatArray, frame: FloatArray) -> list[int] | None:
        """Numbers of the arcs of a way to where two more lead to the goal."""
        if self.deadline.passed():
            return None
        return search.arcs_from(place, frame, goal)

    def _places(
        self, search: FollowSearch, goal: WayEnd, place: FloatArray, frame: FloatArray, arcs: list[int]
    ) -> FloatArray | None:
        """Places on a way of some arcs from a state, and from there to the goal, shape (m, 3) [m]."""
        parts = [place[None]]
        for k in arcs:
            parts.append(parts[-1][-1] + search.arcs.places[k] @ frame.T)
            frame = frame @ search.arcs.turns[k]
        landing = search.landing(parts[-1][-1], frame, goal)
        return None if landing is None else np.concatenate((*parts, landing))

    @cached_property
    def _arcs(self) -> WayArcs:
        return WayArcs.of(self.settings, self.unit, self.radius, self.grid.cell)


def _frame(direction: FloatArray) -> FloatArray:
    """A frame whose first axis is a direction, as columns, shape (3, 3)."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    second = np.cross(direction, helper)
    second /= np.linalg.norm(second)
    return np.column_stack((direction, second, np.cross(direction, second)))
