"""The schemas of the 1990 paper that select and feed, SCM-1, SCM-3, SCM-4 and SCM-5; re-exports the others."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from scipy.special import j0

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import vector_heading, whole_turns, wrap
from ccm_opt.planning.baseline.curve_track import SegmentTrack
from ccm_opt.planning.baseline.distance import Distance, Precision, TipPose
from ccm_opt.planning.baseline.hill_climb import Climb, Ending, Schema, SchemaStep, SchemaStopped, end_of
from ccm_opt.planning.baseline.operators import Moves, Operator, Shapes
from ccm_opt.planning.baseline.schema import FEED, hold, scm_0, scm_2, scm_6, scm_7, scm_8
from ccm_opt.planning.baseline.world import CROWDING_POINTS, World
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.decomposition import add_segment, delete_segment, segment_head
from ccm_opt.robot.segment import SINE, CurvatureSegment, SegmentType, end_angle, natural_segment, select_segment_type

_SELECTED_PRECISION = Precision(1e-3, 6e-3)
"""Tolerances within which a curve selected by schema SCM-4 ends at the goal; SCM-0 removes the rest. Heuristic."""
_SHORTENING = 0.03
"""Fraction by which schema SCM-4 of the paper shortens a segment that is too long, per iteration. Heuristic."""
_SELECTION_PUSH = 0.05
"""Weight of the repulsive potential of obstacles in the climb of schema SCM-4 of the paper. Heuristic."""
_SELECTION_STEPS = 1500
"""Maximum number of moves in the climb of schema SCM-4 of the paper. Heuristic."""
_LEAST_CHORD_RATIO = 0.25
"""Minimum ratio of chord to length of the initial guess of schema SCM-4 of the paper. Heuristic."""
_FINEST_FEED = 1.0 / 8.0
"""Minimum feed step after repeated halving at an obstacle, as a fraction of the full step. Heuristic."""


@dataclass(frozen=True)
class Feeding:
    """State of an arm whose distal part lies on a reference path along which the arm is fed.

    Attributes:
        configuration: configuration of the arm.
        track: the reference path, which begins at the end of segment ``holder``.
        holder: index of the last segment that is not on the path.
        out: length of the arm on the path [m].
    """

    configuration: Configuration
    track: SegmentTrack
    holder: int
    out: float

    @property
    def left(self) -> float:
        """Length of the reference path that is not yet covered by the arm [m]."""
        return self.track.length - self.out

    def at(self, configuration: Configuration) -> "Feeding":
        """Return the state with the arm in another configuration."""
        return replace(self, configuration=configuration)

    def with_length_out(self, out: float) -> "Feeding":
        """Return the state with the length ``out`` [m] on the path; the segments before it are scaled to compensate."""
        before = Configuration(self.configuration.base, self.configuration.segments[: self.holder + 1])
        scale = (before.length - (out - self.out)) / before.length
        return self._made_of(_scaled(before, slice(None), scale), self.track, out)

    def with_boundary_ahead(self, length: float) -> tuple["Feeding", TipPose]:
        """Return the state with the start of the path moved ahead by ``length`` [m], and the pose of the new start.

        The path loses the first ``length`` metres, by which segment ``holder`` is stretched. The new pose is the one at
        which the end of that segment has to be held.
        """
        ahead = self.track.after(length)
        before = Configuration(self.configuration.base, self.configuration.segments[: self.holder + 1])
        position, heading = Configuration(before.base, (*before.segments, *self._placed(before, length))).tip
        shapes = Shapes.from_configurations([resized(before, self.holder, before.segments[-1].length + length)])
        # The segment before the boundary ends with the curvature with which the rest of the track begins.
        shapes.curvature[0, -1, -1] = ahead.segments[0].curvature[0]
        return self._made_of(shapes.configuration(0), ahead, self.out - length), TipPose(position, heading)

    def _placed(self, before: Configuration, length: float) -> tuple[CurvatureSegment, ...]:
        """Return the segments of the first ``length`` [m] of the path, as a continuation of a configuration."""
        whole = before
        for segment in self.track.first(length):
            whole = add_segment(whole, segment)
        return whole.segments[len(before.segments) :]

    def _made_of(self, before: Configuration, track: SegmentTrack, out: float) -> "Feeding":
        """Return the state of an arm that consists of the segments ``before`` and the first ``out`` [m] of a path."""
        whole = before
        for segment in track.first(out):
            whole = add_segment(whole, segment)
        return Feeding(whole, track, self.holder, out)


Feed: TypeAlias = Generator[SchemaStep, None, Feeding]
"""Generator that yields the steps of a feed motion and returns the arm with its new length on the reference path."""


def scm_3(world: World, start: Configuration, segment: int, length: float) -> Schema:
    """Run schema SCM-3 of the paper: lengthen or shorten a segment while its end keeps position and heading.

    The curvature at that end is kept as well, and so are all later segments.

    Args:
        world: environment of the schemas.
        start: configuration of the arm.
        segment: index of the segment.
        length: final length of the segment [m].

    Yields:
        Steps with evenly changing length.

    Returns:
        The last configuration.

    Raises:
        SchemaStopped: the pose of the end cannot be kept.
    """
    here = start
    stride = FEED * start.length
    for part in _parts(start.segments[segment].length, length, stride):
        here = hold(world, here, resized(here, segment, part), segment, end_pose(start, segment), "SCM-3")
        yield SchemaStep("SCM-3", here)
    return here


def scm_5(world: World, start: Configuration, curve: CurvatureSegment, length: float) -> Schema:
    """Run schema SCM-5 of the paper: feed or retract the last segment of the arm along a given curve.

    The last segment is always the first part of the curve, so that no point of the segment leaves the curve.

    Args:
        world: environment of the schemas.
        start: configuration of the arm, with the last segment on the curve.
        curve: curve along which the last segment moves.
        length: final length of the last segment [m].

    Yields:
        Steps with evenly changing length of the last segment.

    Returns:
        The last configuration.

    Raises:
        SchemaStopped: the motion is blocked.
    """
    here = start
    stride = FEED * curve.length
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
    """Feed the arm along a reference path, with the length taken from the segments before the path.

    Schemas SCM-3 and SCM-5 of the paper run together: the arm's length is constant, so each step belongs to both.

    Args:
        world: environment of the schemas.
        start: state of the arm on the path.
        least: minimum total length of the segments before the path [m].
        most: maximum length to feed [m].

    Yields:
        Steps with constant total length.

    Returns:
        The last state: the path is covered, the length to feed is used up, or the motion is blocked.
    """
    here = start
    held = end_pose(start.configuration, start.holder)
    total = start.configuration.length
    longest = FEED * total
    finest = _FINEST_FEED * longest
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
    """Move the start of a reference path ahead along the path, and lengthen the segment before by the same amount.

    The segment is lengthened by schema SCM-3 of the paper. "Segment boundaries can be moved smoothly along the length
    of the arm" (section 2.2). The pose that is held moves along the path with the boundary, so that a fold opens. The
    part of the arm on the path does not move.

    Args:
        world: environment of the schemas.
        start: state of the arm on the path.
        length: requested displacement of the boundary [m].

    Yields:
        Steps with constant total length.

    Returns:
        The last state: the boundary has moved by the requested length, or the motion is blocked.
    """
    here = start
    moved = 0.0
    stride = FEED * start.configuration.length
    finest = _FINEST_FEED * stride
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
    """Return the state of an arm with the first piece of a reference path added at its tip.

    The other segments are shortened to compensate, while their end keeps its pose (schema SCM-3 of the paper).

    Raises:
        SchemaStopped: the pose cannot be kept, not even with a short piece.
    """
    holder = len(start.segments) - 1
    length = FEED * start.length
    finest = _FINEST_FEED * length
    while True:
        changed = Feeding(start, track, holder, 0.0).with_length_out(length)
        try:
            return changed.at(hold(world, start, changed.configuration, holder, end_pose(start, holder), "SCM-3"))
        except SchemaStopped:
            length *= 0.5
            if length < finest:
                raise


def end_pose(configuration: Configuration, segment: int) -> TipPose:
    """Return position and heading of the end of a segment with a given index."""
    (position,), (heading,) = Shapes.from_configurations([configuration]).first_segments(segment + 1).tips
    return TipPose(position, float(heading))


def resized(configuration: Configuration, segment: int, length: float) -> Configuration:
    """Return a configuration with one segment scaled to another length [m]; the segment keeps its shape.

    Its curvatures are scaled by the inverse factor.
    """
    return _scaled(configuration, slice(segment, segment + 1), length / configuration.segments[segment].length)


def _scaled(configuration: Configuration, which: slice, scale: float) -> Configuration:
    """Return a configuration with a range of segments scaled in length by a factor; they keep their shape."""
    shapes = Shapes.from_configurations([configuration])
    shapes.lengths[0, which] *= scale
    shapes.curvature[0, which] /= scale
    shapes.moments[0, which] /= scale**3
    return shapes.configuration(0)


def fed(configuration: Configuration, curve: CurvatureSegment, length: float) -> Configuration:
    """Return a configuration whose last segment is replaced by the first ``length`` [m] of a curve."""
    return add_segment(delete_segment(configuration), segment_head(curve, length))


def _parts(first: float, last: float, stride: float) -> list[float]:
    """Return evenly spaced lengths from ``first`` (excluded) to ``last``, at most ``stride`` apart, all [m]."""
    count = max(1, int(np.ceil(abs(last - first) / stride)))
    return [first + (last - first) * k / count for k in range(1, count + 1)]


BENT = (SegmentType.LEFT, SegmentType.RIGHT, SegmentType.LEFT_RIGHT, SegmentType.RIGHT_LEFT)
"""Segment types with curvature."""
_BUMP = np.array([0.0, 1.125, 1.5, 1.125, 0.0])
"""Values at even knots of a parabola with mean 1 that vanishes at both ends: a half wave of curvature."""
_KEPT_LENGTH = (
    Operator.C_B, Operator.C_C, Operator.C_D, Operator.C_E, Operator.S_B, Operator.S_C, Operator.S_D,
)  # fmt: skip
"""Operators that keep the length of a segment and the curvature at its start."""


@dataclass(frozen=True)
class Selection:
    """Curvature segment that schema SCM-1 or SCM-4 of the paper selects to reach a goal, with its type.

    Attributes:
        kind: type of the segment.
        segment: curve of this type; the heading of its start is the base rotation.
    """

    kind: SegmentType
    segment: CurvatureSegment

    def configuration(self, base: FloatArray) -> Configuration:
        """Return the segment as a backbone curve that begins at a base position, shape (2,) [m]."""
        return Configuration(base, (self.segment,))


def scm_1(world: World, start: Configuration, goal: TipPose) -> Selection:
    """Run schema SCM-1 of the paper: select the type of a curvature segment and the base rotation to reach a goal.

    The arm does not move; SCM-2 or SCM-8 then moves it. Only base and goal pose are considered (section 2.1). The curve
    is a circular arc or a modal curve of the selected type whose end is at the goal position, with base rotation
    clipped to the range of the base.

    Args:
        world: environment of the schemas, with the range of the base.
        start: configuration of the arm, of which only base position, base rotation and length are used.
        goal: goal of the tip, no farther from the base than the length of the arm.

    Raises:
        SchemaStopped: the goal is out of reach.
    """
    return ranked_selections(world, start, goal)[0]


def ranked_selections(world: World, start: Configuration, goal: TipPose) -> tuple[Selection, ...]:
    """Return the selection of schema SCM-1 and those of the other bent types, ranked by heading error at the goal.

    The selection of SCM-1 comes first, except for a straight segment if the goal is nearer than the arm's length.

    Args:
        world: environment of the schemas, with the range of the base.
        start: configuration of the arm.
        goal: goal of the tip.

    Raises:
        SchemaStopped: the goal is out of reach.
    """
    base_heading = None if world.base_turns else 0.5 * sum(world.base_range)
    kind = select_segment_type(start.base, base_heading, goal.position, goal.heading)
    chord = goal.position - start.base
    direction = vector_heading(chord)
    ratio = float(np.hypot(*chord)) / start.length
    if ratio > 1.0:
        reason = f"the goal is {long_length(ratio * start.length)} away, the arm {long_length(start.length)} long"
        raise SchemaStopped("SCM-1", start, reason)
    others = sorted((k for k in BENT if k is not kind), key=lambda k: _heading_error(k, direction, ratio, goal))
    # An arm longer than the distance to the goal cannot be straight: the bent types come first.
    kinds = (*others, kind) if kind is SegmentType.STRAIGHT and ratio < 1.0 - 1e-3 else (kind, *others)
    return tuple(_select(world, start, goal, k) for k in kinds)


def _heading_error(kind: SegmentType, direction: float, ratio: float, goal: TipPose) -> float:
    """Return the heading error at the goal of the natural curve of a segment type [rad]; 0 if any heading is allowed.

    Args:
        kind: the type.
        direction: direction of the chord from base to goal [rad].
        ratio: length of the chord divided by that of the curve, in [0, 1].
        goal: goal of the tip.
    """
    if goal.heading is None:
        return 0.0
    side = -1.0 if kind in {SegmentType.RIGHT, SegmentType.LEFT_RIGHT} else 1.0
    return abs(wrap(direction + side * end_angle(kind, ratio) - goal.heading))


def _select(world: World, start: Configuration, goal: TipPose, kind: SegmentType) -> Selection:
    """Return the natural curve of a segment type from base to goal, with base rotation clipped to its range."""
    segment = natural_segment(kind, start.base, goal.position, start.length)
    whole = whole_turns(start.base_heading - segment.heading)
    heading = float(np.clip(segment.heading + whole, *world.base_range))
    return Selection(kind, replace(segment, heading=heading))


def scm_4(world: World, start: Configuration, goal: TipPose, longest: float = np.inf) -> Selection:
    """Run schema SCM-4 of the paper: select a further segment, with type and length, from the arm's tip to a goal.

    The arm does not move. The segment begins at its tip, with the heading of the tip and zero curvature, as SCM-6
    leaves the tip. The type depends on both poses only. The initial guess is a half wave plus a whole wave of curvature
    with the changes of heading that the poses require; hill climbing in interpolation points and length then reaches
    the goal. The paper does not define the optimal length of the segment. Here it is the result of the climb, or
    ``longest`` if that is shorter.

    Args:
        world: environment of the schemas.
        start: configuration of the arm before the segment.
        goal: goal of the segment's end.
        longest: maximum length of the segment [m].

    Raises:
        SchemaStopped: no segment is found, or it lies partly inside a wall.
    """
    position, heading = start.tip
    kind = select_segment_type(position, heading, goal.position, goal.heading)
    guess = _first_guess(position, heading, goal, _LEAST_CHORD_RATIO)
    segment = _met(world, start, guess, goal, (*_KEPT_LENGTH, Operator.LENGTH))
    while segment.length > longest:
        length = max(longest, (1.0 - _SHORTENING) * segment.length)
        # Curvature is scaled with 1/length, so that the shorter guess has the shape of the longer segment.
        shorter = replace(segment, length=length, curvature=segment.curvature * segment.length / length)
        segment = _met(world, start, shorter, goal, _KEPT_LENGTH)
    alone = Shapes.from_configurations([Configuration(position, (segment,))])
    least = float(world.gap(alone.points(CROWDING_POINTS)).min())
    if least < 0.0:
        raise SchemaStopped("SCM-4", start, f"the segment to the goal would be {short_length(-least)} inside a wall")
    return Selection(kind, segment)


def _met(
    world: World, start: Configuration, guess: CurvatureSegment, goal: TipPose, operators: tuple[Operator, ...]
) -> CurvatureSegment:
    """Return a segment with its end at a goal, found by hill climbing from an initial guess.

    Args:
        world: environment of the schemas, for the potential of obstacles; contact is allowed.
        start: configuration of the arm before the segment.
        guess: initial guess of the segment.
        goal: goal of the segment's end.
        operators: operators of the climb.

    Raises:
        SchemaStopped: the climb does not reach the goal.
    """
    here = Configuration(start.tip[0], (guess,))
    distance = Distance(goal, guess.length, precision=_SELECTED_PRECISION)
    task = Climb(
        distance,
        distance.threshold,
        Moves((0,), operators),
        most_steps=_SELECTION_STEPS,
        push=_SELECTION_PUSH,
    )
    here, ending = end_of(replace(world, passes=World().passes), here, task)
    if ending is not Ending.ARRIVED:
        raise SchemaStopped(
            "SCM-4", start, f"no segment of {long_length(guess.length)} to the goal was found: {ending}"
        )
    return here.segments[0]


def _first_guess(position: FloatArray, heading: float, goal: TipPose, least_ratio: float) -> CurvatureSegment:
    """Return an initial guess of a segment between two poses, with zero curvature at both ends.

    The heading changes by α from the start to the chord and by β from the chord to the end. Curvature is the sum of a
    half wave with the change of heading α + β and a whole wave with the amplitude (α - β)/2 of heading.

    Args:
        position: position of the start, shape (2,) [m].
        heading: heading of the start [rad].
        goal: goal of the end.
        least_ratio: minimum ratio of chord to length.

    Raises:
        ProblemError: start and goal are at the same position.
    """
    chord = goal.position - position
    distance = float(np.hypot(*chord))
    if distance == 0.0:
        raise ProblemError("the segment's start and goal are one point; expected a goal elsewhere")
    direction = vector_heading(chord)
    alpha = wrap(direction - heading)
    beta = alpha if goal.heading is None else wrap(goal.heading - direction)
    wave = 0.5 * (alpha - beta)
    # Chord ratio of the guess as if bump and wave acted separately; waves fold back before J₀ vanishes at 2.405.
    ratio = max(float(j0(min(abs(wave), 2.4)) * np.sinc(0.5 * (alpha + beta) / np.pi)), least_ratio)
    length = distance / ratio
    return CurvatureSegment(length, heading, ((alpha + beta) * _BUMP + 2.0 * np.pi * wave * SINE) / length)


__all__ = ["Selection", "scm_0", "scm_1", "scm_2", "scm_3", "scm_4", "scm_5", "scm_6", "scm_7", "scm_8"]
