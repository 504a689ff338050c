"""Rails that hold an arm in the middle of a narrow gate.

In a gate with hardly any play the arm has to pass through the middle. With walls alone, a guide that pulls at the arm
would turn it askew in the gate; the first-order rows of a step then have no play left, and second-order terms violate
them. So it is an equation of every step, and of every inner keyframe of a motion, that the axis crosses the gate's
lines in their middle; a step keeps it to first order and Newton's method restores it. Before and behind the gate,
joints are pulled to the middle line.
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
"""Joints farther away than this are not on the rail, in nominal links. Taste."""
_ACROSS = 0.25
"""An axis counts as crossing a line where it does so at most this far from the line's middle, in nominal links.
Taste."""
_CATCHING_UP = 0.02
"""Largest move of a crossing towards the middle that a step asks for, in nominal links. Taste."""
_EXACT = 1e-6
"""Accepted distance from the middles, as a share of the arm's length. Taste: a thousandth of the play."""
_NEWTON_STEPS = 5
"""Most Newton steps onto the middles. Taste."""
_LARGEST_TURN = 0.15
"""A pose that needs larger turns of links to cross in the middle is left unchanged [rad]. Taste."""
_RIDGE = 1e-9
"""Regularisation of the normal equations, as a share of their diagonal. Taste."""

_SAME = 2e-3
"""Lines closer to each other than this share of a rail's length are one. Derived: rails of two paths through one gate
differ by rounding."""
_WEIGHT = 30.0
"""Weight on a joint's distance from the middle of its gate in excess of the play, relative to a nominal link's
distance. Taste: with three times as much, joints cannot give way to the goal."""
_PLACES = 61
"""Number of places on a gate's middle line at which its width is measured. Taste."""
_NARROWEST = 1e-3
"""Distances to walls that exceed the least by up to this share still count as narrowest. Taste: a hundredth of a gate's
width; lines before a rounded wall, where there is clearance to the side, would exclude motions that exist."""
_SHORT = 0.15
"""A narrowest stretch shorter than this multiple of the gate's half-width gets one line instead of one at either end.
Taste."""


@dataclass(frozen=True)
class LineCrossings:
    """Crossings of the axes of K poses with g lines; all entries are 0 where an axis does not cross a line.

    Attributes:
        link: index of the crossing link, shape (K, g).
        share: fraction of that link that lies before the crossing, shape (K, g).
        aside: signed distance of the crossing to the left of the line's middle, shape (K, g) [m].
        crossed: whether the axis crosses the line near its middle, shape (K, g).
    """

    link: IntArray
    share: FloatArray
    aside: FloatArray
    crossed: BoolArray


@dataclass(frozen=True, eq=False)
class GateLines:
    """The lines across all gates on the paths of a tip.

    Attributes:
        middles: points at which axes have to cross the lines, shape (g, 2) [m].
        along: direction of passage at each middle, shape (g, 2).
        inside: axes of the gates, used to find the links that are in a gate.
    """

    middles: FloatArray
    along: FloatArray
    inside: shapely.Geometry

    @classmethod
    def from_rails(cls, rails: tuple[FloatArray, ...], workspace: Workspace) -> "GateLines":
        """Return the lines across the gates whose middle lines are given.

        Args:
            rails: middle lines with their straight runs before and behind, each of shape (k ≥ 3, 2) [m].
            workspace: workspace whose walls determine where a gate is narrowest.
        """
        middles: list[FloatArray] = []
        along: list[FloatArray] = []
        for rail in rails:
            for place in _narrowest(rail[1:-1], workspace):
                # Paths on both sides of the arm may lead through the same gate.
                if all(np.hypot(*(place - other)) > _SAME * np.hypot(*(rail[-1] - rail[0])) for other in middles):
                    middles.append(place)
                    along.append(_direction(rail))
        gates = [shapely.LineString(np.vstack((rail[1:-1], rail[-2:-1]))) for rail in rails]
        return cls(np.array(middles), np.array(along), shapely.multilinestrings(gates))

    # ------------------------------------------------------------ crossings
    def crossings(self, points: FloatArray, farthest: float) -> LineCrossings:
        """Return the crossings of axes with the lines: for each line, the crossing nearest to its middle.

        Args:
            points: joints and tips of poses, shape (K, links + 1, 2) [m].
            farthest: largest distance from a line's middle that counts as a crossing [m].
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
        """Return derivatives of ``aside`` with respect to the coordinates, (K, g, p) [m per unit]; 0 without crossing.

        Args:
            jacobians: derivatives of the joints and tips of poses, shape (K, links + 1, 2, p) [m per unit].
            headings: headings of their links, shape (K, links) [rad].
            found: crossings of the poses.
        """
        pose = np.arange(len(headings))[:, None]
        share = found.share[..., None, None]
        moving = (1.0 - share) * jacobians[pose, found.link] + share * jacobians[pose, found.link + 1]
        heading = headings[pose, found.link]
        direction = np.stack((np.cos(heading), np.sin(heading)), axis=-1)
        # The crossing slides along its link as the link moves ahead.
        ahead = np.einsum("kgd,gd->kg", direction, self.along)
        slant = np.where(found.crossed, cross(self.along, direction) / np.where(found.crossed, ahead, 1.0), 0.0)
        across = np.column_stack((-self.along[:, 1], self.along[:, 0]))
        slopes = np.einsum("gd,kgdp->kgp", across, moving)
        slopes -= slant[..., None] * np.einsum("gd,kgdp->kgp", self.along, moving)
        return np.asarray(slopes * found.crossed[..., None])

    # ------------------------------------------------------------ poses put onto the lines
    def restored(self, space: LinkSpace, coordinates: FloatArray) -> FloatArray:
        """Return the coordinates of poses moved until their axes cross all lines in the middle.

        Uses Newton's method with the smallest turns of links.

        Args:
            space: the link space.
            coordinates: coordinates of the poses, shape (K, p).

        Returns:
            Shape (K, p); poses for which this fails, or needs large turns, are unchanged.
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
            # A line that is not crossed gets a unit diagonal and asks for no change; the ridge covers two lines that
            # are crossed by one short link.
            size = np.einsum("kgg->kg", normal)
            normal += np.eye(len(self.middles)) * np.where(found.crossed, _RIDGE * size, 1.0)[..., None]
            by = np.linalg.solve(normal, -found.aside[..., None])[..., 0]
            moved += np.einsum("kg,kgp->kp", by, spread)
        turned = np.abs((moved - coordinates) @ space.turns.T).max(axis=1)
        kept = (off <= 10.0 * exact) & (turned <= _LARGEST_TURN)
        return np.where(kept[:, None], moved, coordinates)

    # ------------------------------------------------------------ links in gates
    def holds_links(self, points: FloatArray, radius: float) -> BoolArray:
        """Return a mask of the links that are in gates, shape (K, links).

        Args:
            points: joints and tips of poses, shape (K, links + 1, 2) [m].
            radius: radius of the arm [m].
        """
        links = shapely.linestrings(np.stack((points[:, :-1], points[:, 1:]), axis=2))
        return np.asarray(shapely.dwithin(links, self._prepared, radius))

    @cached_property
    def _prepared(self) -> shapely.Geometry:
        shapely.prepare(self.inside)
        return self.inside


def _narrowest(middle: FloatArray, workspace: Workspace) -> list[FloatArray]:
    """Return both ends of the section of a middle line, shape (k, 2), at which walls are nearest.

    A short section is reduced to its centre.
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
    """Return the unit vector along which a gate is passed, shape (2,)."""
    way = rail[-2] - rail[1]
    if np.hypot(*way) <= 1e-3 * np.hypot(*(rail[-1] - rail[0])):
        way = rail[-1] - rail[0]
    return np.asarray(way / np.hypot(*way))


@dataclass(frozen=True, eq=False)
class GateRails(Limit):
    """Holds the axis in the middle of gates, and pulls joints sideways onto the gates' middle lines.

    Attributes:
        rails: middle lines with their straight runs, each of shape (k ≥ 2, 2) [m].
        lines: lines across the gates.
        play: distance from a rail within which a joint is not pulled [m].
    """

    rails: tuple[FloatArray, ...]
    lines: GateLines
    play: float

    @cached_property
    def _legs(self) -> tuple[FloatArray, FloatArray]:
        """Start points of the straight pieces of all rails, shape (m, 2) [m], and their directions with lengths.

        The directions are unit vectors in the first two columns of shape (m, 3); the third is the piece's length [m].
        """
        first = np.vstack([rail[:-1] for rail in self.rails])
        along = np.vstack([np.diff(rail, axis=0) for rail in self.rails])
        length = np.linalg.norm(along, axis=1)
        kept = length > 0.0
        return first[kept], np.column_stack((along[kept] / length[kept, None], length[kept]))

    # ------------------------------------------------------------ the single step
    def linearised(self, space: LinkSpace, pose: Pose, turn: float) -> LimitRows:
        """Return the equations of the lines that the axis crosses.

        Every joint that is in a gate, or on a run to it, also gets a pull.
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
        """Return the term that pulls joints on rails sideways onto the middle lines.

        The result is None where no joint is on a rail.
        """
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
        """Return the pose moved so that its axis crosses all lines in the middle.

        The pose is unchanged where that fails or would turn a link by more than ``most`` [rad].
        """
        moved = self.lines.restored(space, pose.v[None])[0]
        turned = np.max(np.abs(space.turns @ (moved - pose.v)))
        return space.pose(moved) if 0.0 < turned <= most else pose

    # ------------------------------------------------------------ at the goal
    def missed(self, space: LinkSpace, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return the slopes of the lines that a pose crosses, and how far it has to move across each.

        The slopes have the shape (k, p), the distances the shape (k,) [m].
        """
        found = self.lines.crossings(pose.points[None], _ACROSS * space.nominal_length)
        crossed = found.crossed[0]
        return self._slopes(space, pose, found)[crossed], -found.aside[0][crossed]

    def _slopes(self, space: LinkSpace, pose: Pose, found: LineCrossings) -> FloatArray:
        """Return the derivatives of a pose's distances from the middles of all lines, shape (g, p) [m per unit]."""
        return np.asarray(self.lines.slopes(pose.moving[None], space.arm.headings(pose.q)[None], found)[0])

    def met(self, pose: Pose) -> bool:
        """Return whether a pose crosses every line within ``play`` of the line's middle."""
        found = self.lines.crossings(pose.points[None], np.inf)
        return bool(np.all(np.abs(found.aside) <= self.play))

    # ------------------------------------------------------------ the optimisation of a motion
    def keyframe_equations(self, sweep: "PlanarSweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the equations of the lines that inner keyframes cross; the first and the last keyframe are fixed."""
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
        """Return the keyframes, shape (K + 1, p), the inner ones moved so that they cross the lines in the middle."""
        del u
        return np.vstack((coordinates[:1], self.lines.restored(space, coordinates[1:-1]), coordinates[-1:]))
