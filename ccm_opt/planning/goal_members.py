"""Selected members of a goal set, and poses at goals that require joints at their limits.

A wide tolerance makes the goal a set. Routes are planned to a few distinct members of it: at least one in each of the
largest pieces of the set, preferably with a free straight run onto the member, and otherwise far apart. A motion may
also end at any other member.

Goals that only a pose with joints at their limits can reach need few candidates. A curve of bounded curvature that
reaches as far as such a curve can consists of arcs of maximal curvature (Dubins, 1957), so such poses are sought near
curves of at most three arcs.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray, IntArray
from ccm_opt.core.polyline import unit_vector, vector_heading, wrap
from ccm_opt.planning.goal import GoalPose
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.free_space import FreeSpace

_MOST = 5
"""Maximum number of members selected. Heuristic: routes are planned to each."""
_PIECES = 4
"""Maximum number of pieces of the set that are considered, the largest first. Heuristic."""
_GRID = 9
"""Number of grid points across the set along each axis. Heuristic."""
_TURN_STEP = 0.08726646259971647
"""Largest spacing of the headings that are considered [rad]. Heuristic: 5°."""
_TURN_SHARE = 0.1
"""Distance that is equivalent to a difference in heading of one radian, as a fraction of the arm's length.
Heuristic."""
_DIFFERENT = 0.04
"""Difference below which members count as one, as a fraction of the arm's length. Heuristic: a nominal link."""
_EDGE = 0.02
"""Distance of positions from the edge of their piece, as a fraction of the set's radius. Heuristic."""
_REACH = 0.99
"""Largest distance of members from the base, as a fraction of the arm's length. Heuristic: a fully stretched arm can
hardly move."""
_RUNS = (0.5, 1.0, 2.0)
"""Lengths of straight runs onto a member that are checked, in nominal links. Heuristic."""
_RUN_SAMPLES = 9
"""Number of points of a run that are checked. Heuristic."""


_ARC_PLACES = 24
"""Maximum number of joints at which the bends may change sign. Heuristic."""
_MOST_TURN = 7.0
"""Largest sum of the absolute bends of an initial curve, so that it does not coil up [rad]. Heuristic."""
_ARCS_TRIED = 16
"""Maximum number of initial curves for Newton's method. Heuristic."""
_ARCS_KEPT = 4
"""Maximum number of poses at the goal that use the joint limits in full. Heuristic."""
_ALIKE = 0.3
"""Largest difference in any bend up to which poses count as one, as a fraction of the joint limit. Heuristic."""
_ARC_STEPS = 30
"""Maximum number of steps of Newton's method. Heuristic."""
_ARC_TURN = 0.3
"""Largest change of a bend in one step of Newton's method [rad]. Heuristic."""
_ARC_RIDGE = 1e-13
"""Regularisation of the Newton equations, in squared arm lengths. Derived: some thousand rounding errors."""
_ARC_ARRIVED = 1e-11
"""Error of the tip at which Newton's method ends, in arm lengths or radians. Derived: far below what the optimisation
requires at the end of a motion."""

_AMPLE = 0.9
"""Fraction of the joint limits within which guides find goal poses themselves. Measured: with steps limited to 0.98,
guides fail within 13 s at goals that require 0.96 of the limits."""
_HEADING_LENGTH = 0.25
"""Position error that is equivalent to a heading error of one radian, in arm lengths, in the choice of initial curves.
Heuristic."""
_RELEASES = 8
"""Maximum number of times that a Newton step is recomputed with further joints held at their limits. Heuristic."""


@dataclass(frozen=True)
class GoalMember:
    """One position and heading of a goal.

    Attributes:
        position: position of the tip, shape (2,) [m].
        heading: heading of the tip [rad], or None if any is acceptable.
    """

    position: FloatArray
    heading: float | None


@dataclass(frozen=True)
class _Choice:
    """Members of a goal from which a selection is made.

    Attributes:
        places: positions, shape (m, 2) [m].
        headings: headings, shape (m,) [rad]; zeros if any is acceptable.
        runs: longest checked length of a free straight run onto each member, in nominal links, 0 for none, shape (m,).
        pieces: index of the piece of the set that contains each position, shape (m,).
    """

    places: FloatArray
    headings: FloatArray
    runs: FloatArray
    pieces: IntArray


def goal_members(arm: Arm, goal: GoalPose, room: FreeSpace, fed: float = 0.0) -> tuple[GoalMember, ...]:
    """Return the members of a goal to which routes are planned; only the goal itself if it is not a set.

    Args:
        arm: the arm.
        goal: goal for the tip.
        room: free space of the arm's centre line.
        fed: distance by which the base can still advance [m].

    Returns:
        The members: first one for each piece of the set, then additional ones. Empty if no point of the set is in free
        space connected with the base and within reach.
    """
    if not goal.is_set:
        return (GoalMember(goal.position, goal.heading),)
    choice = _choice(arm, goal, room, fed)
    chosen = _far_apart(arm, goal, choice)
    any_heading = goal.heading is None
    return tuple(GoalMember(choice.places[k], None if any_heading else float(choice.headings[k])) for k in chosen)


def _choice(arm: Arm, goal: GoalPose, room: FreeSpace, fed: float) -> _Choice:
    """Return all combinations of sampled positions and headings of a goal, from which members are selected.

    Args:
        arm: the arm.
        goal: goal for the tip.
        room: free space of the arm's centre line.
        fed: distance by which the base can still advance [m].
    """
    places, pieces = _places(arm, goal, room, fed)
    headings = _headings(goal)
    each = np.repeat(np.arange(len(places)), len(headings))
    turned = np.tile(headings, len(places))
    runs = np.zeros(len(each))
    if goal.heading is not None and len(each):
        unit = arm.length / NOMINAL_LINKS
        # The longest run comes last, so that it overwrites the shorter ones.
        for links in sorted(_RUNS):
            runs[_runs_in(room, places[each], turned, links * unit)] = links
    return _Choice(places[each], turned, runs, pieces[each])


def _runs_in(room: FreeSpace, places: FloatArray, headings: FloatArray, length: float) -> BoolArray:
    """Return a mask of the members onto which a straight run is free, shape (m,).

    Args:
        room: free space of the arm's centre line.
        places: positions, shape (m, 2) [m].
        headings: headings, shape (m,) [rad].
        length: length of the run [m].
    """
    back = -np.linspace(0.0, length, _RUN_SAMPLES)
    samples = places[:, None] + back[:, None] * unit_vector(headings).reshape(-1, 2)[:, None]
    return np.asarray(room.contains(samples.reshape(-1, 2)).reshape(len(places), -1).all(axis=1))


def _headings(goal: GoalPose) -> FloatArray:
    """Return evenly spaced headings within the tolerance, including the goal's own, shape (h,) [rad].

    The result is a single zero if any heading is acceptable.
    """
    if goal.heading is None:
        return np.zeros(1)
    steps = int(np.ceil(goal.room[1] / _TURN_STEP))
    return goal.heading + np.linspace(-goal.room[1], goal.room[1], 2 * steps + 1)


def _places(arm: Arm, goal: GoalPose, room: FreeSpace, fed: float) -> tuple[FloatArray, IntArray]:
    """Return positions of a goal set, shape (m, 2) [m], with the index of each one's piece of the set, shape (m,).

    A set consists of positions within the arm's reach and in the part of free space nearest to the base. A goal without
    tolerance of position gives its position, unchecked.

    Args:
        arm: the arm.
        goal: goal for the tip.
        room: free space of the arm's centre line.
        fed: distance by which the base can still advance [m].
    """
    if goal.room[0] == 0.0:
        return goal.position[None], np.zeros(1, dtype=np.intp)
    parts = shapely.get_parts(room.polygons)
    if len(parts) == 0:
        return np.zeros((0, 2)), np.zeros(0, dtype=np.intp)
    base = shapely.Point(arm.base)
    around_base = parts[int(np.argmin(shapely.distance(parts, base)))]
    middle = shapely.Point(goal.position)
    within = shapely.intersection(middle.buffer(goal.room[0]), base.buffer(_REACH * arm.length + fed))
    pieces = [
        piece
        for piece in shapely.get_parts(shapely.intersection(around_base, within))
        if isinstance(piece, shapely.Polygon) and not piece.is_empty
    ]
    pieces.sort(key=lambda piece: -piece.area)
    places = [_places_in(piece, middle, base, goal.room[0]) for piece in pieces[:_PIECES]]
    numbers = [np.full(len(some), k, dtype=np.intp) for k, some in enumerate(places)]
    return np.concatenate([np.zeros((0, 2)), *places]), np.concatenate([np.zeros(0, dtype=np.intp), *numbers])


def _places_in(piece: shapely.Polygon, middle: shapely.Point, base: shapely.Point, width: float) -> FloatArray:
    """Return positions in one piece of the set, shape (m, 2) [m].

    They are the points nearest to the set's centre and to the base, the centre of the largest inscribed circle, and
    grid points.

    Args:
        piece: the piece.
        middle: centre of the set.
        base: position of the arm's base.
        width: radius of the set [m].
    """
    roomiest = shapely.get_coordinates(shapely.maximum_inscribed_circle(piece))[:1]
    # Slightly inside: at the very edge of free space the arm can hardly move.
    inside = piece.buffer(-_EDGE * width)
    inside = piece if inside.is_empty else inside
    ends = [shapely.get_coordinates(shapely.shortest_line(inside, end))[:1] for end in (middle, base)]
    across = np.linspace(-width, width, _GRID)
    grid = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2) + shapely.get_coordinates(middle)
    return np.concatenate([*ends, roomiest, grid[shapely.intersects_xy(inside, grid[:, 0], grid[:, 1])]])


def _far_apart(arm: Arm, goal: GoalPose, choice: _Choice) -> list[int]:
    """Return the indices of selected members that are far apart from one another.

    The best member of each piece is selected first: one with the longest free run, and among those one close to the
    goal's position and heading. Then the member farthest from all selected ones is added repeatedly.

    Args:
        arm: the arm.
        goal: goal for the tip.
        choice: members to select from.
    """
    if len(choice.places) == 0:
        return []
    off = np.linalg.norm(choice.places - goal.position, axis=1) / arm.length
    turned = np.abs(choice.headings - (goal.heading or 0.0)) * _TURN_SHARE
    # A longer straight run takes precedence over everything else.
    short = choice.runs.max() - choice.runs
    chosen: list[int] = []
    for piece in range(int(choice.pieces.max()) + 1):
        mine = np.flatnonzero(choice.pieces == piece)
        best = mine[np.argmin(short[mine] + 1e-3 * (off + turned)[mine])]
        chosen.append(int(best))
    while len(chosen) < _MOST:
        apart = np.min([_apart(arm, choice, k) for k in chosen], axis=0)
        apart[short > 0.0] = 0.0
        farthest = int(np.argmax(apart))
        if apart[farthest] < _DIFFERENT:
            break
        chosen.append(farthest)
    return chosen


def _apart(arm: Arm, choice: _Choice, k: int) -> FloatArray:
    """Return the distance of each member from member k, in arm lengths with headings converted, shape (m,)."""
    off = np.linalg.norm(choice.places - choice.places[k], axis=1) / arm.length
    turned = np.abs(wrap(choice.headings - choice.headings[k])) * _TURN_SHARE
    return np.asarray(off + turned)


@dataclass(frozen=True)
class ArcsAtLimits:
    """Search for poses at a goal with joints at their limits, from initial curves of at most three arcs.

    Attributes:
        arm: arm on a fixed base.
        goal: goal for the tip.
    """

    arm: Arm
    goal: GoalPose

    def where_needed(self, full: float) -> tuple[FloatArray, ...]:
        """Return poses at the goal with bends up to the joint limits; empty if nine tenths of the limits suffice.

        Args:
            full: fraction of the joint limits that poses may use.

        Returns:
            Configurations, not checked for contact, each of shape (links,) [rad].
        """
        if self.poses(_AMPLE, 1):
            return ()
        return self.poses(full, _ARCS_KEPT)

    def poses(self, share: float, most: int) -> tuple[FloatArray, ...]:
        """Return distinct poses at the goal within a fraction of the joint limits.

        Initial curves with the tip nearest to the goal come first.

        Args:
            share: fraction of the joint limits that poses may use; the base may use its whole limit.
            most: maximum number of poses.

        Returns:
            Configurations, each of shape (links,) [rad].
        """
        bounds = share * self.arm.bend_limits
        bounds[0] = self.arm.base_limit
        apart = _ALIKE * self.arm.joint_limit
        found: list[FloatArray] = []
        for arc in self._nearest(bounds):
            bends = self._onto_goal(arc, bounds)
            if bends is not None and all(np.abs(bends - other).max() > apart for other in found):
                found.append(bends)
            if len(found) == most:
                break
        return tuple(found)

    def _nearest(self, bounds: FloatArray) -> FloatArray:
        """Return the bends of the initial curves with the tip nearest to the goal, nearest first, (m, links) [rad].

        The base is turned so that the tip lies in the direction of the goal.

        Args:
            bounds: bounds of the absolute bends, shape (links,) [rad].
        """
        arm = self.arm
        bends = np.minimum(bounds, _MOST_TURN / arm.links) * self._sides()
        bends[:, 0] = 0.0
        turned = np.cumsum(bends, axis=1)
        shares = arm.arc_shares
        sums = ((np.cos(turned) * shares).sum(axis=1), (np.sin(turned) * shares).sum(axis=1))
        tip = arm.link_length * np.stack(sums, axis=1)
        towards = self.goal.position - arm.base
        first = vector_heading(towards) - np.arctan2(tip[:, 1], tip[:, 0])
        bends[:, 0] = wrap(first - arm.base_heading)
        missed = np.abs(np.linalg.norm(tip, axis=1) - np.linalg.norm(towards)) / arm.length
        if self.goal.heading is not None:
            missed = np.hypot(missed, _HEADING_LENGTH * wrap(first + turned[:, -1] - self.goal.heading))
        bends = bends[np.argsort(missed, kind="stable")]
        nearest: FloatArray = bends[np.abs(bends[:, 0]) <= bounds[0]][:_ARCS_TRIED]
        return nearest

    def _sides(self) -> FloatArray:
        """Return the signs of the bends of all initial curves, ±1, shape (m, links).

        All joints of a curve bend to one side, except for at most one run of consecutive joints.
        """
        links = self.arm.links
        places = np.unique(np.linspace(1, links, min(links, _ARC_PLACES)).astype(int))
        first, last = (np.ravel(each) for each in np.meshgrid(places, places))
        ordered = first <= last
        joint = np.arange(links)
        within = (joint >= first[ordered, None]) & (joint < last[ordered, None])
        sides = np.unique(np.where(within, -1.0, 1.0), axis=0)
        return np.vstack((sides, -sides))

    def _onto_goal(self, bends: FloatArray, bounds: FloatArray) -> FloatArray | None:
        """Return bends within bounds with the tip at the goal, by Newton's method, (links,) [rad]; None on failure.

        Args:
            bends: initial bends, shape (links,) [rad].
            bounds: bounds of the absolute bends, shape (links,) [rad].
        """
        arm = self.arm
        for _ in range(_ARC_STEPS):
            headings = arm.headings(bends)
            points = arm.joint_positions(headings)
            member = self.goal.nearest_member(points[-1], unit_vector(headings[-1]))
            # Row k of the lever is the vector from joint k to the tip.
            lever = (points[-1] - points[:-1]) / arm.length
            rows = np.stack((-lever[:, 1], lever[:, 0]))
            error = (member.position - points[-1]) / arm.length
            if member.heading is not None:
                rows = np.vstack((rows, np.ones(arm.links)))
                error = np.append(error, wrap(member.heading - headings[-1]))
            if np.abs(error).max() < _ARC_ARRIVED:
                return bends
            bends = np.clip(bends + self._step(rows, error, bends, bounds), -bounds, bounds)
        return None

    def _step(self, rows: FloatArray, error: FloatArray, bends: FloatArray, bounds: FloatArray) -> FloatArray:
        """Return the minimum-norm Newton step, with joints held that would leave their bounds, shape (links,) [rad].

        Args:
            rows: derivatives of tip position and, if given, heading, shape (e, links), in arm lengths and radians.
            error: required change of these, shape (e,).
            bends: current bends, shape (links,) [rad].
            bounds: bounds of the absolute bends, shape (links,) [rad].
        """
        free = np.ones(len(bends), dtype=bool)
        ridge = _ARC_RIDGE * np.eye(len(error))
        step = np.zeros(len(bends))
        for _ in range(_RELEASES):
            moving = rows * free
            step = moving.T @ np.linalg.solve(moving @ moving.T + ridge, error)
            step *= min(1.0, _ARC_TURN / max(float(np.abs(step).max()), TINY))
            # A joint at its bound is held if the step leads beyond it; others are clipped at the bound by the caller.
            held = free & (bends * np.sign(step) >= bounds * (1.0 - _ARC_RIDGE)) & (step != 0.0)
            if not held.any():
                break
            free &= ~held
        return step
