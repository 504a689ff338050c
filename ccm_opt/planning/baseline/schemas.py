"""The schemas that select and feed: SCM-1, SCM-3, SCM-4 and SCM-5; re-exports the others."""

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
"""Precision with which a curve selected by SCM-4 ends at the goal; SCM-0 does the rest. Taste."""
_SHORTENING = 0.03
"""Share by which SCM-4 shortens a segment that is too long, per round. Taste."""
_SELECTION_PUSH = 0.05
"""Weight of the walls while a curve is selected. Taste."""
_SELECTION_STEPS = 1500
"""Most moves of that climb. Taste."""
_LEAST_CHORD_RATIO = 0.25
"""Least chord of SCM-4's first guess, as a share of its length. Taste."""
_FINEST_FEED = 1.0 / 8.0
"""Share of the feed step down to which a feed that meets an obstacle is halved. Taste."""


@dataclass(frozen=True)
class Feeding:
    """An arm with its tip part on a track.

    Attributes:
        configuration: the arm.
        track: the track, which begins at the end of segment ``holder``.
        holder: index of the last segment that is not on the track.
        out: length of the arm on the track [m].
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
        """Return the feeding state with the arm in another configuration."""
        return replace(self, configuration=configuration)

    def with_length_out(self, out: float) -> "Feeding":
        """Return the arm with another length on the track; the segments before it are scaled to compensate."""
        before = Configuration(self.configuration.base, self.configuration.segments[: self.holder + 1])
        scale = (before.length - (out - self.out)) / before.length
        return self._made_of(_scaled(before, slice(None), scale), self.track, out)

    def with_boundary_ahead(self, length: float) -> tuple["Feeding", TipPose]:
        """Return the arm with the boundary farther along the track, and the pose to be held.

        The segment before the boundary is scaled.
        """
        ahead = self.track.after(length)
        before = Configuration(self.configuration.base, self.configuration.segments[: self.holder + 1])
        position, heading = Configuration(before.base, (*before.segments, *self._placed(before, length))).tip
        shapes = Shapes.from_configurations([resized(before, self.holder, before.segments[-1].length + length)])
        # The segment before the boundary ends with the curvature with which the rest of the track begins.
        shapes.curvature[0, -1, -1] = ahead.segments[0].curvature[0]
        return self._made_of(shapes.configuration(0), ahead, self.out - length), TipPose(position, heading)

    def _placed(self, before: Configuration, length: float) -> tuple[CurvatureSegment, ...]:
        """Return the first ``length`` metres of the track, as a continuation of a configuration."""
        whole = before
        for segment in self.track.first(length):
            whole = add_segment(whole, segment)
        return whole.segments[len(before.segments) :]

    def _made_of(self, before: Configuration, track: SegmentTrack, out: float) -> "Feeding":
        """Return the arm composed of the part before the track and the first ``out`` metres of the track."""
        whole = before
        for segment in track.first(out):
            whole = add_segment(whole, segment)
        return Feeding(whole, track, self.holder, out)


Feed: TypeAlias = Generator[SchemaStep, None, Feeding]
"""Yields its steps; returns the arm with its new length on the track."""


def scm_3(world: World, start: Configuration, segment: int, length: float) -> Schema:
    """Run SCM-3: maintain the current tip position and orientation while a segment gets longer or shorter.

    The tip is the end of the segment, where the curvature is kept; the segments after it move along unchanged.

    Args:
        world: the world.
        start: configuration of the arm.
        segment: index of the segment.
        length: final length of the segment [m].

    Yields:
        Configurations with evenly changing length.

    Returns:
        The last configuration.

    Raises:
        SchemaStopped: the pose cannot be held.
    """
    here = start
    stride = FEED * start.length
    for part in _parts(start.segments[segment].length, length, stride):
        here = hold(world, here, resized(here, segment, part), segment, end_pose(start, segment), "SCM-3")
        yield SchemaStep("SCM-3", here)
    return here


def scm_5(world: World, start: Configuration, curve: CurvatureSegment, length: float) -> Schema:
    """Run SCM-5: feed or retract the tip segment along a given curve, specified by its curvature.

    The tip segment is always the first part of the curve, so every point of it stays on the curve.

    Args:
        world: the world.
        start: configuration of the arm; its tip segment lies on the curve.
        curve: curve along which the tip segment moves; the tip segment is always its first part.
        length: final length of the segment [m].

    Yields:
        Configurations with evenly changing length of the tip segment.

    Returns:
        The last configuration.

    Raises:
        SchemaStopped: there is an obstruction.
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
    """Run SCM-3 and SCM-5 together: the segments before the track lose the length that is fed out along it.

    The arm's length is constant, so each step is one of both schemas at once.

    Args:
        world: the world.
        start: the arm, and its length on the track.
        least: minimum length that stays off the track [m].
        most: maximum length that is fed out [m].

    Yields:
        Configurations of constant total length.

    Returns:
        The last configuration: the track is fully covered, no length is left to feed, or there is an obstruction.
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
    """Move the start of the track ahead along the track; the segment before takes over the length (SCM-3).

    "Segment boundaries can be moved smoothly along the length of the arm" (section 2.2). The subgoal that is held moves
    along with the boundary, so that a fold opens. The part of the arm on the track stays where it is.

    Args:
        world: the world.
        start: the arm, and its length on the track.
        length: distance by which the boundary should move [m].

    Yields:
        Configurations of constant total length.

    Returns:
        The last configuration: the boundary has moved that far, or there is an obstruction.
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
    """Return the arm with the first piece of a track at its tip; the segments before it shorten by its length (SCM-3).

    Raises:
        SchemaStopped: the tip cannot be held.
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
    """Return the position and heading of a segment's end."""
    (position,), (heading,) = Shapes.from_configurations([configuration]).first_segments(segment + 1).tips
    return TipPose(position, float(heading))


def resized(configuration: Configuration, segment: int, length: float) -> Configuration:
    """Return a segment scaled to another length; its curvature scales with 1/length, so that it keeps its shape."""
    return _scaled(configuration, slice(segment, segment + 1), length / configuration.segments[segment].length)


def _scaled(configuration: Configuration, which: slice, scale: float) -> Configuration:
    """Return a range of segments scaled in length and curvature, so that they keep their shape."""
    shapes = Shapes.from_configurations([configuration])
    shapes.lengths[0, which] *= scale
    shapes.curvature[0, which] /= scale
    shapes.moments[0, which] /= scale**3
    return shapes.configuration(0)


def fed(configuration: Configuration, curve: CurvatureSegment, length: float) -> Configuration:
    """Return the arm with its tip segment replaced by the first part of a curve."""
    return add_segment(delete_segment(configuration), segment_head(curve, length))


def _parts(first: float, last: float, stride: float) -> list[float]:
    """Return evenly spaced lengths from ``first`` to ``last``, at most a stride apart [m]."""
    count = max(1, int(np.ceil(abs(last - first) / stride)))
    return [first + (last - first) * k / count for k in range(1, count + 1)]


BENT = (SegmentType.LEFT, SegmentType.RIGHT, SegmentType.LEFT_RIGHT, SegmentType.RIGHT_LEFT)
"""Types that bend."""
_BUMP = np.array([0.0, 1.125, 1.5, 1.125, 0.0])
"""A parabola of mean 1 at even knots: a half wave of curvature."""
_KEPT_LENGTH = (
    Operator.C_B, Operator.C_C, Operator.C_D, Operator.C_E, Operator.S_B, Operator.S_C, Operator.S_D,
)  # fmt: skip
"""Operators that keep a segment's length, and the curvature with which it begins."""


@dataclass(frozen=True)
class Selection:
    """Result of SCM-1 or SCM-4.

    Attributes:
        kind: the type of segment.
        segment: a curve of that type; its heading is the base rotation.
    """

    kind: SegmentType
    segment: CurvatureSegment

    def configuration(self, base: FloatArray) -> Configuration:
        """Return the curve as a configuration of its own, from a base (2,) [m]."""
        return Configuration(base, (self.segment,))


def scm_1(world: World, start: Configuration, goal: TipPose) -> Selection:
    """Return the result of SCM-1: the curvature segment type and the base rotation for SCM-2 or SCM-8.

    The arm does not move. Only base and goal pose are considered (section 2.1). The curve is the natural one of its
    type, aimed at the goal; a base that cannot turn that far is turned as far as it can.

    Args:
        world: the world.
        start: configuration of the arm; only its base, base rotation and length count.
        goal: goal of the tip; no farther from the base than the length.

    Raises:
        SchemaStopped: the goal is out of reach.
    """
    return ranked_selections(world, start, goal)[0]


def ranked_selections(world: World, start: Configuration, goal: TipPose) -> tuple[Selection, ...]:
    """Return the selection of SCM-1 first, then the other bent types, ranked by the heading error of their ends.

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
    # An arm with surplus length cannot reach its goal straight: the bent types come first.
    kinds = (*others, kind) if kind is SegmentType.STRAIGHT and ratio < 1.0 - 1e-3 else (kind, *others)
    return tuple(_select(world, start, goal, k) for k in kinds)


def _heading_error(kind: SegmentType, direction: float, ratio: float, goal: TipPose) -> float:
    """Return the heading error at the goal of a type's natural curve, whose chord has a direction and ratio [rad]."""
    if goal.heading is None:
        return 0.0
    side = -1.0 if kind in {SegmentType.RIGHT, SegmentType.LEFT_RIGHT} else 1.0
    return abs(wrap(direction + side * end_angle(kind, ratio) - goal.heading))


def _select(world: World, start: Configuration, goal: TipPose, kind: SegmentType) -> Selection:
    """Return the natural curve of a type, aimed at the goal as far as the base turns."""
    segment = natural_segment(kind, start.base, goal.position, start.length)
    whole = whole_turns(start.base_heading - segment.heading)
    heading = float(np.clip(segment.heading + whole, *world.base_range))
    return Selection(kind, replace(segment, heading=heading))


def scm_4(world: World, start: Configuration, goal: TipPose, longest: float = np.inf) -> Selection:
    """Return the result of SCM-4: SCM-1 with the optimal segment length to achieve the goal. The arm does not move.

    The segment begins at the tip of the arm, along its heading and without curvature there, as SCM-6 leaves it. The
    type follows from both poses alone. Its first guess is a half wave and a whole wave of curvature that turn as the
    poses require; hill climbing over its interpolation points and its length then meets the goal. The paper does not
    define the optimal length. Here it is the natural one, with which the climb reaches the goal, or the longest
    available where the arm is too short for that.

    Args:
        world: the world.
        start: the arm up to where the segment begins.
        goal: goal of the segment's end.
        longest: largest length of the segment [m].

    Raises:
        SchemaStopped: no such segment is found.
    """
    position, heading = start.tip
    kind = select_segment_type(position, heading, goal.position, goal.heading)
    guess = _first_guess(position, heading, goal, _LEAST_CHORD_RATIO)
    segment = _met(world, start, guess, goal, (*_KEPT_LENGTH, Operator.LENGTH))
    while segment.length > longest:
        length = max(longest, (1.0 - _SHORTENING) * segment.length)
        # Curvature goes with 1/length, so the shorter guess has the shape of the longer segment.
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
    """Return the segment with its end at the goal, found from a guess by hill climbing.

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
    """Return the first guess of a segment, with zero curvature at both ends.

    The segment turns by α to its chord and by β from the chord: a bump of α + β and a wave of (α - β)/2.

    Raises:
        ProblemError: start and goal of the segment coincide.
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
