"""Limit that holds a planar arm in the middle of narrow gates.

A gate is a passage that is hardly wider than the arm; its rail is its middle line, extended straight before and behind.
With the linearised constraints on clearance alone, a step would turn the arm askew in the gate, where they leave no
clearance and second-order terms violate them. So every QP step, and every inner keyframe of a motion, has equations:
the arm's centre line has to cross lines across the gate in their middle. A step satisfies these equations to first
order, and Newton's method then exactly. Before and behind the gate, joints are pulled to the rail.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, cast

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
"""Distance from a rail within which a joint is pulled to the rail, in nominal links. Heuristic."""
_ACROSS = 0.25
"""Distance from the middle of a line across a gate within which the arm's centre line counts as crossing it, in nominal
links. Heuristic."""
_CATCHING_UP = 0.02
"""Largest displacement of a crossing towards the middle of its line that one step requires, in nominal links.
Heuristic."""
_EXACT = 1e-6
"""Distance from the middle of a line across a gate at which a crossing is accepted, as a fraction of the arm's length.
Heuristic: a thousandth of the clearance in a gate."""
_NEWTON_STEPS = 5
"""Maximum number of Newton steps that move crossings onto the middles of the lines across gates. Heuristic."""
_LARGEST_TURN = 0.15
"""Largest turn of a link by which a pose is moved so that it crosses gates in the middle; beyond that, the pose is left
unchanged [rad]. Heuristic."""
_RIDGE = 1e-9
"""Regularisation of the normal equations, as a fraction of their diagonal. Heuristic."""

_SAME = 2e-3
"""Distance below which two lines across gates count as one, as a fraction of a rail's length. Derived: rails of two
paths through one gate differ by rounding."""
_WEIGHT = 30.0
"""Weight on the distance of a joint from its rail in excess of the tolerance, relative to a distance of a nominal link.
Heuristic: with three times as much, joints cannot give way to the goal."""
_PLACES = 61
"""Number of points on the middle line of a gate at which the width is measured. Heuristic."""
_NARROWEST = 1e-3
"""Relative excess over the minimum distance to walls up to which a point still counts as narrowest. Heuristic; with
lines before a rounded wall, where there is clearance to the side, feasible motions would be excluded."""
_SHORT = 0.15
"""Length of a gate's narrowest section below which one line is put across its centre, instead of one across either end,
as a multiple of the gate's half-width. Heuristic."""


@dataclass(frozen=True)
class LineCrossings:
    """Crossings of the arm's centre line in K poses with g lines across gates; entries are 0 if there is no crossing.

    Attributes:
        link: index of the link that crosses the line, shape (K, g).
        share: fraction of the link that lies before the crossing, shape (K, g).
        aside: signed distance of the crossing to the left of the middle of the line, shape (K, g) [m].
        crossed: whether the arm's centre line crosses the line near the line's middle, shape (K, g).
    """

    link: IntArray
    share: FloatArray
    aside: FloatArray
    crossed: BoolArray


@dataclass(frozen=True, eq=False)
class GateLines:
    """Lines across narrow gates, each with the point at which the arm's centre line has to cross it.

    Attributes:
        middles: points at which centre lines of arms have to cross the g lines, shape (g, 2) [m].
        along: direction of passage through the gate at each middle, a unit vector, shape (g, 2).
        inside: middle lines of the gates, used to find the links that are in a gate.
    """

    middles: FloatArray
    along: FloatArray
    inside: shapely.Geometry

    @classmethod
    def from_rails(cls, rails: tuple[FloatArray, ...], workspace: Workspace) -> "GateLines":
        """Return the lines across gates at their narrowest points, from the rails of the gates.

        Args:
            rails: middle lines of the gates with one straight piece before and one behind, each of shape (k ≥ 3, 2)
                [m].
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
        """Return crossings of the arm's centre line in K poses with the lines; for each line that nearest its middle.

        Args:
            points: joints and tips of the poses, shape (K, links + 1, 2) [m].
            farthest: distance from the middle of a line within which a crossing counts [m].
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
        """Return the derivatives of the distances of crossings from the middles of the lines, shape (K, g, p).

        They are with respect to the p coordinates of each of K poses [m per unit], and 0 where there is no crossing.

        Args:
            jacobians: derivatives of the joints and tips of the poses, shape (K, links + 1, 2, p) [m per unit].
            headings: headings of the links of the poses, shape (K, links) [rad].
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
        """Return coordinates of poses moved so that the arm's centre line crosses the lines across gates in the middle.

        Newton's method with the smallest turns of links is used.

        Args:
            space: map from coordinates to configurations, with metric and Jacobians.
            coordinates: coordinates of the poses, shape (K, p).

        Returns:
            Shape (K, p); poses for which the method fails, or needs large turns, are unchanged.
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
            # A line that is not crossed gets a unit diagonal and demands no change; the ridge covers two lines that are
            # crossed by one short link.
            size = np.einsum("kgg->kg", normal)
            normal += np.eye(len(self.middles)) * np.where(found.crossed, _RIDGE * size, 1.0)[..., None]
            by = np.linalg.solve(normal, -found.aside[..., None])[..., 0]
            moved += np.einsum("kg,kgp->kp", by, spread)
        turned = np.abs((moved - coordinates) @ space.turns.T).max(axis=1)
        kept = (off <= 10.0 * exact) & (turned <= _LARGEST_TURN)
        return np.where(kept[:, None], moved, coordinates)

    # ------------------------------------------------------------ links in gates
    def holds_links(self, points: FloatArray, radii: FloatArray) -> BoolArray:
        """Return a mask of the links of K poses that are inside gates, shape (K, links).

        Args:
            points: joints and tips of the poses, shape (K, links + 1, 2) [m].
            radii: distance from the middle line of a gate within which each link counts as inside, shape (links,) [m].
        """
        links = shapely.linestrings(np.stack((points[:, :-1], points[:, 1:]), axis=2))
        within = cast("float", radii)  # a ufunc, which takes arrays though its stub says otherwise
        return np.asarray(shapely.dwithin(links, self._prepared, within))

    @cached_property
    def _prepared(self) -> shapely.Geometry:
        shapely.prepare(self.inside)
        return self.inside


def _narrowest(middle: FloatArray, workspace: Workspace) -> list[FloatArray]:
    """Return both ends of the narrowest section of a gate, or only the centre of a short one, shape (2,) [m].

    Args:
        middle: middle line of the gate, shape (k, 2) [m].
        workspace: workspace with the walls.
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
    """Return the direction of passage through a gate, a unit vector of shape (2,), from its rail, shape (k, 2) [m]."""
    way = rail[-2] - rail[1]
    if np.hypot(*way) <= 1e-3 * np.hypot(*(rail[-1] - rail[0])):
        way = rail[-1] - rail[0]
    return np.asarray(way / np.hypot(*way))


@dataclass(frozen=True, eq=False)
class GateRails(Limit):
    """Limit that holds the arm's centre line in the middle of narrow gates and pulls joints sideways onto the middle.

    Attributes:
        rails: middle lines of the gates, extended straight before and behind, each of shape (k ≥ 2, 2) [m].
        lines: lines across the gates.
        play: distance from a rail within which a joint is not pulled, and largest accepted distance of a crossing from
            the middle of its line [m].
    """

    rails: tuple[FloatArray, ...]
    lines: GateLines
    play: float

    @cached_property
    def _legs(self) -> tuple[FloatArray, FloatArray]:
        """Start points of the m straight pieces of all rails, shape (m, 2) [m], and directions and lengths, (m, 3).

        The first two columns of the latter are unit vectors, the third the length of the piece [m].
        """
        first = np.vstack([rail[:-1] for rail in self.rails])
        along = np.vstack([np.diff(rail, axis=0) for rail in self.rails])
        length = np.linalg.norm(along, axis=1)
        kept = length > 0.0
        return first[kept], np.column_stack((along[kept] / length[kept, None], length[kept]))

    # ------------------------------------------------------------ the single step
    def linearised(self, space: LinkSpace, pose: Pose, turn: float) -> LimitRows:
        """Return QP constraints that make the arm cross gate lines in the middle, and a quadratic cost that does too.

        Args:
            space: map from coordinates to configurations.
            pose: pose from which the step starts.
            turn: unused.
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
        """Return the soft term of a QP step that pulls joints near rails sideways onto the rails; None without any."""
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
        """Return a pose moved so that the arm's centre line crosses the lines across gates in their middle.

        The pose is unchanged if that fails or would turn a link by more than ``most`` [rad].
        """
        moved = self.lines.restored(space, pose.v[None])[0]
        turned = np.max(np.abs(space.turns @ (moved - pose.v)))
        return space.pose(moved) if 0.0 < turned <= most else pose

    # ------------------------------------------------------------ at the goal
    def missed(self, space: LinkSpace, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return the changes with which a pose would cross gate lines in their middle, and their derivatives.

        Returns:
            Derivatives with respect to the coordinates, shape (k, p), and changes, shape (k,) [m], of the k lines that
            the axis crosses.
        """
        found = self.lines.crossings(pose.points[None], _ACROSS * space.nominal_length)
        crossed = found.crossed[0]
        return self._slopes(space, pose, found)[crossed], -found.aside[0][crossed]

    def _slopes(self, space: LinkSpace, pose: Pose, found: LineCrossings) -> FloatArray:
        """Return the derivatives of the distances of a pose's crossings from the line middles, (g, p) [m per unit]."""
        return np.asarray(self.lines.slopes(pose.moving[None], space.arm.headings(pose.q)[None], found)[0])

    def met(self, pose: Pose) -> bool:
        """Return whether all crossings of a pose with lines across gates are within ``play`` of the lines' middles."""
        found = self.lines.crossings(pose.points[None], np.inf)
        return bool(np.all(np.abs(found.aside) <= self.play))

    # ------------------------------------------------------------ the optimisation of a motion
    def keyframe_equations(self, sweep: "PlanarSweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the equations with which inner keyframes of a motion cross gate lines in their middle, linearised.

        The first and the last keyframe get none, since they are fixed.
        """
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
        """Return keyframes, shape (K + 1, p), the inner ones moved so that they cross gate lines in their middle."""
        del u
        return np.vstack((coordinates[:1], self.lines.restored(space, coordinates[1:-1]), coordinates[-1:]))
