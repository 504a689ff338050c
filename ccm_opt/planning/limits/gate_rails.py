"""Rails that hold an arm in the middle of a narrow gate.

In a gate with hardly any play the arm has no choice but to pass its middle: that its axis crosses every such line there
is an equation, which a step keeps to first order and Newton's method restores.

Walls alone would hold the arm askew in a gate as soon as a guide pulls at it: then the first order of a step leaves no
play, and the second takes what there is not. So that the axis crosses a gate in its middle is an equation of every
step, and of every inner keyframe of a motion; before and behind the gate joints are drawn to the middle line.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.core.polygons import cross
from ccm_opt.core.polyline import arc_lengths, points_at
from ccm_opt.planning.limits.limit import KeyframeRows, Limit, LimitRows
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.scene.workspace import Workspace

if TYPE_CHECKING:
    from ccm_opt.planning.swept_motion import PlanarSweep

_BESIDE = 0.5
"""Joints farther off than this are not on the rail, in nominal links. Taste."""
_ACROSS = 0.25
"""A line is crossed where that is no farther from its middle, in nominal links. Taste."""
_CATCHING_UP = 0.02
"""Most that a step asks a crossing to move towards the middle, in nominal links. Taste."""
_EXACT = 1e-6
"""Distance from the middles that is left, as a share of the arm's length. Taste: a thousandth of the play."""
_NEWTON_STEPS = 5
"""Most steps onto the middles. Taste."""
_LARGEST_TURN = 0.15
"""A pose that needs larger turns of links to cross in the middle is left as it is [rad]. Taste."""
_RIDGE = 1e-9
"""Share of the diagonal of the normal equations. Taste."""

_SAME = 2e-3
"""Lines nearer to each other than this share of a rail are one. Derived: rails of two paths through one gate differ by
rounding."""
_WEIGHT = 30.0
"""On a joint's distance from the middle of its gate beyond a part of the play, against a nominal link's distance.
Taste: with three times as much joints cannot give way to the goal."""
_PLACES = 61
"""Of a gate's middle line at which it is measured where it is narrowest. Taste."""
_NARROWEST = 1e-3
"""By this share more than the least distance to walls still counts as narrowest. Taste: a hundredth of a gate's width;
lines before a rounded wall, where there is room aside, refuse motions that exist."""
_SHORT = 0.15
"""A stretch shorter than this many radii of the gate has one line, not one at either end. Taste."""


@dataclass(frozen=True)
class LineCrossings:
    """Where the axes of K poses cross g lines; where an axis crosses none, everything is 0.

    Attributes:
        link: that crosses, shape (K, g).
        share: of the link before its crossing, shape (K, g).
        aside: how far to the left of the line's middle, shape (K, g) [m].
        crossed: whether the axis crosses the line near its middle, shape (K, g).
    """

    link: IntArray
    share: FloatArray
    aside: FloatArray
    crossed: BoolArray


@dataclass(frozen=True, eq=False)
class GateLines:
    """The lines of all gates on the ways of a tip.

    Attributes:
        middles: where axes have to cross, shape (g, 2) [m].
        along: direction in which a gate leads there, shape (g, 2).
        inside: axes of the gates, by which links that are in them are known.
    """

    middles: FloatArray
    along: FloatArray
    inside: shapely.Geometry

    @classmethod
    def from_rails(cls, rails: tuple[FloatArray, ...], workspace: Workspace) -> "GateLines":
        """Return the lines of gates with walls about them.

        Args:
            rails: middle lines with their runs before and behind, each of shape (k ≥ 3, 2) [m].
            workspace: its walls say where a gate is narrowest.
        """
        middles: list[FloatArray] = []
        along: list[FloatArray] = []
        for rail in rails:
            for place in _narrowest(rail[1:-1], workspace):
                # Paths on both sides of the arm lead through the same gates.
                if all(np.hypot(*(place - other)) > _SAME * np.hypot(*(rail[-1] - rail[0])) for other in middles):
                    middles.append(place)
                    along.append(_direction(rail))
        gates = [shapely.LineString(np.vstack((rail[1:-1], rail[-2:-1]))) for rail in rails]
        return cls(np.array(middles), np.array(along), shapely.multilinestrings(gates))

    # ------------------------------------------------------------ crossings
    def crossings(self, points: FloatArray, farthest: float) -> LineCrossings:
        """Return where axes cross the lines nearest to their middles.

        Args:
            points: joints and tips of poses, shape (K, links + 1, 2) [m].
            farthest: from a line's middle [m].
        """
        off = points[:, None] - self.middles[:, None]
        ahead = np.einsum("kgjd,gd->kgj", off, self.along)
        aside = cross(self.along[:, None], off)
        crosses = (ahead[..., :-1] < 0.0) != (ahead[..., 1:] < 0.0)
        way = ahead[..., 1:] - ahead[..., :-1]
        share = np.where(crosses, -ahead[..., :-1] / np.where(crosses, way, 1.0), 0.0)
        there = aside[..., :-1] + share * (aside[..., 1:] - aside[..., :-1])
        link = np.argmin(np.where(crosses, np.abs(there), np.inf), axis=2)
        pose, line = np.indices(link.shape)
        there = there[pose, line, link]
        crossed = crosses[pose, line, link] & (np.abs(there) < farthest)
        return LineCrossings(link, share[pose, line, link], np.where(crossed, there, 0.0), crossed)

    def slopes(self, jacobians: FloatArray, headings: FloatArray, found: LineCrossings) -> FloatArray:
        """Return derivatives of ``aside`` by the coordinates, shape (K, g, p) [m per unit]; 0 where nothing crosses.

        Args:
            jacobians: of the joints of poses, shape (K, links + 1, 2, p) [m per unit].
            headings: of their links, shape (K, links) [rad].
            found: where they cross.
        """
        pose = np.arange(len(headings))[:, None]
        share = found.share[..., None, None]
        moving = (1.0 - share) * jacobians[pose, found.link] + share * jacobians[pose, found.link + 1]
        heading = headings[pose, found.link]
        direction = np.stack((np.cos(heading), np.sin(heading)), axis=-1)
        # The crossing slides along its link as this moves ahead.
        ahead = np.einsum("kgd,gd->kg", direction, self.along)
        slant = np.where(found.crossed, cross(self.along, direction) / np.where(found.crossed, ahead, 1.0), 0.0)
        across = np.column_stack((-self.along[:, 1], self.along[:, 0]))
        slopes = np.einsum("gd,kgdp->kgp", across, moving)
        slopes -= slant[..., None] * np.einsum("gd,kgdp->kgp", self.along, moving)
        return np.asarray(slopes * found.crossed[..., None])

    # ------------------------------------------------------------ poses put onto the lines
    def restored(self, space: LinkSpace, coordinates: FloatArray) -> FloatArray:
        """Coordinates of poses moved by Newton's method, with the least turns of links, until all cross in the middle.

        Args:
            space: the link space.
            coordinates: shape (K, p).

        Returns:
            Shape (K, p); those that do not come to cross in the middle, or only by large turns, as they were.
        """
        moved = coordinates.copy()
        exact = _EXACT * space.arm.length
        off = np.full(len(moved), np.inf)
        for _ in range(_NEWTON_STEPS):
            q = space.configurations(moved)
            headings = space.arm.headings(q)
            found = self.crossings(space.arm.joint_positions_at(q), _ACROSS * space.nominal_length)
            off = np.abs(found.aside).max(axis=1, initial=0.0)
            if np.all(off <= exact):
                break
            slopes = self.slopes(space.jacobians(headings), headings, found)
            spread = slopes @ space.inverse_metric
            normal = np.einsum("kgp,khp->kgh", spread, slopes)
            # Lines that nothing crosses ask for nothing; the ridge is for two lines that are crossed by one short link.
            size = np.einsum("kgg->kg", normal)
            normal += np.eye(len(self.middles)) * np.where(found.crossed, _RIDGE * size, 1.0)[..., None]
            by = np.linalg.solve(normal, -found.aside[..., None])[..., 0]
            moved += np.einsum("kg,kgp->kp", by, spread)
        turned = np.abs((moved - coordinates) @ space.turns.T).max(axis=1)
        kept = (off <= 10.0 * exact) & (turned <= _LARGEST_TURN)
        return np.where(kept[:, None], moved, coordinates)

    # ------------------------------------------------------------ links in gates
    def holds_links(self, points: FloatArray, radius: float) -> BoolArray:
        """Return which links are in gates, shape (K, links).

        Args:
            points: joints and tips of poses, shape (K, links + 1, 2) [m].
            radius: of the arm [m].
        """
        links = shapely.linestrings(np.stack((points[:, :-1], points[:, 1:]), axis=2))
        return np.asarray(shapely.dwithin(links, self._prepared, radius))

    @cached_property
    def _prepared(self) -> shapely.Geometry:
        shapely.prepare(self.inside)
        return self.inside


def _narrowest(middle: FloatArray, workspace: Workspace) -> list[FloatArray]:
    """Return both ends of the stretch of a middle line (k, 2) where walls are nearest.

    One place where that is short.
    """
    arcs = arc_lengths(middle)
    places = points_at(middle, arcs, np.linspace(0.0, arcs[-1], _PLACES)) if arcs[-1] > 0.0 else middle[:1]
    spots = shapely.points(places)
    beside = np.min([shapely.distance(spots, wall.core) - wall.rounding for wall in workspace.walls], axis=0)
    least = np.flatnonzero(beside <= (1.0 + _NARROWEST) * beside.min())
    first = places[least[0]]
    last = places[least[-1]]
    if np.hypot(*(last - first)) <= _SHORT * beside.min():
        return [0.5 * (first + last)]
    return [first, last]


def _direction(rail: FloatArray) -> FloatArray:
    """Return the direction in which a gate is passed, shape (2,)."""
    way = rail[-2] - rail[1]
    if np.hypot(*way) <= 1e-3 * np.hypot(*(rail[-1] - rail[0])):
        way = rail[-1] - rail[0]
    return np.asarray(way / np.hypot(*way))


@dataclass(frozen=True, eq=False)
class GateRails(Limit):
    """Holds the axis in the middle of gates, and draws joints onto their middle lines, across them alone.

    Attributes:
        rails: middle lines with their straight runs, each of shape (k ≥ 2, 2) [m].
        lines: across the gates.
        play: distance from a rail up to which a joint is left alone [m].
    """

    rails: tuple[FloatArray, ...]
    lines: GateLines
    play: float

    @cached_property
    def _legs(self) -> tuple[FloatArray, FloatArray]:
        """First points and directions of all legs, each (m, 3): the third number is the leg's length [m]."""
        first = np.vstack([rail[:-1] for rail in self.rails])
        along = np.vstack([np.diff(rail, axis=0) for rail in self.rails])
        length = np.linalg.norm(along, axis=1)
        kept = length > 0.0
        return first[kept], np.column_stack((along[kept] / length[kept, None], length[kept]))

    # ------------------------------------------------------------ the single step
    def linearised(self, space: LinkSpace, pose: Pose, turn: float) -> LimitRows:
        """Return the equations of the lines that the axis crosses.

        A pull on every joint that is in a gate or on a run to it.
        """
        del turn
        unit = space.nominal_length
        found = self.lines.crossings(pose.points[None], _ACROSS * unit)
        crossed = found.crossed[0]
        slopes = self._slopes(space, pose, found)[crossed] / unit
        most = _CATCHING_UP
        back = np.clip(-found.aside[0][crossed] / unit, -most, most)
        rows = LimitRows(slopes, back, back, equations=len(back))
        pull = self._pull(space, pose)
        return rows if pull is None else replace(rows, pulls=(pull,))

    def _pull(self, space: LinkSpace, pose: Pose) -> Term | None:
        """Return what draws the joints on rails across them; None where there is none."""
        unit = space.nominal_length
        first, legs = self._legs
        off = pose.points[:, None] - first
        along = np.einsum("jmk,mk->jm", off, legs[:, :2])
        across = off[..., 1] * legs[:, 0] - off[..., 0] * legs[:, 1]
        within = (along >= 0.0) & (along <= legs[:, 2])
        beside = np.where(within, np.abs(across), np.inf)
        leg = np.argmin(beside, axis=1)
        joint = np.flatnonzero(beside[np.arange(len(leg)), leg] < _BESIDE * unit)
        joint = joint[joint > 0]  # the base cannot move
        if len(joint) == 0:
            return None
        chosen = leg[joint]
        normal = np.column_stack((-legs[chosen, 1], legs[chosen, 0]))
        slopes = np.einsum("jk,jkp->jp", normal, pose.moving[joint]) / unit
        apart = across[joint, chosen]
        wanted = -np.sign(apart) * np.maximum(np.abs(apart) - self.play, 0.0) / unit
        return Term(slopes, wanted, _WEIGHT)

    def restored(self, space: LinkSpace, pose: Pose, most: float) -> Pose:
        """Return a pose after a step moved so that the axis crosses in the middle; as it is where that fails."""
        moved = self.lines.restored(space, pose.v[None])[0]
        turned = np.max(np.abs(space.turns @ (moved - pose.v)))
        return space.pose(moved) if 0.0 < turned <= most else pose

    # ------------------------------------------------------------ at the goal
    def missed(self, space: LinkSpace, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Slopes of the lines that a pose crosses, shape (k, p), and how far it has to be moved across them [m]."""
        found = self.lines.crossings(pose.points[None], _ACROSS * space.nominal_length)
        crossed = found.crossed[0]
        return self._slopes(space, pose, found)[crossed], -found.aside[0][crossed]

    def _slopes(self, space: LinkSpace, pose: Pose, found: LineCrossings) -> FloatArray:
        """Return the derivatives of how far aside a pose crosses every line, shape (g, p) [m per unit]."""
        return np.asarray(self.lines.slopes(pose.moving[None], space.arm.headings(pose.q)[None], found)[0])

    def met(self, pose: Pose) -> bool:
        """Return whether a pose crosses every line in the middle, up to the play beside which joints are left alone."""
        found = self.lines.crossings(pose.points[None], np.inf)
        return bool(np.all(np.abs(found.aside) <= self.play))

    # ------------------------------------------------------------ the optimisation of a motion
    def keyframe_equations(self, sweep: "PlanarSweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the equations of the lines that are crossed by inner keyframes; both ends stand where they do."""
        del u
        space = sweep.space
        links = space.arm.links
        found = self.lines.crossings(sweep.points[:, : links + 1], _ACROSS * space.nominal_length)
        slopes = self.lines.slopes(sweep.moving, sweep.headings, found) / space.nominal_length
        crossed = found.crossed.copy()
        crossed[[0, -1]] = False
        keyframe, line = np.nonzero(crossed)
        zero = np.zeros(len(keyframe))
        return (KeyframeRows(keyframe, slopes[keyframe, line], zero, zero),)

    def restored_keyframes(self, space: LinkSpace, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Return the inner keyframes moved so that they cross in the middle."""
        del u
        return np.vstack((coordinates[:1], self.lines.restored(space, coordinates[1:-1]), coordinates[-1:]))
