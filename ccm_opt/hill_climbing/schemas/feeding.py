"""SCM-3 and SCM-5: give length to a segment or take it away, alone and passed between two (section 4.2)."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.decomposition import add_segment, delete_segment, start_of
from ccm_opt.continuum.segment import CurvatureSegment
from ccm_opt.ground.length_words import long_length
from ccm_opt.hill_climbing.candidate_moves import Shapes
from ccm_opt.hill_climbing.curve_track import SegmentTrack
from ccm_opt.hill_climbing.distance import TipPose
from ccm_opt.hill_climbing.schemas.interface import hold
from ccm_opt.hill_climbing.steps import Schema, SchemaStep, SchemaStopped
from ccm_opt.hill_climbing.world import World


@dataclass(frozen=True)
class Feeding:
    """An arm of which some lies on a track.

    Attributes:
        configuration: the arm.
        track: begins at the end of segment ``holder``.
        holder: index of the last segment that is not on the track.
        out: length on the track [m].
    """

    configuration: Configuration
    track: SegmentTrack
    holder: int
    out: float

    @property
    def left(self) -> float:
        """Length of the track that is not covered yet [m]."""
        return self.track.length - self.out

    def at(self, configuration: Configuration) -> "Feeding":
        """The same with the arm elsewhere."""
        return replace(self, configuration=configuration)

    def with_length_out(self, out: float) -> "Feeding":
        """Another length on the track; the segments before it are scaled to make up for it."""
        before = Configuration(self.configuration.base, self.configuration.segments[: self.holder + 1])
        scale = (before.length - (out - self.out)) / before.length
        return self._made_of(_scaled(before, slice(None), scale), self.track, out)

    def with_boundary_ahead(self, length: float) -> tuple["Feeding", TipPose]:
        """The boundary farther along the track, the segment before it scaled, and the pose that is to be held."""
        ahead = self.track.after(length)
        before = Configuration(self.configuration.base, self.configuration.segments[: self.holder + 1])
        position, heading = Configuration(before.base, (*before.segments, *self._placed(before, length))).tip
        shapes = Shapes.from_configurations([resized(before, self.holder, before.segments[-1].length + length)])
        # The segment before the boundary ends with the curvature with which the rest of the track begins.
        shapes.curvature[0, -1, -1] = ahead.segments[0].curvature[0]
        return self._made_of(shapes.configuration(0), ahead, self.out - length), TipPose(position, heading)

    def _placed(self, before: Configuration, length: float) -> tuple[CurvatureSegment, ...]:
        """The first ``length`` metres of the track, as they go on from a configuration."""
        whole = before
        for segment in self.track.first(length):
            whole = add_segment(whole, segment)
        return whole.segments[len(before.segments) :]

    def _made_of(self, before: Configuration, track: SegmentTrack, out: float) -> "Feeding":
        """The arm of what lies before the track and of the first ``out`` metres of it."""
        whole = before
        for segment in track.first(out):
            whole = add_segment(whole, segment)
        return Feeding(whole, track, self.holder, out)


Feed: TypeAlias = Generator[SchemaStep, None, Feeding]
"""Yields its steps; returns the arm with what it now has on the track."""


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
    stride = world.settings.schemas.feed * start.length
    for part in _parts(start.segments[segment].length, length, stride):
        here = hold(world, here, resized(here, segment, part), segment, end_pose(start, segment), "SCM-3")
        yield SchemaStep("SCM-3", here)
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
    stride = world.settings.schemas.feed * curve.length
    for part in _parts(start.segments[-1].length, length, stride):
        there = fed(here, curve, part)
        if not world.move_allowed(here, there):
            raise SchemaStopped(
                "SCM-5", here, f"contact at {long_length(part)} of the curve's {long_length(curve.length)}"
            )
        here = there
        yield SchemaStep("SCM-5", here)
    return here


def pass_length(world: World, start: Feeding, least: float, most: float = np.inf) -> Feed:
    """SCM-3 and SCM-5 together: what goes out along the track, the segments before it lose.

    The arm keeps its length, as it must; so each step is one of both schemas at once.

    Args:
        world: the world.
        start: the arm, and how much of it lies on the track.
        least: length that stays off the track [m].
        most: length that is passed on at most [m].

    Yields:
        Configurations of constant total length.

    Returns:
        The last of them: all of the track is covered, or nothing is left to give, or something is in the way.
    """
    here = start
    held = end_pose(start.configuration, start.holder)
    total = start.configuration.length
    longest = world.settings.schemas.feed * total
    finest = world.settings.schemas.finest_feed * longest
    wanted = min(start.track.length, start.out + most)
    stride = longest
    while stride >= finest:
        left = min(wanted - here.out, total - here.out - least)
        if left <= 1e-9 * total:
            return here
        there = here.with_length_out(here.out + min(stride, left))
        try:
            there = there.at(hold(world, here.configuration, there.configuration, here.holder, held, "SCM-3"))
        except SchemaStopped:
            stride *= 0.5
            continue
        here = there
        stride = min(2.0 * stride, longest)
        yield SchemaStep("SCM-3 with SCM-5", here.configuration)
    return here


def slide_boundary(world: World, start: Feeding, length: float) -> Feed:
    """Move the boundary to the track ahead along it; the segment before takes what the boundary passes (SCM-3).

    "Segment boundaries can be moved smoothly along the length of the arm" (section 2.2). The subgoal that is held
    moves along with the boundary, so that a fold opens. What lies on the track stays where it is.

    Args:
        world: the world.
        start: the arm, and how much of it lies on the track.
        length: by which the boundary should move [m].

    Yields:
        Configurations of constant total length.

    Returns:
        The last of them: the boundary has moved so far, or something is in the way.
    """
    here = start
    moved = 0.0
    stride = world.settings.schemas.feed * start.configuration.length
    finest = world.settings.schemas.finest_feed * stride
    while stride >= finest and moved < (1.0 - 1e-9) * length:
        part = min(stride, length - moved)
        there, held = here.with_boundary_ahead(part)
        try:
            there = there.at(hold(world, here.configuration, there.configuration, here.holder, held, "SCM-3"))
        except SchemaStopped:
            stride *= 0.5
            continue
        here = there
        moved += part
        yield SchemaStep("SCM-3", here.configuration)
    return here


def begin_feeding(world: World, start: Configuration, track: SegmentTrack) -> Feeding:
    """The first piece of a track that goes on from the tip; the segments before it give up as much (SCM-3).

    Raises:
        SchemaStopped: the tip cannot be held.
    """
    holder = len(start.segments) - 1
    length = world.settings.schemas.feed * start.length
    finest = world.settings.schemas.finest_feed * length
    while True:
        changed = Feeding(start, track, holder, 0.0).with_length_out(length)
        try:
            return changed.at(hold(world, start, changed.configuration, holder, end_pose(start, holder), "SCM-3"))
        except SchemaStopped:
            length *= 0.5
            if length < finest:
                raise


def end_pose(configuration: Configuration, segment: int) -> TipPose:
    """Position and heading of a segment's end."""
    (position,), (heading,) = Shapes.from_configurations([configuration]).first_segments(segment + 1).tips
    return TipPose(position, float(heading))


def resized(configuration: Configuration, segment: int, length: float) -> Configuration:
    """A segment scaled to another length: curvature goes with 1/length, so that it keeps its shape."""
    return _scaled(configuration, slice(segment, segment + 1), length / configuration.segments[segment].length)


def _scaled(configuration: Configuration, which: slice, scale: float) -> Configuration:
    """Some segments scaled in length and curvature, so that they keep their shape."""
    shapes = Shapes.from_configurations([configuration])
    shapes.lengths[0, which] *= scale
    shapes.curvature[0, which] /= scale
    shapes.moments[0, which] /= scale**3
    return shapes.configuration(0)


def fed(configuration: Configuration, curve: CurvatureSegment, length: float) -> Configuration:
    """The tip segment replaced by the first part of a curve."""
    return add_segment(delete_segment(configuration), start_of(curve, length))


def _parts(first: float, last: float, stride: float) -> list[float]:
    """Lengths evenly on the way from one to another, no farther apart than the stride [m]."""
    count = max(1, int(np.ceil(abs(last - first) / stride)))
    return [first + (last - first) * k / count for k in range(1, count + 1)]
