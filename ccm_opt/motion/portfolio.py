"""The candidates: which guide to try on which tip path, in the order that pays."""

from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import leg_headings, without_repeats
from ccm_opt.motion.drawing_back import drawn_back, lies_confined
from ccm_opt.motion.guide_candidate import GuideCandidate
from ccm_opt.motion.guides.straight_interpolation import Interpolation
from ccm_opt.motion.pose import Pose
from ccm_opt.motion.pulling_over import fitting_folds, led_along, pulled_over
from ccm_opt.motion.settings.guide_settings import DEFAULT_GUIDES, GuideSettings
from ccm_opt.motion.sliding import slid_out
from ccm_opt.motion.step import Stepper
from ccm_opt.motion.tip_paths import TipPath
from ccm_opt.motion.unwinding import drawn_in


def first_candidates(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    whole_arm: FloatArray | None = None,
) -> Iterator[GuideCandidate]:
    """The candidates that solve most problems, most promising first.

    Args:
        stepper: of the link space they are to run in.
        start: where the motion begins.
        goal_coordinates: of goal poses, for interpolation; unless the tip can go straight, they are asked for when the
            first tip path has failed.
        tip_paths: shortest first.
        whole_arm: coordinates of a goal for the whole arm; a fold that has run to the base is opened onto it.
    """
    # In a gate with hardly any play nothing else moves an arm.
    yield from slid_out(stepper, start, whole_arm, tip_paths)

    # Poses at the goal are dear among many walls, and often there are none along the routes; a tip is led in no time.
    led_first = whole_arm is None and stepper.among_many_walls
    if led_first:
        yield from (tip_led(stepper, start, path) for path in sorted(tip_paths, key=lambda path: path.length))

    interpolated = _interpolations(stepper, start, goal_coordinates)
    if whole_arm is not None or goes_straight(tip_paths, stepper.settings.guides):
        yield from interpolated

    first_length = stepper.settings.guides.hairpin.lengths[:1]
    withdrawn = _withdrawn(stepper, start, goal_coordinates, tip_paths, first_length, whole_arm=whole_arm is not None)
    # Out of a narrow place the arm comes only as it came in, and a tip that is drawn back alone buckles it.
    if tip_paths and lies_confined(stepper, start, tip_paths[0]):
        yield from withdrawn
        yield from drawn_in(stepper, start, whole_arm, tip_paths[0])

    for path in tip_paths:
        # A fold lays the arm on its new route link by link, where a goal of the whole arm wants it; a tip alone can
        # mostly be led there.
        if whole_arm is not None:
            fitting = fitting_folds(stepper, path)
            yield from pulled_over(stepper, start, whole_arm, path, fitting[:1])
            yield tip_led(stepper, start, path)
        else:
            if not led_first:
                yield tip_led(stepper, start, path)
            yield from pulled_over(stepper, start, whole_arm, path, first_length)
            # Not before, for a pose at the goal has to be found by the NLP first. The first path uses them all up.
            yield from interpolated

    yield from interpolated
    yield from withdrawn


def _interpolations(stepper: Stepper, start: Pose, goal_coordinates: Iterable[FloatArray]) -> Iterator[GuideCandidate]:
    """Straight to one pose at the goal after the other; each is made when it is asked for."""
    settings = stepper.settings.guides.interpolation
    for k, goal in enumerate(goal_coordinates, start=1):
        make_guide = partial(Interpolation, stepper.space, start.v, goal, settings=settings)
        yield GuideCandidate(f"interpolation {k}", make_guide)


def _withdrawn(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    lengths: tuple[float, ...],
    *,
    whole_arm: bool,
) -> Iterator[GuideCandidate]:
    """Drawn back along itself onto one pose at the goal after the other; each is made when it is asked for."""
    for path in tip_paths[:1]:
        for goal in goal_coordinates:
            yield from drawn_back(stepper, start, goal, path, lengths, whole_arm=whole_arm)


def goes_straight(tip_paths: tuple[TipPath, ...], settings: GuideSettings = DEFAULT_GUIDES) -> bool:
    """Whether the tip's first path is straight and its route has few corners, so that interpolation probably works."""
    if not tip_paths:
        return False
    first = tip_paths[0]
    straight = _corners(first.taut, settings.corner) == 0
    return straight and _corners(first.route, settings.corner) <= settings.few_corners


def _corners(path: FloatArray, least_turn: float) -> int:
    """Number of places where a path (k, 2) turns by more than ``least_turn`` [rad]."""
    turns = np.diff(leg_headings(without_repeats(path, 0.0)))
    return int(np.count_nonzero(np.abs(turns) > least_turn))


def further_candidates(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    whole_arm: FloatArray | None = None,
) -> Iterator[GuideCandidate]:
    """Folds of other lengths, back and forth; arguments as for ``first_candidates``."""
    others = stepper.settings.guides.hairpin.lengths[1:]
    yield from _withdrawn(stepper, start, goal_coordinates, tip_paths, others, whole_arm=whole_arm is not None)
    for path in tip_paths:
        lengths = stepper.settings.guides.hairpin.lengths
        if whole_arm is not None:
            lengths = fitting_folds(stepper, path)
        yield from pulled_over(stepper, start, whole_arm, path, lengths[1:])


def tip_led(stepper: Stepper, start: Pose, path: TipPath) -> GuideCandidate:
    """The tip drawn along the taut path."""
    return GuideCandidate(f"tip-led, {path.name}", partial(led_along, stepper, start, path.taut))
