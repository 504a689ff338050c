"""Samples of views from which pieces of surfaces are seen.

A view is a ball of tip positions and a cone of directions, from all of which certain pieces are seen.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray, in_space
from ccm_opt.driver.set_cover import greedy_order
from ccm_opt.driver.sight_lines import (
    AT_POSE,
    ERRORS,
    HALF_ANGLE,
    clear_tips,
    crossed,
    end_room,
    hidden_by_arm,
    sight_room,
)
from ccm_opt.driver.views import beyond_reach, sampled_tips
from ccm_opt.problem import Coverage, LookAt, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surface_pieces import SurfacePieces
from ccm_opt.scene.tool_links import points_with_tool

_SAMPLED = 150
"""Number of pieces about which tip positions are sampled. Heuristic."""
_LINES = {2: 9, 3: 16}
"""Number of sampled lines of sight to either side of such a piece, in the plane and in space. Heuristic."""
_TIPS = {2: 200, 3: 400}
"""Number of tip positions of views. Heuristic."""
_FURTHER = 300
"""Number of pieces without a view about which positions are sampled again. Heuristic."""
_TIPS_APIECE = 3
"""Number of positions of views for each of these. Heuristic."""
_DIRECTIONS = 5
"""Largest number of directions of views at one position. Heuristic."""
_LEAST_GAIN = 0.2
"""Least weight of what a further direction sees, relative to the first one. Heuristic."""
_AXES = 24
"""Number of directions among which those of views are chosen. Heuristic."""
_TURN = float(np.deg2rad(3.0))
"""Least half angle of the cone of directions of a view, but for narrow fields of view [rad]. Heuristic."""
_TURN_SHARE = 0.2
"""This angle as a fraction of half the field of view, at most. Heuristic."""
LEAST_ROOM = 0.004
"""Least radius of the ball of positions of a view, as a fraction of the arm's length. Heuristic."""
NOT_LOOKED_AT, OUT_OF_REACH, NO_ROOM, NO_POSE = -4, -3, -2, -1
"""Reasons why a piece has no view; indices of obstacles, which hide it, are from 0."""


@dataclass(frozen=True, eq=False)
class Views:
    """Sampled views, n of m pieces.

    Attributes:
        tips: tip positions, shape (n, d) [m].
        axes: directions of the camera, shape (n, d).
        sees: pieces that are seen from the whole of each view, shape (n, m).
    """

    tips: FloatArray
    axes: FloatArray
    sees: BoolArray

    def with_further(self, other: "Views") -> "Views":
        """Return these views and others."""
        both = ((self.tips, other.tips), (self.axes, other.axes), (self.sees, other.sees))
        return Views(*map(np.concatenate, both))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class ViewSampler:
    """Samples views of the pieces of surfaces.

    Attributes:
        problem: problem with the tool as links.
        coverage: what has to be seen.
        pieces: its pieces.
        tree: distances from the obstacles.
    """

    problem: Problem
    coverage: Coverage
    pieces: SurfacePieces
    tree: SurfaceTree

    @property
    def _least(self) -> float:
        """Least radius of the ball of positions of a view [m]."""
        return LEAST_ROOM * self.problem.arm.length

    def sampled(self, rng: np.random.Generator, seen: BoolArray) -> tuple[Views, IntArray]:
        """Return sampled views of pieces, and for each piece the reason why it has none, shape (m,).

        Args:
            rng: source of the samples.
            seen: mask of the pieces that are seen already, about which none are sampled, shape (m,).
        """
        dimension, count = self.problem.dimension, len(self.pieces.sizes)
        unseen = ~seen & (self.pieces.sizes > 0.0)
        some = rng.permutation(np.flatnonzero(unseen))[:_SAMPLED]
        tips = np.concatenate([np.zeros((0, dimension)), *(self._tips(piece)[1] for piece in some)])
        views = self.at(np.zeros((0, dimension)), np.zeros((0, dimension)))
        if len(tips):
            views = self._of(rng.permutation(tips)[: _TIPS[dimension]])
        reasons = np.full(count, NO_POSE)
        without = rng.permutation(np.flatnonzero(~np.any(views.sees, axis=0) & unseen))
        if len(without) == 0:
            return views, reasons
        looked_at = without[:_FURTHER]
        further = [np.zeros((0, dimension))]
        for piece in looked_at:
            reasons[piece], free = self._looked_at(int(piece))
            further.append(rng.permutation(free)[:_TIPS_APIECE])
        # The reason for each of the others is that for the nearest.
        nearest = cKDTree(self.pieces.centres[looked_at]).query(self.pieces.centres[without])[1]
        reasons[without] = reasons[looked_at][nearest]
        more = np.concatenate(further)
        return (views.with_further(self._of(more)) if len(more) else views), reasons

    def _tips(self, piece: int) -> tuple[int, FloatArray]:
        """Return why there may be none, and the clear tip positions sampled to both sides of a piece, (k, d) [m]."""
        place, normal = self.pieces.centres[piece], self.pieces.normals[piece]
        asked = LookAt(place, self.coverage.distance, self.coverage.field_of_view, normal, self.coverage.angle)
        sides = (asked, replace(asked, normal=-normal))
        tips = np.concatenate([sampled_tips(side, _LINES[self.problem.dimension])[0] for side in sides])
        tips = tips[beyond_reach(self.problem.arm, tips) <= 0.0]
        clear = tips[clear_tips(self.problem, self.tree, tips)] if len(tips) else tips
        return (NO_ROOM if len(tips) else OUT_OF_REACH), clear

    def _looked_at(self, piece: int) -> tuple[int, FloatArray]:
        """Return why a piece has no view, and clear tip positions from which it is seen, shape (k, d) [m]."""
        reason, tips = self._tips(piece)
        if len(tips) == 0:
            return reason, tips
        rooms = self.rooms(tips, np.full(len(tips), piece), self._least)
        free = tips[rooms >= self._least]
        if len(free):
            return NO_POSE, free
        place = self.pieces.centres[piece]
        lines = np.stack((in_space(place + 0.01 * (tips - place)), in_space(tips)), axis=1)
        hiding = self.tree.nearest(lines, float(self.coverage.distance[1])).owner
        return (Counter(hiding[hiding >= 0].tolist()).most_common(1) or [(NO_ROOM, 0)])[0][0], free

    def rooms(self, tips: FloatArray, pieces: IntArray, most: float, half_angle: float = HALF_ANGLE) -> FloatArray:
        """Return the radii of balls about tips from which pieces are seen, up to ``most``, shape (k,) [m].

        Distances and angles count, the field of view does not. A radius is not positive if the piece is hidden.

        Args:
            tips: tip positions, shape (k, d) [m].
            pieces: the piece that each looks at, shape (k,).
            most: radius above which more does not matter [m].
            half_angle: half angle of the cone about lines of sight that is kept free [rad].
        """
        places = self.pieces.centres[pieces]
        rooms = self._angular_rooms(places - tips, self.pieces.normals[pieces])
        maybe = np.flatnonzero(rooms > 0.0)
        rooms[maybe[crossed(self.tree, places[maybe], tips[maybe])]] = -1.0
        maybe = maybe[rooms[maybe] > 0.0]
        some, from_tips = places[maybe], tips[maybe]
        blind = ERRORS * self.problem.workspace.surface_errors[self.pieces.owner[pieces[maybe]]]
        free, _ = sight_room(self.tree, some, from_tips, most, half_angle)
        rooms[maybe] = np.minimum(np.minimum(rooms[maybe], free), end_room(self.tree, some, from_tips, blind, most))
        return rooms

    def _angular_rooms(self, sights: FloatArray, normals: FloatArray) -> FloatArray:
        """Return how far tips may move until distances or angles to normals are wrong, shape (k,) [m].

        Args:
            sights: vectors from the tips to the places, shape (k, d) [m].
            normals: normals there, shape (k, d).
        """
        away = np.linalg.norm(sights, axis=1)
        off = np.arccos(np.clip(np.abs(np.sum(sights * normals, axis=1)) / np.maximum(away, 1e-300), 0.0, 1.0))
        least, most = self.coverage.distance
        inside = np.minimum(away - least, most - away)
        return np.asarray(np.minimum(inside, away * np.sin(self.coverage.angle - off)))

    def _of(self, tips: FloatArray) -> Views:
        """Return the views at tip positions (n, d) [m], in the directions in which most is seen."""
        found = [self._directions(place, *free) for place, free in zip(tips, self._free(tips), strict=True)]
        return Views(*map(np.concatenate, zip(*found, strict=True)))

    def at(self, tips: FloatArray, axes: FloatArray) -> Views:
        """Return the views at given tip positions with given directions, each of shape (n, d) [m]."""
        sees = np.zeros((len(tips), len(self.pieces.sizes)), dtype=bool)
        for row, axis, (mine, sights) in zip(sees, axes, self._free(tips), strict=True):
            lines, within = self._within(sights)
            row[mine] = np.arccos(np.clip(lines @ axis, -1.0, 1.0)) <= within
        return Views(tips, axes, sees)

    def from_poses(self, arm: Arm, poses: Sequence[FloatArray]) -> Views:
        """Return the views of an arm in n poses, each of shape (c,), in which it may hide pieces from itself."""
        tips, axes = np.zeros((2, len(poses), self.problem.dimension))
        sees = np.zeros((len(poses), len(self.pieces.sizes)), dtype=bool)
        for k, q in enumerate(poses):
            before, tips[k] = points_with_tool(arm, q)[-2:]
            axes[k] = (tips[k] - before) / np.linalg.norm(tips[k] - before)
            sights = self.pieces.centres - tips[k]
            ahead = sights @ axes[k] > np.cos(0.5 * self.coverage.field_of_view) * np.linalg.norm(sights, axis=1)
            mine = np.flatnonzero(ahead & (self._angular_rooms(sights, self.pieces.normals) > 0.0))
            mine = mine[~hidden_by_arm(arm, q, self.pieces.centres[mine], AT_POSE)]
            rooms = self.rooms(np.broadcast_to(tips[k], (len(mine), len(tips[k]))), mine, self._least, AT_POSE)
            sees[k, mine] = rooms > 0.0
        return Views(tips, axes, sees)

    def _free(self, tips: FloatArray) -> Iterator[tuple[IntArray, FloatArray]]:
        """Yield the pieces to which sight is free from each position, (k,), and vectors to them, shape (k, d) [m]."""
        centres, normals = self.pieces.centres, self.pieces.normals
        near = np.zeros((len(tips), len(centres)), dtype=bool)
        for row, tip in zip(near, tips, strict=True):
            row[:] = self._angular_rooms(centres - tip, normals) >= self._least
        tip, piece = np.nonzero(near)
        near[tip, piece] = self.rooms(tips[tip], piece, self._least) >= self._least
        for place, mine in zip(tips, near, strict=True):
            pieces = np.flatnonzero(mine)
            yield pieces, centres[pieces] - place

    def _within(self, sights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return unit vectors along sights (k, d) [m], and their greatest angles off the direction, (k,) [rad]."""
        away = np.linalg.norm(sights, axis=1)
        half = 0.5 * self.coverage.field_of_view
        turn = min(_TURN, _TURN_SHARE * half)
        return sights / away[:, None], half - turn - np.arcsin(np.minimum(self._least / away, 1.0))

    def _directions(
        self, tip: FloatArray, mine: IntArray, sights: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return tip, direction and pieces of the views at one position, the one that sees most first.

        Args:
            tip: the position, shape (d,) [m].
            mine: indices of the k pieces to which sight is free.
            sights: vectors from the position to them, shape (k, d) [m].
        """
        lines, within = self._within(sights)
        tried = np.vstack((self.pieces.sizes[mine] @ lines, lines[:: max(len(lines) // _AXES, 1)]))
        tried = tried[np.linalg.norm(tried, axis=1) > 1e-9]
        tried /= np.linalg.norm(tried, axis=1)[:, None]
        inside = np.arccos(np.clip(tried @ lines.T, -1.0, 1.0)) <= within
        order = greedy_order(inside, self.pieces.sizes[mine])[:_DIRECTIONS]
        gains = inside[order] @ self.pieces.sizes[mine]
        order = order[gains >= _LEAST_GAIN * np.max(gains, initial=0.0)]
        sees = np.zeros((len(order), len(self.pieces.sizes)), dtype=bool)
        sees[:, mine] = inside[order]
        return np.tile(tip, (len(order), 1)), tried[order], sees
