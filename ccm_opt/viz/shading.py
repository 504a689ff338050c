"""Shaded pictures of scenes in space: lit, outlined, without hidden parts, and with glass where walls hide the arm.

What hides the arm is glass: flat faces as a whole, curved ones in front of a surface through the arm (as in Burns and
Finkelstein, "Adaptive cutaways for comprehensible rendering of polygonal scenes", 2008). Hollows are darkened, where a
smoothed depth image lies in front of the depth image (Luft, Colditz, and Deussen, "Image enhancement by unsharp masking
the depth buffer", 2006).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.colors import to_rgb
from scipy import ndimage, sparse

from ccm_opt.core.arrays import BoolArray, FloatArray, IntArray
from ccm_opt.scene.bodies import capsule_surface
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import Side
from ccm_opt.viz.raster import FlatTriangles, Glass, Layer, Shades

_TUBE_SIDES = 12
"""Number of sides with which the links of an arm are drawn. Heuristic."""
_LIGHT = np.array([-0.35, 0.5, 0.79]) / np.linalg.norm([-0.35, 0.5, 0.79])
"""Direction to the light: across the picture, up in it, towards the viewer. Heuristic."""
_AMBIENT = 0.58
"""Brightness of a surface that faces away from the light. Heuristic."""
_CREASE = float(np.cos(0.7))
"""Cosine of the angle between neighbouring faces below which their common edge is a crease. Heuristic."""
_FLAT = 1e-4
"""Maximum 1 - cos of the angles between normals of a flat face. Heuristic."""
_GLASS = 0.08
"""Opacity of glass seen frontally. Heuristic."""
_GRAZING = 0.4
"""Further opacity of glass seen at a grazing angle. Heuristic."""
_HIDDEN = 0.003
"""Fraction of the arm's pixels that a face has to hide to become glass. Heuristic."""
_COARSE = 6
"""Width in pixels of the coarse pixels in which depth is smoothed. Heuristic."""
_CUT = 0.1
"""Width of the smoothing of the cutting surface, as a fraction of the picture's longer side. Heuristic."""
_HOLLOW = 0.03
"""Width of the smoothing of depth in which hollows are found, as a fraction of the picture's longer side. Heuristic."""
_DEEP = 0.15
"""Depth at which a hollow is darkest, as a fraction of the picture's longer side. Heuristic."""
_DARKEST = 0.4
"""Fraction of light that the darkest hollow loses. Heuristic."""
_OUTLINE = 0.45
"""Fraction of light that an outline loses. Heuristic."""
_STEP = 0.02
"""Difference in depth between neighbouring pixels that makes an outline, as a fraction of the picture's longer side.
Heuristic."""


@dataclass(frozen=True, eq=False)
class Tube:
    """A chain of capsules of one colour: an arm in one pose, or a path.

    Attributes:
        points: ends of the k capsules, shape (k + 1, 3) [m].
        radii: radius of all capsules, or of each, shape (k,) [m]; capsules without a radius are not drawn.
        colour: colour, as matplotlib understands it.
    """

    points: FloatArray
    radii: FloatArray | float
    colour: str | tuple[float, float, float]

    @cached_property
    def surface(self) -> "Faces":
        """Surfaces of the capsules, each a face."""
        axes = np.diff(self.points, axis=0)
        lengths = np.linalg.norm(axes, axis=1)
        radii = np.broadcast_to(np.asarray(self.radii, dtype=np.float64), lengths.shape)
        drawn = np.flatnonzero(radii > 0.0)
        # The capsule of radius 1 about a point, whose second half is moved to the other end of the link.
        normals, triangles = capsule_surface(0.0, 1.0, _TUBE_SIDES)
        farther = np.arange(len(normals)) >= len(normals) // 2
        turned = normals @ _frames_along(axes[drawn])
        ends = np.where(farther[:, None], self.points[drawn + 1][:, None], self.points[drawn][:, None])
        vertices = ends + radii[drawn, None, None] * turned
        return Faces(
            vertices[:, triangles].reshape(-1, 3, 3),
            turned[:, triangles].reshape(-1, 3, 3),
            np.repeat(drawn, len(triangles)),
            np.zeros(len(lengths), dtype=np.bool_),
        )


def _frames_along(axes: FloatArray) -> FloatArray:
    """Return frames whose x axes have given directions, shape (k, 3): their axes in rows, shape (k, 3, 3)."""
    length = np.linalg.norm(axes, axis=1, keepdims=True)
    along = np.where(length > 0.0, axes / np.where(length > 0.0, length, 1.0), (1.0, 0.0, 0.0))
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack((along, across, np.cross(along, across)), axis=1)


@dataclass(frozen=True, eq=False)
class Faces:
    """Triangles of all obstacles, grouped into faces: pieces of surface without creases.

    Attributes:
        triangles: corners, shape (m, 3, 3) [m].
        normals: normals at the corners, shape (m, 3, 3).
        face: number of each triangle's face, shape (m,).
        flat: whether each of the f faces is flat, shape (f,).
    """

    triangles: FloatArray
    normals: FloatArray
    face: IntArray
    flat: BoolArray

    @classmethod
    def of_bodies(cls, bodies: Sequence[tuple[FloatArray, IntArray]]) -> "Faces":
        """Return the faces of bodies, each given as vertices, shape (v, 3) [m], and triangles, shape (m, 3)."""
        parts = [_faces(vertices, triangles) for vertices, triangles in bodies if len(triangles)]
        first = np.cumsum([0, *(len(part.flat) for part in parts)])
        return cls(
            np.concatenate([np.zeros((0, 3, 3)), *(part.triangles for part in parts)]),
            np.concatenate([np.zeros((0, 3, 3)), *(part.normals for part in parts)]),
            np.concatenate(
                [np.zeros(0, np.intp), *(part.face + start for part, start in zip(parts, first, strict=False))]
            ),
            np.concatenate([np.zeros(0, np.bool_), *(part.flat for part in parts)]),
        )


def _faces(vertices: FloatArray, triangles: IntArray) -> Faces:
    """Return the faces of one body, given its vertices, shape (v, 3) [m], and triangles, shape (m, 3)."""
    # Vertices of neighbouring triangles may be listed several times.
    step = 1e-6 * max(float(np.ptp(vertices, axis=0).max()), 1e-12)
    _, joined = np.unique(np.round(vertices / step), axis=0, return_inverse=True)
    corner = joined.reshape(-1)[triangles]
    points = vertices[triangles]
    normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    # Triangles on both sides of an edge follow each other once edges are sorted.
    edges = np.sort(np.stack((corner, np.roll(corner, -1, axis=1)), axis=-1), axis=-1).reshape(-1, 2)
    order = np.lexsort(edges.T)
    owner, sorted_edges = np.repeat(np.arange(len(triangles)), 3)[order], edges[order]
    shared = np.all(sorted_edges[1:] == sorted_edges[:-1], axis=1)
    one, other = owner[:-1][shared], owner[1:][shared]
    smooth = np.abs(np.sum(normal[one] * normal[other], axis=1)) > _CREASE
    graph = sparse.coo_array((np.ones(smooth.sum()), (one[smooth], other[smooth])), shape=(len(triangles),) * 2)
    count, face = sparse.csgraph.connected_components(graph, directed=False)
    # The sign of a normal is that of its neighbours in the same face: some files turn triangles at random.
    key = np.zeros((count, 3))
    key[face] = normal
    agreeing = normal * np.where(np.sum(normal * key[face], axis=1) < 0.0, -1.0, 1.0)[:, None]
    spread = 1.0 - np.abs(np.sum(normal * key[face], axis=1))
    flat = np.bincount(face, spread > _FLAT, count) == 0
    # Normals are averaged at a vertex over the triangles of one face.
    place, where = np.unique(face[:, None] * (corner.max() + 1) + corner, return_inverse=True)
    where = where.reshape(corner.shape)
    summed = np.stack([np.bincount(where.ravel(), np.repeat(part, 3), len(place)) for part in agreeing.T], axis=1)
    mean = summed[where]
    length = np.linalg.norm(mean, axis=-1, keepdims=True)
    agrees = np.sum(mean * agreeing[:, None], axis=-1, keepdims=True) > 0.5 * length
    return Faces(points, np.where(agrees, mean, agreeing[:, None]), face.astype(np.int64), flat)


def picture_size(window: FloatArray, pixels: int) -> tuple[int, int]:
    """Return width and height of the picture of a window, shape (2, 2) [m], whose longer side has so many pixels."""
    spans = np.ptp(window, axis=0)
    wide, high = np.maximum(np.round(pixels / float(np.max(spans)) * spans), 1.0)
    return int(wide), int(high)


@dataclass(frozen=True, eq=False)
class ShadedView:
    """A scene seen from one side, with glass where it hides given arms; arms in any pose can be drawn into it.

    Attributes:
        faces: faces of the obstacles.
        side: projection to the picture plane.
        window: lower left and upper right corner of the picture, shape (2, 2) [m].
        pixels: number of pixels of the picture's longer side.
        shown: arms and paths that the scene must not hide.
        still: those of them that are part of every picture.
        oversampling: rasterised pixels per pixel of the picture in each direction, against jagged edges.
    """

    faces: Faces
    side: Side
    window: FloatArray
    pixels: int
    shown: Sequence[Tube]
    still: Sequence[Tube] = ()
    oversampling: int = 2

    @property
    def reach(self) -> float:
        """Longer side of the picture [m]."""
        return float(np.max(np.ptp(self.window, axis=0)))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the rasterised picture [pixel]."""
        wide, high = picture_size(self.window, self.pixels)
        return self.oversampling * high, self.oversampling * wide

    @property
    def _whole(self) -> tuple[slice, slice]:
        """All rows and columns of the rasterised picture."""
        return slice(0, self.shape[0]), slice(0, self.shape[1])

    @cached_property
    def _shown_links(self) -> Layer:
        """Nearest links of what must not be hidden."""
        return self._nearest_links(self.shown, self._whole, self._nothing)

    @cached_property
    def _nothing(self) -> Shades:
        """The depth of nothing, shape (h, w)."""
        return np.full(self.shape, -np.inf, dtype=np.float32)

    @cached_property
    def _walls(self) -> FlatTriangles:
        """The obstacles in the picture."""
        faces = self.faces
        return self._projected(faces.triangles, faces.normals, faces.face, len(faces.flat), self._whole)

    @cached_property
    def _glass(self) -> Glass:
        """Which faces of the obstacles are glass."""
        arm, walls = self._shown_links, self._walls
        corners = self.faces.triangles
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing = np.abs(normal @ self.side.ahead) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
        opacity = np.log1p(-_GLASS - _GRAZING * (1.0 - facing) ** 3)
        covered = arm.owner >= 0
        if not covered.any():
            return Glass(np.zeros(walls.owners, dtype=np.uint8), self._nothing, opacity)
        cut = _cutting_surface(arm.depth)
        hiding = walls.nearest(np.where(covered, cut, np.float32(np.inf))).fragments
        glassy = hiding > _HIDDEN * np.count_nonzero(covered)
        kinds = np.where(glassy, np.where(self.faces.flat, 2, 1), 0)
        return Glass(kinds.astype(np.uint8), cut, opacity)

    @cached_property
    def _solid(self) -> tuple[Shades, Shades]:
        """Depth of the nearest solid surface or still arm, shape (h, w) [m], and its picture, shape (h, w, 3)."""
        layer = self._walls.nearest(self._nothing, self._glass)
        light = layer.light * (1.0 - _DARKEST * _hollows(layer.depth, _DEEP * self.reach))
        light[layer.outlines(_STEP * self.reach)] *= 1.0 - _OUTLINE
        colour = light[..., None] * np.array(to_rgb(style.WALL), dtype=np.float32)
        colour[layer.owner < 0] = 1.0
        links = self._nearest_links(self.still, self._whole, layer.depth)
        colour[links.owner >= 0] = self._link_colours(self.still, links)
        return np.maximum(layer.depth, links.depth), colour

    @cached_property
    def _through_glass(self) -> tuple[Shades, Shades]:
        """Transparency of the glass in front of each pixel, shape (h, w, 1), and light added to it, shape (h, w, 3)."""
        layer = self._walls.nearest(self._solid[0], self._glass, of_glass=True)
        through: Shades = np.exp(layer.passed.astype(np.float32))
        through[layer.outlines(np.inf)] *= _OUTLINE
        tint: Shades = (layer.light * (np.float32(1.0) - through))[..., None] * np.array(
            to_rgb(style.WALL_EDGE), np.float32
        )
        return through[..., None], tint

    @cached_property
    def _behind_glass(self) -> Shades:
        """Picture of the scene without arms, shape (h, w, 3)."""
        through, tint = self._through_glass
        return self._solid[1] * through + tint

    def picture(self, tubes: Sequence[Tube]) -> Shades:
        """Return the picture of the scene with arms and paths, shape (height, width, 3), y up, values from 0 to 1."""
        return self._drawn(tubes, self._whole)

    def part(self, tubes: Sequence[Tube]) -> tuple[slice, slice, Shades]:
        """Return the part of the picture that arms change.

        Args:
            tubes: the arms.

        Returns:
            Rows and columns of the part, and its picture, shape (rows, columns, 3), y up, values from 0 to 1.
        """
        k = self.oversampling
        places = (self.side(tube.points) for tube in tubes)
        widest = max(float(np.max(tube.radii)) for tube in tubes)
        ends = np.concatenate(list(places)) - self.window[0]
        scale = self.pixels / self.reach
        low, high = (
            (scale * (ends.min(axis=0) - widest) - 1.0).astype(int),
            (scale * (ends.max(axis=0) + widest) + 1.0).astype(int),
        )
        rows, columns = (
            slice(*np.clip((low[axis], high[axis] + 1), 0, self.shape[1 - axis] // k).tolist()) for axis in (1, 0)
        )
        fine = (slice(k * rows.start, k * rows.stop), slice(k * columns.start, k * columns.stop))
        return rows, columns, self._drawn(tubes, fine)

    def _drawn(self, tubes: Sequence[Tube], part: tuple[slice, slice]) -> Shades:
        """Return part of the picture, given by its rasterised rows and columns, with arms and paths."""
        picture = self._behind_glass[part].copy()
        arm = self._nearest_links(tubes, part, self._solid[0][part])
        front = arm.owner >= 0
        through, tint = (layer[part][front] for layer in self._through_glass)
        picture[front] = self._link_colours(tubes, arm) * through + tint
        k = self.oversampling
        return np.asarray(sum(picture[row::k, column::k] for row in range(k) for column in range(k)) / k**2)

    def _link_colours(self, tubes: Sequence[Tube], arm: Layer) -> Shades:
        """Return the colours of arms and paths where these are the nearest, shape (pixels, 3)."""
        colours = [to_rgb(tube.colour) for tube in tubes for _ in tube.points[1:]]
        front = arm.owner >= 0
        light = arm.light[front]
        light[arm.outlines(_STEP * self.reach)[front]] *= 1.0 - _OUTLINE
        return np.array(colours, dtype=np.float32).reshape(-1, 3)[arm.owner[front]] * light[:, None]

    def _nearest_links(self, tubes: Sequence[Tube], part: tuple[slice, slice], floor: Shades) -> Layer:
        """Return the nearest links of arms and paths in part of the picture; they are numbered one after another.

        Args:
            tubes: the arms and paths.
            part: rows and columns of the rasterised picture that are wanted.
            floor: depth up to which nothing is seen, shape (rows, columns) [m].
        """
        surfaces = [tube.surface for tube in tubes]
        first = np.cumsum([0, *(len(surface.flat) for surface in surfaces)])
        # Every link has a number of its own, so that its ends are outlined.
        link = [surface.face + start for surface, start in zip(surfaces, first, strict=False)]
        none = np.zeros((0, 3, 3))
        triangles = np.concatenate([none, *(surface.triangles for surface in surfaces)])
        normals = np.concatenate([none, *(surface.normals for surface in surfaces)])
        seen = np.any(normals @ self.side.ahead > 0.0, axis=1)
        number = np.concatenate([np.zeros(0, dtype=np.intp), *link])
        links = self._projected(triangles[seen], normals[seen], number[seen], int(first[-1]), part)
        return links.nearest(floor)

    def _projected(
        self, triangles: FloatArray, normals: FloatArray, owner: IntArray, owners: int, part: tuple[slice, slice]
    ) -> FlatTriangles:
        """Return triangles in the picture.

        Args:
            triangles: corners, shape (m, 3, 3) [m].
            normals: normals at the corners, shape (m, 3, 3).
            owner: number of each triangle's face or link, shape (m,).
            owners: number of all faces or links.
            part: rows and columns of the rasterised picture that are wanted.
        """
        frame = np.stack((self.side.across, self.side.up, self.side.ahead))
        corners = triangles @ frame.T
        # Both sides of a wall are lit.
        turned = normals @ frame.T
        turned *= np.where(turned[..., 2].sum(axis=1) < 0.0, -1.0, 1.0)[:, None, None]
        turned /= np.maximum(np.linalg.norm(turned, axis=-1, keepdims=True), 1e-300)
        light = _AMBIENT + (1.0 - _AMBIENT) * np.maximum(turned @ _LIGHT, 0.0)
        scale = self.oversampling * self.pixels / self.reach
        rows, columns = part
        flat = scale * (corners[..., :2] - self.window[0]) - (columns.start, rows.start)
        return FlatTriangles(flat, corners[..., 2], light, owner, owners)


def _smoothed(picture: Shades, width: float) -> Shades:
    """Return a picture, shape (h, w), smoothed by a Gaussian of a given standard deviation [pixel], coarsely."""
    coarse = ndimage.gaussian_filter(picture[::_COARSE, ::_COARSE], width / _COARSE)
    rows, columns = (np.arange(length) / _COARSE for length in picture.shape)
    across = np.stack([np.interp(columns, np.arange(coarse.shape[1]), line) for line in coarse]).astype(np.float32)
    low = np.minimum(rows.astype(np.intp), len(across) - 1)
    share = np.clip(rows - low, 0.0, 1.0)[:, None].astype(np.float32)
    return np.asarray((1.0 - share) * across[low] + share * across[np.minimum(low + 1, len(across) - 1)])


def _cutting_surface(depth: Shades) -> Shades:
    """Return the depth [m] beyond which everything is solid: that of the arm, shape (h, w), smoothly continued."""
    shown = np.isfinite(depth)
    _, (row, column) = ndimage.distance_transform_edt(~shown[::_COARSE, ::_COARSE], return_indices=True)
    coarse = ndimage.minimum_filter(depth[::_COARSE, ::_COARSE][row, column], max(depth.shape) // (10 * _COARSE) + 1)
    fine = np.repeat(np.repeat(coarse, _COARSE, axis=0), _COARSE, axis=1)[: len(depth), : depth.shape[1]]
    smooth = _smoothed(fine, _CUT * max(depth.shape))
    # Nothing in front of the arm is solid, where its depth changes quickly either.
    return np.asarray(np.where(shown, np.minimum(depth, smooth), smooth))


def _hollows(depth: Shades, deep: float) -> Shades:
    """Return how far each pixel lies behind its surroundings, as a fraction of a depth [m] up to 1, shape (h, w)."""
    shown = np.isfinite(depth)
    if not shown.any():
        return np.zeros_like(depth)
    filled = np.where(shown, depth, depth[shown].min())
    behind = _smoothed(filled, _HOLLOW * max(depth.shape)) - filled
    return np.where(shown, np.clip(behind / deep, 0.0, 1.0), 0.0)
