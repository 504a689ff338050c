"""Paths that a fed arm can follow, and motions of the arm along them.

Several lengths are given in nominal links, each a twenty-fourth of the arm's length.

The search is hybrid A* (D. Dolgov et al., Path planning for autonomous vehicles in unknown semi-structured
environments, 2010), in space, in C (followable_ways.c). A state is a position and a direction, from which short arcs
towards some azimuths lead to further states; states in one bin of positions and directions count as one. The cost to go
is estimated by the cheapest path through the grid without regard to bends. The path ends as soon as two arcs through
free cells lead from a state to the goal.

Links are chords of the track, so the joints stay on it however few links the arm has. Only joints near the end of the
guide tube, which may bend little, deviate from it.

Between the joints a configuration does not determine the curve of the arm. If each configuration were fitted
separately, the curve would oscillate there as the joints slide by, and the optimisation would have to remove that. So
the fit also penalises changes of the curve from one configuration to the next.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.native import NativeCall, element_type
from ccm_opt.planning.curve_map import SETTLING, CurveMap
from ccm_opt.planning.grid_ways import TipGrid
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import SpaceArc, bend_shares, biarc
from ccm_opt.robot.inverse_kinematics import configuration_from_positions
from ccm_opt.robot.rigid_motions import turn_towards

_STEP = 1.0
"""Length of the arcs of a path, in nominal links."""
_BENDS = (0.5, 1.0)
"""Curvatures of the bent arcs, as fractions of the largest permitted one."""
PLACE_BIN = 0.5
"""Size of a bin of positions, in nominal links; states in one bin count as one."""
DIRECTION_BINS = 2
"""Half the number of direction bins along each edge of a face of a cube; directions are binned on its six faces."""
MOST_STATES = 20_000
"""Maximum number of states that are expanded."""
_AZIMUTHS = 8
"""Number of azimuths towards which arcs bend."""
_LANDING = 6.0
"""Distance from the goal up to which two arcs to it are tried, in nominal links."""

_BEND_PRICE = 1.0
"""Extra cost per length of the tightest arc, relative to a straight one."""
_LONGEST_LANDING = 1.6
"""Maximum length of the two arcs to the goal, as a multiple of the distance."""

_BINS = 7
"""Number of integers that identify the bin of a state in followable_ways.c."""


@dataclass(frozen=True, eq=False)
class WayEnd:
    """Position and direction of an end of a path.

    Attributes:
        place: position, shape (3,) [m].
        direction: unit vector of the path's direction, shape (3,); None if any is acceptable.
    """

    place: FloatArray
    direction: FloatArray | None


@dataclass(frozen=True, eq=False)
class WayArcs:
    """Arcs of equal length by which a path continues from a state.

    Attributes:
        places: m points on each arc, the last at its end, in the frame at its beginning, shape (a, m, 3) [m].
        turns: rotation of the frame from the beginning to the end of each arc, shape (a, 3, 3).
        dear: cost per length of each arc, shape (a,).
        length: length of each arc [m].
    """

    places: FloatArray
    turns: FloatArray
    dear: FloatArray
    length: float

    @classmethod
    def for_radius(cls, unit: float, radius: float, cell: float) -> "WayArcs":
        """Return a straight arc, and arcs that bend towards evenly spaced azimuths.

        Args:
            unit: length of a nominal link [m].
            radius: minimum bending radius [m].
            cell: cell size of the grid; points on an arc are about half a cell apart [m].
        """
        step = _STEP * unit
        samples = step * np.arange(1, 1 + max(2, int(np.ceil(2.0 * step / cell))))
        samples = samples / len(samples)
        places = [np.column_stack((samples, np.zeros((len(samples), 2))))]
        turns = [np.eye(3)]
        dear = [1.0]
        for share in _BENDS:
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
    """A search through a grid for a path that the arm can follow.

    Attributes:
        low: centre of the grid's first cell, shape (3,) [m].
        cell: size of the cells [m].
        price: cost per length of a path through each cell, shape (nx, ny, nz); not positive for blocked cells.
        left: cost of the cheapest path from each cell to the goal, inf if there is none, shape (nx, ny, nz) [m].
        arcs: arcs by which a path continues from a state.
        radius: minimum bending radius [m].
        unit: length of a nominal link [m].
        most: maximum length of a path [m].
    """

    low: FloatArray
    cell: float
    price: npt.NDArray[np.float32]
    left: FloatArray
    arcs: WayArcs
    radius: float
    unit: float
    most: float

    def cells(self, places: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
        """Return the indices along x, y and z of the cells that contain points (..., 3) [m], or of the nearest ones."""
        found = np.rint((places - self.low) / self.cell).astype(np.intp)
        found = np.clip(found, 0, np.array(self.price.shape) - 1)
        return found[..., 0], found[..., 1], found[..., 2]

    def connecting_arc_indices(self, place: FloatArray, frame: FloatArray, goal: WayEnd) -> list[int] | None:
        """Return the indices of the arcs of a path to a state that ``landing`` connects to the goal, or None.

        Args:
            place: first point of the path, shape (3,) [m].
            frame: frame (t, n1, n2) at the first point, as columns, shape (3, 3).
            goal: end of the path.
        """
        choices, samples, _ = self.arcs.places.shape
        capacity = MOST_STATES * choices + 1
        table = 1 << (2 * MOST_STATES).bit_length()
        nx, ny, nz = self.price.shape
        # Memory that is never written to is not allocated either.
        states = np.empty(capacity, dtype=element_type("followable_way", "states"))
        states[0] = (place, frame.ravel(), 0.0, 0.0, -1, -1)
        call = NativeCall(
            "followable_way",
            nx=nx, ny=ny, nz=nz, choices=choices, samples=samples, most_states=MOST_STATES, table=table,
            direction_bins=DIRECTION_BINS, cell=self.cell, step=self.arcs.length, most=self.most,
            place_bin=PLACE_BIN * self.unit, landing=_LANDING * self.unit,
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
        """Return points along two arcs that connect a state to the goal, shape (m, 3) [m].

        The result is None if the goal is too far away, or the arcs are too long or too tightly bent.

        Args:
            place: position of the state, shape (3,) [m].
            frame: frame (t, n1, n2) of the state, as columns, shape (3, 3).
            goal: end of the path.
        """
        away = float(np.linalg.norm(goal.place - place))
        if away > _LANDING * self.unit:
            return None
        if away < 1e-9:
            return goal.place[None]
        direction = goal.direction
        if direction is None:
            # A single arc ends in this direction: the start direction mirrored at the chord.
            chord = (goal.place - place) / away
            direction = 2.0 * (chord @ frame[:, 0]) * chord - frame[:, 0]
        arcs = biarc(place, frame, goal.place, direction)
        if arcs is None or any(arc.turn * self.radius > 1.001 * arc.length for arc in arcs):
            return None
        if sum(arc.length for arc in arcs) > _LONGEST_LANDING * away:
            return None
        return _along(frame, place, arcs, 0.5 * self.cell)


def _along(frame: FloatArray, start: FloatArray, arcs: Sequence[SpaceArc], spacing: float) -> FloatArray:
    """Return points along consecutive arcs, without the first point, shape (m, 3) [m].

    Args:
        frame: frame (t, n1, n2) at the first point, as columns, shape (3, 3).
        start: the first point, shape (3,) [m].
        arcs: the arcs.
        spacing: maximum spacing of the points if an arc has more than two [m].
    """
    places = []
    for arc in arcs:
        count = max(2, int(np.ceil(arc.length / spacing)))
        s = np.arange(1, count + 1) / count
        angle = arc.turn * s
        # sin(x) / x and (1 − cos(x)) / x, also where the arc is straight
        forward = arc.length * s * np.sinc(angle / np.pi)
        aside = arc.length * s * np.sinc(0.5 * angle / np.pi) * np.sin(0.5 * angle)
        local = np.column_stack((forward, aside[:, None] * arc.side))
        places.append(start + local @ frame.T)
        start = places[-1][-1]
        frame = frame @ turn_towards(arc.side, arc.turn)
    return np.concatenate(places)


@dataclass(frozen=True, eq=False)
class FollowableWays:
    """Search for paths through a grid whose bends a fed arm can follow with all joints.

    Attributes:
        grid: grid of the tip's gaps.
        price: cost per length of a path through each cell, shape (nx, ny, nz); not positive for blocked cells.
        radius: minimum bending radius [m].
        unit: length of a nominal link [m].
        deadline: deadline of the search.
    """

    grid: TipGrid
    price: npt.NDArray[np.float32]
    radius: float
    unit: float
    deadline: Deadline = field(default_factory=Deadline.never)

    def between(self, start: WayEnd, goal: WayEnd, most: float) -> FloatArray | None:
        """Return points along a path that the arm can follow, shape (m, 3) [m]; None if none is found.

        Args:
            start: start of the path, with its direction.
            goal: end of the path.
            most: maximum length of the path [m].
        """
        if self.grid.joined(start.place, goal.place) is None:
            return None
        left = self.grid.costs_to_go(goal.place, self.price)
        if left is None or start.direction is None or not np.isfinite(left[self.grid.index(start.place)]):
            return None
        grid = self.grid
        search = FollowSearch(grid.low, grid.cell, self.price, left, self._arcs, self.radius, self.unit, most)
        frame = _frame(start.direction)
        arcs = None if self.deadline.passed() else search.connecting_arc_indices(start.place, frame, goal)
        if arcs is None:
            return None
        parts = [start.place[None]]
        for k in arcs:
            parts.append(parts[-1][-1] + search.arcs.places[k] @ frame.T)
            frame = frame @ search.arcs.turns[k]
        landing = search.landing(parts[-1][-1], frame, goal)
        return None if landing is None else np.concatenate((*parts, landing))

    @cached_property
    def _arcs(self) -> WayArcs:
        return WayArcs.for_radius(self.unit, self.radius, self.grid.cell)


def _frame(direction: FloatArray) -> FloatArray:
    """Return a frame, its axes as columns, whose first axis is a given unit vector, shape (3, 3)."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    second = np.cross(direction, helper)
    second /= np.linalg.norm(second)
    return np.column_stack((direction, second, np.cross(direction, second)))


_FINE = 0.02
"""Spacing of the samples of the track among which the next joint's position is found, in links."""
_AHEAD = 100
"""Number of samples of the track that are searched for the next joint: two links of track, as an arc that a link spans
is at most a half circle, π / 2 links long."""
_BACK = 40
"""Number of samples by which the search for a joint begins before the sample one link of track after the last joint."""


def slid_along(
    arm: Arm,
    track: ArmTrack,
    feeds: FloatArray,
    shares: Callable[[FloatArray], FloatArray] | None = None,
    most: float | None = None,
) -> FloatArray:
    """Return the configurations of an arm that is fed along a track, shape (k, c) [rad, m].

    A joint near the end of the guide tube may use only a fraction of its largest bend, and turns its link towards the
    track as far as that permits; joints farther out turn the arm back onto the track.

    Args:
        arm: arm on a feed axis; with the base at the first feed, all joints are on the track.
        track: track of the tip, which begins at the base for the first feed.
        feeds: positions of the base, increasing, shape (k,) [m].
        shares: returns the permitted fractions of the largest bend, shape (k,), from a joint's arc lengths beyond the
            tube's end at all feeds, shape (k,) [m]; None for ``bend_shares``.
        most: largest bend of a joint [rad]; None for the joint limit.
    """
    shares = partial(bend_shares, arm) if shares is None else shares
    longest = float(np.max(arm.lengths))
    spacing = _FINE * longest
    ends = track.length + 2.0 * longest
    places = _prolonged(track, np.arange(0.0, ends, spacing))
    tube = arm.direction
    points = [arm.base + feeds[:, None] * tube]
    directions = np.broadcast_to(tube, (len(feeds), 3))
    # Least index on the track of each joint's place.
    first = np.round((feeds - feeds[0]) / spacing).astype(np.intp)
    limits = np.full(arm.links, arm.joint_limit if most is None else most)
    limits *= arm.limit_shares
    for joint, link in enumerate(arm.lengths.tolist()):
        free = shares(feeds + arm.joint_places[joint] - arm.hole)[:, None]
        nearest, chord = _chords(places, first - _BACK, points[-1], link)
        directions = _turned(directions, chord, free[:, 0] * limits[joint])
        points.append(points[-1] + link * directions)
        first = np.where(free[:, 0] > 0.0, nearest, first) + round(link / spacing)
    return configuration_from_positions(arm, np.stack(points, axis=1))


def _turned(directions: FloatArray, wanted: FloatArray, most: FloatArray) -> FloatArray:
    """Return unit vectors (k, 3) turned towards others (k, 3), each by at most an angle in ``most``, (k,) [rad]."""
    along = np.sum(directions * wanted, axis=1)
    aside = wanted - along[:, None] * directions
    away = np.linalg.norm(aside, axis=1)
    angle = np.minimum(np.arctan2(away, along), most)[:, None]
    return np.asarray(np.cos(angle) * directions + np.sin(angle) * aside / np.maximum(away, TINY)[:, None])


def feeds_to_end(arm: Arm, track: ArmTrack, start: float, step: float) -> FloatArray:
    """Return evenly spaced positions of the base from a start to where the tip is nearest to its track's end, (k,) [m].

    Args:
        arm: arm on a feed axis.
        track: track of the tip.
        start: position of the base at the start of the motion [m].
        step: maximum spacing of the positions [m].
    """
    # Links are chords of bends, so the tip is at the end before the base has advanced by the track's length.
    farthest = max(min(start + track.length - track.start, arm.base_range[1]), start)
    before = np.linspace(max(start, farthest - 2.0 * float(np.max(arm.lengths))), farthest, 41)
    feeds = np.concatenate(([start], before))
    tips = arm.joint_positions_at(slid_along(arm, track, feeds))[1:, -1]
    last = float(before[np.argmin(np.linalg.norm(tips - track.points[-1], axis=1))])
    return np.linspace(start, last, max(2, int(np.ceil((last - start) / step)) + 1))


def _chords(places: FloatArray, first: IntArray, joints: FloatArray, link: float) -> tuple[IntArray, FloatArray]:
    """Return, for k positions of a joint, the nearest track points' indices (k,) and the next link's directions (k, 3).

    The link points to the first track point after the nearest one that is a link length away from the joint.

    Args:
        places: points of the track, shape (m, 3) [m].
        first: index of the point with which the search begins, shape (k,).
        joints: positions of the joint at k feeds, shape (k, 3) [m].
        link: length of a link [m].
    """
    nearest, chords = np.empty(len(joints), dtype=np.int64), np.empty((len(joints), 3))
    NativeCall(
        "link_chords", count=len(joints), samples=len(places), ahead=_AHEAD, window=_AHEAD + _BACK, link=link,
        track=places, first=first, joints=joints, nearest=nearest, chords=chords,
    )()  # fmt: skip
    return nearest, chords


def _prolonged(track: ArmTrack, arcs: FloatArray) -> FloatArray:
    """Return the points at arc lengths (m,) [m] of a track extended straight beyond its end, shape (m, 3) [m]."""
    last = track.points[-1] - track.points[-2]
    last = last / np.linalg.norm(last)
    return np.asarray(track.at(arcs) + np.maximum(arcs - track.length, 0.0)[:, None] * last)


STILL = 1e-3
"""Weight of squared changes of the curve's bends, relative to squared errors of joint angles. Measured on bent paths
with 8 to 36 links: the squares of these changes are mostly less than a twentieth of those of separate fits of each
configuration, and joint angles are reproduced as well, to 0.01 rad."""


def fitted_slide(curve: CurveMap, start: FloatArray, configurations: FloatArray) -> FloatArray:
    """Return unknowns fitted to the joint angles of an arm that slides along a track, shape (k, p).

    Args:
        curve: map from unknowns to configurations, exact for the first configuration.
        start: unknowns of the first configuration, shape (p,).
        configurations: configurations at even steps of the feed, shape (k, c) [rad, m].
    """
    links = curve.arm.links
    shown = 2 * curve.knots
    unknowns = np.zeros((len(configurations), curve.dimension))
    unknowns[0] = start
    unknowns[1:, curve.feed_column] = configurations[1:, -1] / curve.scale[curve.feed_column]
    bends = (curve.nominal_length * curve.scale[: curve.knots]) ** 2
    ties = SETTLING * np.diff(np.eye(curve.knots), axis=0)
    blocks = []
    targets = []
    for v, q in zip(unknowns[1:], configurations[1:], strict=True):
        # Knots turn the joints alike about both axes.
        rows = curve.slopes(v)[0 : 2 * links : 2, : curve.knots]
        turns = q[: 2 * links].reshape(links, 2) - curve.offsets(curve.places(float(q[-1])), v)
        blocks.append(rows.T @ rows + ties.T @ ties)
        targets.append(rows.T @ turns)
    targets[0] = targets[0] + STILL * bends[:, None] * start[:shown].reshape(2, curve.knots).T
    count = len(blocks)
    changes = np.eye(count) - np.eye(count, k=-1)
    still = STILL * sp.kron(changes.T @ changes, np.diag(bends))
    found = np.asarray(spsolve(sp.csc_array(sp.block_diag(blocks) + still), np.vstack(targets)))
    unknowns[1:, :shown] = found.reshape(count, curve.knots, 2).transpose(0, 2, 1).reshape(count, shown)
    return unknowns


_PLACED = 2
"""Number of iterations that fit unknowns to joint positions. Measured on bent paths: a third changes nothing."""


def placed_slide(curve: CurveMap, unknowns: FloatArray, configurations: FloatArray) -> FloatArray:
    """Return unknowns of a sliding arm fitted to the positions of the joints, shape (k, p).

    Small errors of many joint angles add up along the arm, so curves that reproduce all joint angles well may still
    miss the end of the track.

    Args:
        curve: map from unknowns to configurations.
        unknowns: unknowns fitted to the joint angles, by ``fitted_slide``, shape (k, p).
        configurations: configurations at even steps of the feed, shape (k, c) [rad, m].
    """
    turns = 2 * curve.arm.links
    shown = 2 * curve.knots
    unit = curve.nominal_length
    unknowns = unknowns.copy()
    wanted = curve.arm.joint_positions_at(configurations[1:])[:, 1:]
    bends = np.tile((unit * curve.scale[: curve.knots]) ** 2, 2)
    uneven = SETTLING * np.diff(np.eye(curve.knots), axis=0)
    ties = np.kron(np.eye(2), uneven.T @ uneven)
    count = len(wanted)
    changes = np.eye(count) - np.eye(count, k=-1)
    still = STILL * sp.kron(changes.T @ changes, np.diag(bends))
    for _ in range(_PLACED):
        blocks = []
        targets = []
        for pose, places, q in zip(curve.poses(unknowns[1:]), wanted, configurations[1:], strict=True):
            rows = np.vstack((pose.moving[1:].reshape(-1, curve.dimension) / unit, pose.slopes[:turns]))[:, :shown]
            missing = np.concatenate(((places - pose.points[1:]).ravel() / unit, (q - pose.q)[:turns]))
            blocks.append(rows.T @ rows + ties)
            targets.append(rows.T @ (missing + rows @ pose.v[:shown]))
        targets[0] = targets[0] + STILL * bends * unknowns[0, :shown]
        found = spsolve(sp.csc_array(sp.block_diag(blocks) + still), np.concatenate(targets))
        unknowns[1:, :shown] = np.asarray(found).reshape(count, shown)
    return unknowns
