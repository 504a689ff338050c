"""SCM-3 and SCM-5: give length to a segment or take it away, alone and passed from one to the other."""

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.decomposition import add_segment, delete_segment, divide_segment, start_of
from ccm_opt.continuum.segment import CurvatureSegment
from ccm_opt.hill_climbing.distance import TipPose
from ccm_opt.hill_climbing.schemas.interface import hold
from ccm_opt.hill_climbing.shapes import Shapes
from ccm_opt.hill_climbing.steps import Schema, SchemaStopped, Step
from ccm_opt.hill_climbing.world import World

FEED = 0.02
"""Length that is passed on in one step, as a share of the arm's."""
FINEST = 1.0 / 8.0
"""A feed that meets an obstacle is halved down to this share of it."""


def scm_3(world: World, start: Configuration, segment: int, length: float) -> Schema:
    """SCM-3: maintain the current tip position and orientation while a segment gets longer or shorter.

    The tip is that of the segment; what follows it goes along unchanged. The curvature at its end is left alone.

    Args:
        world: the world.
        start: where the arm is.
        segment: index of the segment.
        length: it should have at the end [m].

    Yields:
        Configurations with evenly changing length.

    Returns:
        The last of them.

    Raises:
        SchemaStopped: the pose cannot be held.
    """
    here = start
    for part in _parts(start.segments[segment].length, length, FEED * start.length):
        here = hold(world, here, resized(here, segment, part), segment, end_pose(start, segment), "SCM-3")
        yield Step("SCM-3", here)
    return here


def scm_5(world: World, start: Configuration, curve: CurvatureSegment, length: float) -> Schema:
    """SCM-5: feed or retract the tip segment along a given curve, specified by its curvature.

    The tip segment is always the first part of the curve, so every point of it stays on the curve.

    Args:
        world: the world.
        start: where the arm is; its tip segment lies on the curve.
        curve: the segment that it may become.
        length: that it should get [m].

    Yields:
        Configurations with evenly changing length of the tip segment.

    Returns:
        The last of them.

    Raises:
        SchemaStopped: something is in the way.
    """
    here = start
    for part in _parts(start.segments[-1].length, length, FEED * curve.length):
        there = fed(here, curve, part)
        if not world.move_allowed(here, there):
            raise SchemaStopped("SCM-5", here, f"contact at {part:.3f} m of the curve's {curve.length:.3f} m")
        here = there
        yield Step("SCM-5", here)
    return here


def pass_length(
    world: World, start: Configuration, curve: CurvatureSegment, least: float, most: float = np.inf
) -> Schema:
    """SCM-3 and SCM-5 together: what the tip segment gains along its curve, the base segment loses.

    The arm keeps its length, as it must; so each step is one of both schemas at once. All segments but the last hold
    the pose of the boundary to the last.

    Args:
        world: the world.
        start: where the arm is; its tip segment lies on the curve.
        curve: the segment that the tip segment is to become.
        least: length that the base segment keeps [m].
        most: length that is passed on at most [m].

    Yields:
        Configurations of constant total length.

    Returns:
        The last of them: the tip segment is complete, or the base segment has no more to give, or something is in
        the way.
    """
    here, holder = start, len(start.segments) - 2
    held = end_pose(start, holder)
    stride = FEED * start.length
    wanted = min(curve.length, start.segments[-1].length + most)
    while stride >= FINEST * FEED * start.length:
        left = min(wanted - here.segments[-1].length, here.segments[0].length - least)
        if left <= 1e-9 * start.length:
            return here
        part = min(stride, left)
        longer = fed(here, curve, here.segments[-1].length + part)
        try:
            here = hold(world, here, resized(longer, 0, here.segments[0].length - part), holder, held, "SCM-3")
        except SchemaStopped:
            stride *= 0.5
            continue
        stride = min(2.0 * stride, FEED * start.length)
        yield Step("SCM-3 with SCM-5", here)
    return here


def slide_boundary(world: World, start: Configuration, length: float) -> Schema:
    """Move the boundary to the tip segment ahead along it; the segment before takes what the boundary passes (SCM-3).

    "Segment boundaries can be moved smoothly along the length of the arm" (section 2.2). The subgoal that is held
    moves along with the boundary, so that a fold opens. The tip segment stays where it is.

    Args:
        world: the world.
        start: where the arm is.
        length: by which the boundary should move [m].

    Yields:
        Configurations of constant total length.

    Returns:
        The last of them: the boundary has moved so far, or something is in the way.
    """
    here, holder = start, len(start.segments) - 2
    stride, moved = FEED * start.length, 0.0
    while stride >= FINEST * FEED * start.length and moved < (1.0 - 1e-9) * length:
        part = min(stride, length - moved)
        tip = here.segments[-1]
        divided = divide_segment(here, holder + 1, part / tip.length)
        held = end_pose(divided, holder + 1)
        taken = resized(Configuration(here.base, here.segments[:-1]), holder, here.segments[holder].length + part)
        shapes = Shapes.of([taken])
        shapes.curvature[0, -1, -1] = divided.segments[-1].curvature[0]
        changed = add_segment(shapes.configuration(0), divided.segments[-1])
        try:
            here = hold(world, here, changed, holder, held, "SCM-3")
        except SchemaStopped:
            stride *= 0.5
            continue
        moved += part
        yield Step("SCM-3", here)
    return here


def begin_feeding(world: World, start: Configuration, curve: CurvatureSegment) -> Configuration:
    """A short tip segment on a curve that goes on from the tip; the segment before it gives up as much (SCM-3).

    Raises:
        SchemaStopped: the tip cannot be held.
    """
    last, length = len(start.segments) - 1, FEED * start.length
    shorter = resized(start, last, start.segments[last].length - length)
    return hold(world, start, add_segment(shorter, start_of(curve, length)), last, end_pose(start, last), "SCM-3")


def end_pose(configuration: Configuration, segment: int) -> TipPose:
    """Position and heading of a segment's end."""
    (position,), (heading,) = Shapes.of([configuration]).first_segments(segment + 1).tips
    return TipPose(position, float(heading))


def resized(configuration: Configuration, segment: int, length: float) -> Configuration:
    """A segment scaled to another length: curvature goes with 1/length, so that it keeps its shape."""
    shapes = Shapes.of([configuration])
    scale = length / shapes.lengths[0, segment]
    shapes.lengths[0, segment] = length
    shapes.curvature[0, segment] /= scale
    shapes.moments[0, segment] /= scale**3
    return shapes.configuration(0)


def fed(configuration: Configuration, curve: CurvatureSegment, length: float) -> Configuration:
    """The tip segment replaced by the first part of a curve."""
    return add_segment(delete_segment(configuration), start_of(curve, length))


def _parts(first: float, last: float, stride: float) -> list[float]:
    count = max(1, int(np.ceil(abs(last - first) / stride)))
    return [first + (last - first) * k / count for k in range(1, count + 1)]
