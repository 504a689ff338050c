"""What is told of segments and the surfaces near them."""

from dataclasses import dataclass

from ccm_opt.ground.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Witnesses:
    """Where each of k segments is nearest to a surface; the gap is the reach and the owner −1 where nothing is nearer.

    Attributes:
        gap: distance of the segment from the surface, negative inside its rounding, shape (k,) [m].
        share: place on the segment, from 0 at its start to 1 at its end, shape (k,).
        point: place on the surface, shape (k, 3) [m].
        normal: unit direction from the surface to the segment, shape (k, 3).
        owner: number of the surface's owner, shape (k,).
    """

    gap: FloatArray
    share: FloatArray
    point: FloatArray
    normal: FloatArray
    owner: IntArray


@dataclass(frozen=True, eq=False)
class PlaneRows:
    """Half-spaces normal · (x − point) ≥ 0 that hold a segment and are free of the surfaces near it.

    The rows of a segment stand together, the nearest first.

    Attributes:
        link: number of the segment, shape (r,).
        share: place on the segment that is nearest to the surface, from 0 to 1, shape (r,).
        normal: unit direction from the surface to the segment, shape (r, 3).
        point: place on the surface, shape (r, 3) [m].
        gap: distance of the segment from the surface, shape (r,) [m].
        owner: number of the surface's owner, shape (r,).
    """

    link: IntArray
    share: FloatArray
    normal: FloatArray
    point: FloatArray
    gap: FloatArray
    owner: IntArray
