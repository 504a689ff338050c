"""Straight edges in the unknowns of a curve, in pieces that are nearly straight in configurations too."""

from itertools import pairwise

import numpy as np

from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.space.motion.curve_map import feed_to_next_stop
from ccm_opt.space.motion.space_step import SpaceStepper


def pieces(stepper: SpaceStepper, before: FloatArray, after: FloatArray) -> list[FloatArray]:
    """Unknowns along an edge, so near that no joint bends in between while the guide tube of a fed arm holds it."""
    arm = stepper.curve.arm
    if not arm.base_axes:
        return [before, after]
    column = stepper.curve.feed_column
    scale = float(stepper.curve.scale[column])
    start = float(before[column]) * scale
    way = float(after[column]) * scale - start
    share = 0.0
    places = [before]
    while share < 1.0:
        room = feed_to_next_stop(stepper.curve, start + share * way, forward=way > 0.0)
        share = 1.0 if abs(way) * (1.0 - share) <= room else share + room / abs(way)
        places.append(before + share * (after - before))
    return places


def edge_is_safe(stepper: SpaceStepper, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
    """Whether an edge keeps all limits and is certified."""
    return len(failing_edges(stepper, np.stack((before, after)), depth)) == 0


def failing_edges(stepper: SpaceStepper, unknowns: FloatArray, depth: int | None = None) -> IntArray:
    """Numbers of the edges of a motion, unknowns of shape (K + 1, p), that are not certified."""
    edges = [pieces(stepper, before, after) for before, after in pairwise(unknowns)]
    configurations = stepper.curve.configurations(np.array([v for edge in edges for v in edge]))
    kept = [stepper.within_limits(q) for q in configurations]
    failing = []
    first = 0
    for k, edge in enumerate(edges):
        places = range(first, first + len(edge))
        first += len(edge)
        if not all(kept[place] for place in places) or not all(
            stepper.certificate.safe(configurations[place], configurations[place + 1], depth) for place in places[:-1]
        ):
            failing.append(k)
    return np.array(failing, dtype=np.intp)


def in_pieces(stepper: SpaceStepper, unknowns: FloatArray) -> FloatArray:
    """The motion with all its edges in pieces, shape (m, p)."""
    found = [unknowns[0]]
    for before, after in pairwise(unknowns):
        found.extend(pieces(stepper, before, after)[1:])
    return np.stack(found)
