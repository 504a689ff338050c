"""Members of a goal set.

A wide tolerance makes the goal a set; planning leads routes to a few distinct members of it: at least one in every
piece of the set that the tip can get to, preferably those onto which the arm can run in straight, and far apart
otherwise. The search also accepts any other member that it comes by.

Goals that only a pose with joints at their limits can reach need few candidates. A curve of bounded curvature that
reaches as far as such a curve can is made of arcs of maximal curvature (Dubins, 1957), so the arm's poses are sought
among arcs of at most three parts.
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
"""Most members that are chosen, except that every piece has one. Taste: each gets routes of its own."""
_PIECES = 4
"""Pieces of the set that are considered, the largest first. Taste."""
_GRID = 9
"""Places across the set, in both directions. Taste."""
_TURN_STEP = 0.08726646259971647
"""Largest step between the headings that are considered [rad]. Taste: 5°."""
_TURN_SHARE = 0.1
"""Share of the arm's length that a turn of one radian counts for. Taste."""
_DIFFERENT = 0.04
"""Members that differ by less than this share of the arm's length count as one. Taste: a nominal link."""
_EDGE = 0.02
"""Distance of places from the edge of free space, as a share of the set's radius. Taste."""
_REACH = 0.99
"""Share of its length to which the arm is expected to stretch. Taste: at full stretch no step has a choice."""
_RUNS = (0.5, 1.0, 2.0)
"""Lengths of straight runs onto a member that are distinguished, in nominal links. Taste."""
_RUN_SAMPLES = 9
"""Number of places on a run that are checked for being free. Taste."""


_ARC_PLACES = 24
"""Number of joints at which an arc may change the side to which it bends. Taste."""
_MOST_TURN = 7.0
"""Arcs that would turn by more than this start with smaller bends, so that they do not coil up [rad]. Taste."""
_ARCS_TRIED = 16
"""Number of arcs from which Newton's method begins. Taste."""
_ARCS_KEPT = 4
"""Number of poses at the goal to which motions are sought. Taste."""
_ALIKE = 0.3
"""Poses of which no joint differs by more than this share of its limit are one. Taste."""
_ARC_STEPS = 30
"""Most steps of Newton's method. Taste."""
_ARC_TURN = 0.3
"""Largest turn of a joint in one of them [rad]. Taste."""
_ARC_RIDGE = 1e-13
"""Added to the diagonal of its equations, in squared arm lengths. Derived: some thousand roundings."""
_ARC_ARRIVED = 1e-11
"""Error of the tip, in arm lengths or radians, that counts as none. Derived: far below what the optimisation asks of a
motion's end."""

_AMPLE = 0.9
"""Share of the joints' limits with which guides reach a goal if an arc does. Measured: at 0.98, which steps use unless
an end asks for more, guides fail within 13 s at goals for which an arc needs 0.96 of the limits."""
_HEADING_LENGTH = 0.25
"""Distance of the tip, in arm lengths, that counts as much as a radian of its heading when the arcs that come nearest
to the goal are chosen. Taste."""
_RELEASES = 8
"""Most times that joints beyond their limits are held and the step is computed anew. Taste."""


@dataclass(frozen=True)
class GoalMember:
    """One position and heading of a goal.

    Attributes:
        position: position of the tip, shape (2,) [m].
        heading: heading of the tip [rad], or None where any is acceptable.
    """

    position: FloatArray
    heading: float | None


@dataclass(frozen=True)
class _Choice:
    """Members of a goal from which a selection is made.

    Attributes:
        places: positions, shape (m, 2) [m].
        headings: headings, shape (m,) [rad]; zeros where any is acceptable.
        runs: length of the straight run onto each member that is free, in nominal links, shape (m,).
        pieces: index of the piece of the set that each position belongs to, shape (m,).
    """

    places: FloatArray
    headings: FloatArray
    runs: FloatArray
    pieces: IntArray


def goal_members(arm: Arm, goal: GoalPose, room: FreeSpace, fed: float = 0.0) -> tuple[GoalMember, ...]:
    """Return the members of a goal to which routes are led; only the goal itself when it is not a set.

    Args:
        arm: the arm.
        goal: goal of the tip.
        room: free space of the arm's axis.
        fed: distance by which the base can still advance [m].

    Returns:
        The members, first the one chosen for each piece of the set, then additional ones. Empty only if the whole set
        is closed to the tip.
    """
    if not goal.is_set:
        return (GoalMember(goal.position, goal.heading),)
    choice = _choice(arm, goal, room, fed)
    chosen = _far_apart(arm, goal, choice)
    any_heading = goal.heading is None
    return tuple(GoalMember(choice.places[k], None if any_heading else float(choice.headings[k])) for k in chosen)


def _choice(arm: Arm, goal: GoalPose, room: FreeSpace, fed: float) -> _Choice:
    """Return all combinations of positions and headings from which members are selected."""
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
    """Return a mask of the positions and headings onto which a straight run is free, shape (m,).

    Args:
        room: free space.
        places: positions, shape (m, 2) [m].
        headings: headings, shape (m,) [rad].
        length: length of the run [m].
    """
    back = -np.linspace(0.0, length, _RUN_SAMPLES)
    samples = places[:, None] + back[:, None] * unit_vector(headings).reshape(-1, 2)[:, None]
    return np.asarray(room.contains(samples.reshape(-1, 2)).reshape(len(places), -1).all(axis=1))


def _headings(goal: GoalPose) -> FloatArray:
    """Return evenly spaced headings within the tolerance, including the middle one, shape (h,) [rad]."""
    if goal.heading is None:
        return np.zeros(1)
    steps = int(np.ceil(goal.room[1] / _TURN_STEP))
    return goal.heading + np.linspace(-goal.room[1], goal.room[1], 2 * steps + 1)


def _places(arm: Arm, goal: GoalPose, room: FreeSpace, fed: float) -> tuple[FloatArray, IntArray]:
    """Return positions of a goal set, shape (m, 2) [m], with the index of each one's piece of the set, shape (m,).

    Only positions connected with the base and within the arm's reach are included.
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

    They are the points nearest to the middle of the set and to the base, the point with the widest clearance, and
    a grid.
    """
    roomiest = shapely.get_coordinates(shapely.maximum_inscribed_circle(piece))[:1]
    # Slightly inside: at the very edge of free space no step has a choice.
    inside = piece.buffer(-_EDGE * width)
    inside = piece if inside.is_empty else inside
    ends = [shapely.get_coordinates(shapely.shortest_line(inside, end))[:1] for end in (middle, base)]
    across = np.linspace(-width, width, _GRID)
    grid = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2) + shapely.get_coordinates(middle)
    return np.concatenate([*ends, roomiest, grid[shapely.intersects_xy(inside, grid[:, 0], grid[:, 1])]])


def _far_apart(arm: Arm, goal: GoalPose, choice: _Choice) -> list[int]:
    """Return the indices of selected members that are far apart from one another.

    The best member of every piece is selected first, then repeatedly the member farthest from all selected ones.
    """
    if len(choice.places) == 0:
        return []
    off = np.linalg.norm(choice.places - goal.position, axis=1) / arm.length
    turned = np.abs(choice.headings - (goal.heading or 0.0)) * _TURN_SHARE
    # A member with a longer straight run is preferred before anything else.
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
    """Return by how much each member differs from member k, in arm lengths, shape (m,)."""
    off = np.linalg.norm(choice.places - choice.places[k], axis=1) / arm.length
    turned = np.abs(wrap(choice.headings - choice.headings[k])) * _TURN_SHARE
    return np.asarray(off + turned)


@dataclass(frozen=True)
class ArcsAtLimits:
    """Finds poses of arcs, bent up to the joint limits, that reach a goal.

    Attributes:
        arm: arm on a fixed base.
        goal: goal for the tip.
    """

    arm: Arm
    goal: GoalPose

    def where_needed(self, full: float) -> tuple[FloatArray, ...]:
        """Return poses at the goal that use the joint limits in full; none if smaller bends suffice.

        Args:
            full: fraction of the joint limits that poses may use.

        Returns:
            Configurations, not checked for contact, each of shape (links,) [rad].
        """
        if self.poses(_AMPLE, 1):
            return ()
        return self.poses(full, _ARCS_KEPT)

    def poses(self, share: float, most: int) -> tuple[FloatArray, ...]:
        """Return distinct poses at the goal within a fraction of the joint limits, from the nearest arcs first.

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
        """Return the bends of the arcs whose tip comes nearest to the goal, shape (m, links) [rad].

        The base is turned so that the tip lies in the direction of the goal.
        """
        arm = self.arm
        bends = np.minimum(bounds, _MOST_TURN / arm.links) * self._sides()
        bends[:, 0] = 0.0
        turned = np.cumsum(bends, axis=1)
        shares = arm.length_shares
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
        """Return the side to which each joint of each arc bends, ±1, shape (m, links).

        In each arc all joints bend to one side, except for at most one stretch of joints.
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
        """Return bends within bounds that put the tip onto the goal, shape (links,) [rad].

        They are found by Newton's method from given bends; None where the method fails.
        """
        arm = self.arm
        for _ in range(_ARC_STEPS):
            headings = arm.headings(bends)
            points = arm.joint_positions(headings)
            member = self.goal.nearest_member(points[-1], unit_vector(headings[-1]))
            # Joint k turns the tip about itself.
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
        """Return the least change of the joints that are not held at a limit, one Newton step, shape (links,) [rad]."""
        free = np.ones(len(bends), dtype=bool)
        ridge = _ARC_RIDGE * np.eye(len(error))
        step = np.zeros(len(bends))
        for _ in range(_RELEASES):
            moving = rows * free
            step = moving.T @ np.linalg.solve(moving @ moving.T + ridge, error)
            step *= min(1.0, _ARC_TURN / max(float(np.abs(step).max()), TINY))
            # A joint at its limit is held if it would go beyond; one on its way there is clipped.
            held = free & (bends * np.sign(step) >= bounds * (1.0 - _ARC_RIDGE)) & (step != 0.0)
            if not held.any():
                break
            free &= ~held
        return step
