"""Routes through planar free space and the corridors of convex regions around them (the paper's section 4.1)."""

from dataclasses import dataclass

from ccm_opt.core.arrays import FloatArray


@dataclass(frozen=True)
class ConvexRegion:
    """A convex polygon inside free space, with its half-planes ``normals @ x <= offsets``.

    Attributes:
        vertices: vertices in counter-clockwise order, shape (m, 2) [m].
        normals: unit outward normals of the edges, shape (m, 2).
        offsets: offsets of the half-planes, shape (m,) [m].
    """

    vertices: FloatArray
    normals: FloatArray
    offsets: FloatArray


@dataclass(frozen=True)
class Route:
    """One homotopy class of paths from a start to a goal in triangulated planar free space.

    Attributes:
        sleeve: indices of the triangles crossed by the shortest path, in order, without immediate returns; they
            identify the class.
        taut: the shortest path of the class, a polyline (taut string), shape (k, 2) [m].
        length: length of ``taut`` [m].
        heading: heading required at the end of the path [rad], or None.
    """

    sleeve: tuple[int, ...]
    taut: FloatArray
    length: float
    heading: float | None = None


@dataclass(frozen=True)
class Corridor:
    """Overlapping convex regions along a route; the first contains the start, the last the goal.

    Attributes:
        route: the route around which the corridor was built.
        regions: convex regions in order along the route.
        portals: segments at which the route passes from region k to k + 1, left end then right end as seen along the
            route, shape (regions - 1, 2, 2) [m].
    """

    route: Route
    regions: tuple[ConvexRegion, ...]
    portals: FloatArray
