"""SCM-1 and SCM-4: select the type of a segment, without moving the arm (section 4.2)."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import j0

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.continuum.segment import CurvatureSegment
from ccm_opt.continuum.segment_types import SINE, SegmentType, end_angle, natural_segment, select_segment_type
from ccm_opt.errors import ProblemError
from ccm_opt.ground.angles import heading_of, whole_turns, wrap
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import long_length, short_length
from ccm_opt.hill_climbing.candidate_moves import Shapes
from ccm_opt.hill_climbing.distance import Distance, TipPose
from ccm_opt.hill_climbing.hill_climb import Climb, Ending, end_of
from ccm_opt.hill_climbing.operators import Moves, Operator
from ccm_opt.hill_climbing.steps import SchemaStopped
from ccm_opt.hill_climbing.world import World

BENT = (SegmentType.LEFT, SegmentType.RIGHT, SegmentType.LEFT_RIGHT, SegmentType.RIGHT_LEFT)
"""Types that bend."""
_BUMP = np.array([0.0, 1.125, 1.5, 1.125, 0.0])
"""A parabola of mean 1 at even knots: a half wave of curvature."""
_KEPT_LENGTH = (
    Operator.C_B, Operator.C_C, Operator.C_D, Operator.C_E, Operator.S_B, Operator.S_C, Operator.S_D,
)  # fmt: skip
"""Operators that leave a segment's length alone, and the curvature with which it begins."""


@dataclass(frozen=True)
class Selection:
    """What SCM-1 or SCM-4 selects.

    Attributes:
        kind: the type of segment.
        segment: a curve of that type; its heading is the base rotation.
    """

    kind: SegmentType
    segment: CurvatureSegment

    def configuration(self, base: FloatArray) -> Configuration:
        """The curve alone, from a base (2,) [m]."""
        return Configuration(base, (self.segment,))


def scm_1(world: World, start: Configuration, goal: TipPose) -> Selection:
    """SCM-1: select the curvature segment type and the base rotation for SCM-2 or SCM-8. Does not move the arm.

    Only base and goal pose are looked at (section 2.1). The curve is the natural one of its type, aimed at the goal; a
    base that cannot turn that far takes what it can.

    Args:
        world: the world.
        start: where the arm is; only its base and its length count.
        goal: for the tip; no farther from the base than the length.

    Raises:
        SchemaStopped: the goal is out of reach.
    """
    return ranked_selections(world, start, goal)[0]


def ranked_selections(world: World, start: Configuration, goal: TipPose) -> tuple[Selection, ...]:
    """The selection of SCM-1 first, then the other bent types by how nearly their ends point as the goal does."""
    base_heading = None if world.base_turns else 0.5 * sum(world.base_range)
    kind = select_segment_type(start.base, base_heading, goal.position, goal.heading)
    chord = goal.position - start.base
    direction = heading_of(chord)
    ratio = float(np.hypot(*chord)) / start.length
    if ratio > 1.0:
        reason = f"the goal is {long_length(ratio * start.length)} away, the arm {long_length(start.length)} long"
        raise SchemaStopped("SCM-1", start, reason)
    others = sorted((k for k in BENT if k is not kind), key=lambda k: _heading_miss(k, direction, ratio, goal))
    # An arm with length to spare cannot reach its goal straight: the bent types come first.
    kinds = (*others, kind) if kind is SegmentType.STRAIGHT and ratio < 1.0 - 1e-3 else (kind, *others)
    return tuple(_select(world, start, goal, k) for k in kinds)


def _heading_miss(kind: SegmentType, direction: float, ratio: float, goal: TipPose) -> float:
    """How far from the goal's heading the natural curve of a type ends, whose chord has a direction and ratio [rad]."""
    if goal.heading is None:
        return 0.0
    side = -1.0 if kind in {SegmentType.RIGHT, SegmentType.LEFT_RIGHT} else 1.0
    return abs(wrap(direction + side * end_angle(kind, ratio) - goal.heading))


def _select(world: World, start: Configuration, goal: TipPose, kind: SegmentType) -> Selection:
    """The natural curve of a type, aimed at the goal as far as the base turns."""
    segment = natural_segment(kind, start.base, goal.position, start.length)
    whole = whole_turns(start.base_heading - segment.heading)
    heading = float(np.clip(segment.heading + whole, *world.base_range))
    return Selection(kind, replace(segment, heading=heading))


def scm_4(world: World, start: Configuration, goal: TipPose, longest: float = np.inf) -> Selection:
    """SCM-4: the same as SCM-1, but also determine the optimal segment length to achieve the goal. Moves no arm.

    The segment begins at the tip of the arm, along its heading and without curvature there, as SCM-6 leaves it. The
    type follows from both poses alone. Its first guess is a half wave and a whole wave of curvature that turn as the
    poses ask; hill climbing over its interpolation points and its length then meets the goal. The paper does not say
    what makes a length optimal. Here it is the natural one, with which that climb arrives, or where the arm has not so
    much to give the longest that it has.

    Args:
        world: the world.
        start: the arm up to where the segment begins.
        goal: for the segment's end.
        longest: the segment may be [m].

    Raises:
        SchemaStopped: no such segment is found.
    """
    position, heading = start.tip
    kind = select_segment_type(position, heading, goal.position, goal.heading)
    settings = world.settings.schemas
    guess = _first_guess(position, heading, goal, settings.least_chord_ratio)
    segment = _met(world, start, guess, goal, (*_KEPT_LENGTH, Operator.LENGTH))
    while segment.length > longest:
        length = max(longest, (1.0 - settings.shortening) * segment.length)
        # Curvature goes with 1/length, so the shorter guess has the shape of the longer segment.
        shorter = replace(segment, length=length, curvature=segment.curvature * segment.length / length)
        segment = _met(world, start, shorter, goal, _KEPT_LENGTH)
    alone = Shapes.from_configurations([Configuration(position, (segment,))])
    least = float(world.gap(alone.points(world.settings.crowding.points)).min())
    if least < 0.0:
        raise SchemaStopped("SCM-4", start, f"the segment to the goal would be {short_length(-least)} deep in a wall")
    return Selection(kind, segment)


def _met(
    world: World, start: Configuration, guess: CurvatureSegment, goal: TipPose, operators: tuple[Operator, ...]
) -> CurvatureSegment:
    """The segment that a climb makes of a guess, with its end at the goal.

    Raises:
        SchemaStopped: the climb does not arrive.
    """
    here = Configuration(start.tip[0], (guess,))
    settings = world.settings.schemas
    distance = Distance(goal, guess.length, precision=settings.selected_precision)
    task = Climb(
        distance,
        distance.threshold,
        Moves((0,), operators),
        most_steps=settings.selection_steps,
        push=settings.selection_push,
    )
    here, ending = end_of(replace(world, passes=World().passes), here, task)
    if ending is not Ending.ARRIVED:
        raise SchemaStopped("SCM-4", start, f"no segment of {long_length(guess.length)} to the goal is found: {ending}")
    return here.segments[0]


def _first_guess(position: FloatArray, heading: float, goal: TipPose, least_ratio: float) -> CurvatureSegment:
    """Zero curvature at both ends; turns α to the chord and β from it: a bump of α + β and a wave of (α - β)/2."""
    chord = goal.position - position
    distance = float(np.hypot(*chord))
    if distance == 0.0:
        raise ProblemError("the segment's start and goal are one point; expected a goal elsewhere")
    direction = heading_of(chord)
    alpha = wrap(direction - heading)
    beta = alpha if goal.heading is None else wrap(goal.heading - direction)
    wave = 0.5 * (alpha - beta)
    # The chord ratio of the guess, were bump and wave alone; the waves fold back before J₀ vanishes at 2.405.
    ratio = max(float(j0(min(abs(wave), 2.4)) * np.sinc(0.5 * (alpha + beta) / np.pi)), least_ratio)
    length = distance / ratio
    return CurvatureSegment(length, heading, ((alpha + beta) * _BUMP + 2.0 * np.pi * wave * SINE) / length)
