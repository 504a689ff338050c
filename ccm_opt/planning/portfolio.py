"""The candidates of a search and their order.

Where the base stands in a narrow room itself, as in a bottle, no fold has room to open there and to travel out. But
what lies in the passage can be drawn back along itself, as out of a gate, while the rest bows to one side and coils up.
"""

from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import leg_headings, without_repeats
from ccm_opt.planning.continuation import GuideCandidate
from ccm_opt.planning.guides import Interpolation
from ccm_opt.planning.hairpin import fitting_folds, led_along, pulled_over
from ccm_opt.planning.passage_exit import SlidingOut, slid_out, ways_on
from ccm_opt.planning.passage_widths import evenly_along
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.retraction import drawn_back, lies_confined, width_of_fold, widths_beside_arm
from ccm_opt.planning.settings import DEFAULT_GUIDES, GuideSettings
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.tip_paths import TipPath

_FEW_CORNERS = 2
"""A route with more corners bends the arm so that straight interpolation seldom works. Taste."""


def drawn_in(stepper: Stepper, start: Pose, whole_arm: FloatArray | None, path: TipPath) -> Iterator[GuideCandidate]:
    """The arm drawn back out of the passage that it fills, bowed to either side; none where it fills none.

    Args:
        stepper: of the link space.
        start: where the motion begins.
        whole_arm: coordinates of a goal for the whole arm, or None.
        path: of the tip.
    """
    mouth = mouth_of_passage(stepper, start, path)
    if mouth is None:
        return
    settings = stepper.settings.guides.sliding
    for onward in ways_on(stepper, whole_arm):
        for side in (path.side, -path.side):
            make_guide = partial(SlidingOut, stepper.space, start.points, mouth, side, settings)
            resume = tuple(partial(each, path) for each in onward)
            name = f"drawn in, bowed to the {'left' if side > 0 else 'right'}"
            yield GuideCandidate(f"{name}, {path.name}", make_guide, resume)


def mouth_of_passage(stepper: Stepper, start: Pose, path: TipPath) -> float | None:
    """Arc length from the base at which the arm enters the first passage that it fills [m]; None if it fills none."""
    filled = np.flatnonzero(widths_beside_arm(stepper, start, path.taut) < width_of_fold(stepper))
    if len(filled) == 0:
        return None
    # The tip's way leads back along the arm: what it passes last is nearest to the base.
    places, _ = evenly_along(path.taut, stepper.settings.guides.passages.samples)
    axis = shapely.LineString(start.points)
    return float(shapely.line_locate_point(axis, shapely.points(places[filled])).min())


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
    return straight and _corners(first.route, settings.corner) <= _FEW_CORNERS


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
