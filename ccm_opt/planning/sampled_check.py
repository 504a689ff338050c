"""Checks of sampled poses in the plane against a raster of blocked cells and against self-contact.

A pose that passes is not proved to be free of contact; that is left to the certificate.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.native import NativeCall
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.workspace import Workspace

_STRIDE = 8
"""Stride of the first pass over the poses of a motion. Heuristic: most motions with contact have it over many poses."""
POSE_SPACING = 0.75
"""Distance that the tip moves between two checked poses, as a multiple of the distance that the arm's centre line has
to keep from walls. Heuristic: the certificate finds contacts between them."""
LEAST_SPACING = 0.005
"""Least spacing of poses and of points on links, as a fraction of the arm's length. Heuristic: for thin arms."""

_CELLS = 2000
"""Number of cells of the raster along each side of the square within reach. Heuristic: 4 million cells are filled in
some hundredths of a second, and a cell is a thousandth of the reach."""

_POINT_SPACING = 0.7
"""Spacing of the checked points on the links, as a multiple of the distance that the arm's centre line has to keep from
walls. Derived: if all these points keep that distance, no wall corner is closer to the line than 94 % of it."""

_TO_CORNER = float(np.sqrt(0.5))
"""Distance from the centre of a unit square to its corners."""


@dataclass(frozen=True)
class BlockedRaster:
    """Raster of a square; a cell is blocked if all of it is closer to a wall than the arm's centre line may be.

    A pose with a point in a blocked cell certainly has contact; a free cell proves nothing.

    Attributes:
        corner: lower left corner of the square, shape (2,) [m].
        cell: side of a cell [m].
        blocked: mask of blocked cells by row (y) and column (x), with a frame of one blocked cell that represents the
            outside, shape (cells + 2, cells + 2).
    """

    corner: FloatArray
    cell: float
    blocked: BoolArray

    @classmethod
    def around(cls, workspace: Workspace, middle: FloatArray, half: float, gap: float, cells: int) -> "BlockedRaster":
        """Return the raster of a square.

        Args:
            workspace: workspace with the walls.
            middle: centre of the square, shape (2,) [m].
            half: half of the square's side [m].
            gap: distance that the arm's centre line has to keep from walls [m].
            cells: number of cells along a side.
        """
        cell = 2.0 * half / cells
        corner = middle - half
        # A cell is blocked if its centre is too close to a wall by more than half the cell's diagonal.
        sure = gap - _TO_CORNER * cell
        square = shapely.box(*corner, *(corner + 2.0 * half))
        near = [wall for wall in workspace.obstacles if shapely.dwithin(wall.core, square, wall.rounding + gap)]
        # Round corners are approximated from inside, so that no polygon is too large.
        bodies = [wall.buffered(wall.rounding + sure) for wall in near]
        room = shapely.buffer(workspace.boundary, -sure)

        covered = _covered(bodies, corner, cell, cells)
        outside = ~_covered([room], corner, cell, cells)
        blocked = np.ones((cells + 2, cells + 2), dtype=bool)
        blocked[1:-1, 1:-1] = covered | outside
        return cls(corner, cell, blocked)

    def at(self, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> BoolArray:
        """Return a mask of the points that lie in blocked cells, given their coordinates x and y of equal shape [m]."""
        side = self.blocked.shape[0]
        scale = 1.0 / self.cell
        column = (x * scale + (1.0 - self.corner[0] * scale)).astype(np.int32)
        row = (y * scale + (1.0 - self.corner[1] * scale)).astype(np.int32)
        found: BoolArray = self.blocked.ravel().take(row * side + column, mode="clip")
        return found


def _covered(shapes: list[shapely.Geometry], corner: FloatArray, cell: float, cells: int) -> BoolArray:
    """Return a mask of the cells with their centre inside a polygon, shape (cells, cells).

    Each edge that crosses a row of centres adds its sign to the cells of the row beyond the crossing; a nonzero sum
    means inside, and is larger than 1 where polygons overlap.

    Args:
        shapes: polygons; other geometries are ignored.
        corner: lower left corner of the raster, shape (2,) [m].
        cell: side of a cell [m].
        cells: number of cells along a side.
    """
    change = np.zeros((cells, cells + 1), dtype=np.int32)
    start, end = _edges(shapes)
    # In units of cells, with the centres of cells at integers.
    start = (start - corner) / cell - 0.5
    end = (end - corner) / cell - 0.5

    # Half-open in y, so that a row through a vertex meets just one of its two edges.
    first = np.clip(np.ceil(np.minimum(start[:, 1], end[:, 1])), 0, cells).astype(np.intp)
    beyond = np.clip(np.ceil(np.maximum(start[:, 1], end[:, 1])), 0, cells).astype(np.intp)
    count = beyond - first
    edge = np.repeat(np.arange(len(start)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + first[edge]

    along = (row - start[edge, 1]) / (end[edge, 1] - start[edge, 1])
    crossing = start[edge, 0] + along * (end[edge, 0] - start[edge, 0])
    column = np.clip(np.ceil(crossing), 0, cells).astype(np.intp)
    # Outer rings run counter-clockwise: from left to right a polygon is entered where its edge runs down.
    sign = np.where(end[edge, 1] < start[edge, 1], 1, -1)
    np.add.at(change, (row, column), sign)
    return np.asarray(np.cumsum(change[:, :-1], axis=1, dtype=np.int32) > 0)


def _edges(shapes: list[shapely.Geometry]) -> tuple[FloatArray, FloatArray]:
    """Return the first and last points of all edges of the polygons among geometries, each of shape (e, 2) [m].

    Outer rings run counter-clockwise, holes clockwise.
    """
    parts = shapely.get_parts(np.array(shapes, dtype=object))
    # Geometries without area cover no cell.
    polygons = [part for part in parts if isinstance(part, shapely.Polygon) and not part.is_empty]
    rings = shapely.get_rings(shapely.orient_polygons(np.array(polygons, dtype=object)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    return points[:-1][same], points[1:][same]


_BEYOND_REACH = 1.001
"""Half of the raster's side in arm lengths, above 1 so that rounding errors put no point outside the raster."""


@dataclass(frozen=True)
class SampledCheck:
    """Fast check of poses of one arm on a fixed base in one workspace, at points on the links and against self-contact.

    Attributes:
        arm: the arm.
        raster: raster of cells in which the arm's centre line is too close to a wall.
        reach: length of each link between the base and each checked point, shape (links, points) [m].
        spacing: distance that the tip moves between two checked poses [m].
        parts: number of intervals into which the checked points divide a link.
    """

    arm: Arm
    raster: BlockedRaster
    reach: npt.NDArray[np.float32]
    spacing: float
    parts: int

    @classmethod
    def for_workspace(cls, arm: Arm, workspace: Workspace) -> "SampledCheck":
        """Return the sampled collision check for an arm in a workspace, with its raster of blocked cells."""
        # A point in a blocked cell implies contact even for the thinnest link.
        gap = arm.thinnest + workspace.clearance
        raster = BlockedRaster.around(workspace, arm.base, _BEYOND_REACH * arm.length, gap, _CELLS)
        least = LEAST_SPACING * arm.length
        parts = int(np.ceil(float(np.max(arm.lengths)) / max(_POINT_SPACING * gap, least)))
        places = _places(arm, parts)
        # A place at arc length s takes the whole of every link before it and part of its own.
        link = np.clip(np.searchsorted(_chain_places(arm), places, side="left") - 1, 0, arm.links - 1)
        places = places[arm.radii[link] >= 0.0]
        before = _chain_places(arm)[:-1, None]
        reach = np.clip(places - before, 0.0, arm.lengths[:, None]).astype(np.float32)
        spacing = max(POSE_SPACING * gap, least)
        return cls(arm, raster, reach, spacing, parts)

    def refuted(self, headings: FloatArray) -> BoolArray:
        """Return a mask (m,) of the poses, given by link headings (m, links) [rad], that certainly have contact.

        Poses outside the mask are not proved to be free.
        """
        cosines = np.cos(headings).astype(np.float32)
        sines = np.sin(headings).astype(np.float32)
        x = cosines @ self.reach + np.float32(self.arm.base[0])
        y = sines @ self.reach + np.float32(self.arm.base[1])
        refuted = np.asarray(self.raster.at(x, y).any(axis=1))
        if self.arm.self_collision:
            left = np.flatnonzero(~refuted)
            refuted[left] = self._on_itself(headings[left])
        return refuted

    def free_shares(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return for each of m motions, linear in headings, the fraction before its first pose with certain contact.

        Args:
            start: link headings, shape (m, links) [rad]; these poses are not checked again.
            end: link headings at the other end, of the same shape [rad].

        Returns:
            Fraction of each motion at the last checked pose before the refuted one, shape (m,); 1 if no pose is
            refuted.

        Raises:
            ValueError: the headings have the wrong shape.
        """
        if start.shape[1:] != (self.arm.links,) or end.shape != start.shape:
            raise ValueError(f"motions have the shapes {start.shape} and {end.shape}; expected (m, {self.arm.links})")
        shares = np.empty(len(start))
        NativeCall("free_shares", **self.for_c, motions=len(start), start=start, end=end, share=shares)()
        return shares

    @cached_property
    def for_c(self) -> Mapping[str, Any]:
        """Data of this check as the fields of the C structure ``Shares`` in free_shares.c."""
        arm, raster = self.arm, self.raster
        link, at = arm.mount_end
        return {
            "links": arm.links, "mount_link": link, "mount_at": at, "parts": self.parts, "stride": _STRIDE,
            "next_pair": arm.next_self_pairs, "lengths": arm.lengths,
            "mean_length": arm.link_length, "longest": float(np.max(arm.lengths)),
            "radii": arm.radii, "thickest": arm.radius, "base_x": arm.base[0], "base_y": arm.base[1],
            "side": raster.blocked.shape[0], "cell": raster.cell,
            "corner_x": raster.corner[0], "corner_y": raster.corner[1],
            "blocked": np.ascontiguousarray(raster.blocked, dtype=np.bool_), "spacing": self.spacing,
            "work": np.empty(8 * arm.links + 2),
        }  # fmt: skip

    def connection(self, limits: FloatArray, growth: Mapping[str, Any]) -> NativeCall:
        """Return the call of the C function that grows two trees of link headings (RRT-Connect).

        Args:
            limits: upper bounds on the absolute values of the bends, shape (links,) [rad].
            growth: fields of ``Growth`` in rrt_connect.h.
        """
        return NativeCall(
            "connect_in_plane",
            growth=growth,
            shares=self.for_c,
            heading=self.arm.base_heading,
            turns=self.arm.turns,
            limit=limits,
        )

    def _on_itself(self, headings: FloatArray) -> BoolArray:
        """Return a mask of the poses, given by link headings (m, links) [rad], with self-contact, shape (m,)."""
        arm = self.arm
        points = arm.joint_positions(headings)
        first, second = arm.self_pairs
        middles = 0.5 * (points[:, :-1] + points[:, 1:])
        apart = middles[:, first] - middles[:, second]
        close = float(np.max(arm.lengths)) + 2.0 * arm.radius
        pose, pair = np.nonzero(np.einsum("mpd,mpd->mp", apart, apart) < close**2)

        i = first[pair]
        j = second[pair]
        ends = (points[pose, i], points[pose, i + 1], points[pose, j], points[pose, j + 1])
        meeting = segment_distances(*ends)[2] <= arm.radii[i] + arm.radii[j]
        refuted = np.zeros(len(headings), dtype=bool)
        refuted[pose[meeting]] = True
        return refuted


def _chain_places(arm: Arm) -> FloatArray:
    """Return the lengths of chain up to the joints and the tip, shape (links + 1,) [m]."""
    return arm.link_length * np.concatenate(([0.0], np.cumsum(arm.length_shares)))


def _places(arm: Arm, parts: int) -> FloatArray:
    """Return the arc lengths of the checked points from the mount's end on, ``parts`` per link, shape (points,) [m]."""
    chain = _chain_places(arm) / arm.link_length
    steps = np.interp(np.arange(arm.links * parts + 1), parts * np.arange(arm.links + 1), parts * chain)
    along = arm.link_length / parts * steps
    link, share = arm.mount_end
    mount = (chain[link] + share * arm.length_shares[link]) * arm.link_length
    return np.append(mount, along[along > mount])
