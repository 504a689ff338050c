"""Checks of sampled poses against a raster of blocked places and against the arm itself.

A pose that passes is not proved to be free; that is left to the certificate.
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
from ccm_opt.scene.workspace import Obstacle, Workspace

_STRIDE = 8
"""Stride of the first pass over poses. Taste: most motions that touch do so over a long stretch."""
POSE_SPACING = 0.75
"""Distance that the tip moves between two checked poses, in distances that the axis has to keep. Taste: the
certificate finds contacts between them."""
LEAST_SPACING = 0.005
"""Least value of both spacings, as a share of the arm's length. Taste: for thin arms."""

_CELLS = 2000
"""Cells of the raster along a side of the square that the arm reaches. Taste: 4 million cells fill in some
hundredths of a second, and a cell is a thousandth of the reach."""

_POINT_SPACING = 0.7
"""Distance of the checked places on the links, in distances that the axis has to keep. Derived: between places so
near a corner can come no nearer than 94 % of that distance."""

_TO_CORNER = float(np.sqrt(0.5))
"""Distance from the middle of a square of side 1 to its corner."""


@dataclass(frozen=True)
class BlockedRaster:
    """Raster of a square; a cell is blocked where all of it is nearer to a wall than the arm's axis may be.

    A free cell proves nothing; a blocked one refutes a pose.

    Attributes:
        corner: lower left corner of the square, shape (2,) [m].
        cell: side of a cell [m].
        blocked: by row (y) and column (x); a frame of one cell all round represents the outside, all blocked.
    """

    corner: FloatArray
    cell: float
    blocked: BoolArray

    @classmethod
    def around(cls, workspace: Workspace, middle: FloatArray, half: float, gap: float, cells: int) -> "BlockedRaster":
        """Return the raster of a square.

        Args:
            workspace: workspace with the walls.
            middle: middle of the square, shape (2,) [m].
            half: half of its side [m].
            gap: distance that an axis has to keep from walls [m].
            cells: number of cells along a side.
        """
        cell = 2.0 * half / cells
        corner = middle - half
        # Where the middle of a cell is blocked by more than its half diagonal, the whole cell is blocked.
        sure = gap - _TO_CORNER * cell
        square = shapely.box(*corner, *(corner + 2.0 * half))
        near = [wall for wall in workspace.obstacles if shapely.dwithin(wall.core, square, wall.rounding + gap)]
        bodies = [_grown(wall, sure) for wall in near]
        room = shapely.buffer(workspace.boundary, -sure)

        covered = _covered(bodies, corner, cell, cells)
        outside = ~_covered([room], corner, cell, cells)
        blocked = np.ones((cells + 2, cells + 2), dtype=bool)
        blocked[1:-1, 1:-1] = covered | outside
        return cls(corner, cell, blocked)

    def at(self, x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> BoolArray:
        """Return whether places of the square are blocked, given their coordinates x and y, of equal shape [m]."""
        side = self.blocked.shape[0]
        scale = 1.0 / self.cell
        column = (x * scale + (1.0 - self.corner[0] * scale)).astype(np.int32)
        row = (y * scale + (1.0 - self.corner[1] * scale)).astype(np.int32)
        found: BoolArray = self.blocked.ravel().take(row * side + column, mode="clip")
        return found


def _grown(wall: Obstacle, by: float) -> shapely.Geometry:
    """Return a wall grown by a distance; GEOS inscribes arcs, so that all of the grown area is certainly too near."""
    grown: shapely.Geometry = shapely.buffer(wall.core, wall.rounding + by)
    return grown


def _covered(shapes: list[shapely.Geometry], corner: FloatArray, cell: float, cells: int) -> BoolArray:
    """Return which cells have their middle inside one of the polygons, shape (cells, cells).

    Each edge that crosses a row of middles adds its sign to the row from the crossing on; where polygons overlap, the
    sum is larger than one.
    """
    change = np.zeros((cells, cells + 1), dtype=np.int32)
    start, end = _edges(shapes)
    # In units of cells, with the middles of rows and columns at whole numbers.
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
    """Return the ends of all edges of the polygons among shapes, outer rings counter-clockwise and holes clockwise."""
    parts = shapely.get_parts(np.array(shapes, dtype=object))
    # Shapes without area cover no cell for certain.
    polygons = [part for part in parts if isinstance(part, shapely.Polygon) and not part.is_empty]
    rings = shapely.get_rings(shapely.orient_polygons(np.array(polygons, dtype=object)))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[1:] == ring[:-1]
    return points[:-1][same], points[1:][same]


_BEYOND_REACH = 1.001
"""Half of the raster's side in arm lengths, so that rounding takes no place out of the raster."""


@dataclass(frozen=True)
class SampledCheck:
    """Checks poses of one arm in one workspace.

    Attributes:
        arm: the arm.
        raster: raster of places where the arm's axis is too near to a wall.
        reach: length along each link that leads to each checked place, shape (links, places) [m].
        spacing: distance that the tip moves between two checked poses [m].
        parts: number of parts into which checked places divide a link.
    """

    arm: Arm
    raster: BlockedRaster
    reach: npt.NDArray[np.float32]
    spacing: float
    parts: int

    @classmethod
    def of(cls, arm: Arm, workspace: Workspace) -> "SampledCheck":
        """Return the check of an arm in a workspace."""
        # What the raster refutes touches with the thinnest link.
        gap = float(np.min(arm.radii)) + workspace.clearance
        raster = BlockedRaster.around(workspace, arm.base, _BEYOND_REACH * arm.length, gap, _CELLS)
        least = LEAST_SPACING * arm.length
        parts = int(np.ceil(float(np.max(arm.lengths)) / max(_POINT_SPACING * gap, least)))
        places = _places(arm, parts)
        # A place at arc length s takes the whole of every link before it and part of its own.
        before = arm.joint_places[:-1, None]
        reach = np.clip(places - before, 0.0, arm.lengths[:, None]).astype(np.float32)
        spacing = max(POSE_SPACING * gap, least)
        return cls(arm, raster, reach, spacing, parts)

    def refuted(self, headings: FloatArray) -> BoolArray:
        """Return which poses, given by link headings (m, links) [rad], certainly touch something, shape (m,)."""
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
        """Return the free fractions of straight motions, up to their first refuted pose.

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
        """The check as the fields of ``Shares`` in free_shares.c."""
        arm, raster = self.arm, self.raster
        link, at = arm.mount_end
        return {
            "links": arm.links, "mount_link": link, "mount_at": at, "parts": self.parts, "stride": _STRIDE,
            "first_self_pair": arm.first_self_pairs, "lengths": arm.lengths,
            "mean_length": arm.link_length, "longest": float(np.max(arm.lengths)),
            "radii": arm.radii, "thickest": arm.radius, "base_x": arm.base[0], "base_y": arm.base[1],
            "side": raster.blocked.shape[0], "cell": raster.cell,
            "corner_x": raster.corner[0], "corner_y": raster.corner[1],
            "blocked": np.ascontiguousarray(raster.blocked, dtype=np.bool_), "spacing": self.spacing,
            "work": np.empty(8 * arm.links + 2),
        }  # fmt: skip

    def connection(self, limits: FloatArray, growth: Mapping[str, Any]) -> NativeCall:
        """Return the call that grows trees of link headings.

        Args:
            limits: bounds of the bends, shape (links,) [rad].
            growth: fields of ``Growth`` in rrt_connect.h.
        """
        return NativeCall(
            "connect_in_plane", growth=growth, shares=self.for_c, heading=self.arm.base_heading, limit=limits
        )

    def _on_itself(self, headings: FloatArray) -> BoolArray:
        """Return which poses have distant links that meet, shape (m, links) to (m,)."""
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


def _places(arm: Arm, parts: int) -> FloatArray:
    """Return the arc lengths of the checked places beyond the mount, ``parts`` to a link, shape (places,) [m]."""
    steps = np.interp(np.arange(arm.links * parts + 1), parts * np.arange(arm.links + 1), parts * arm.place_shares)
    along = arm.link_length / parts * steps
    link, share = arm.mount_end
    mount = (arm.place_shares[link] + share * arm.length_shares[link]) * arm.link_length
    return np.append(mount, along[along > mount])
