"""The candidates: which guide to try on which tip path, in the order that pays."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.geometry.polyline import leg_headings, path_length, without_repeats
from ccm_opt.motion.continuation import Guide
from ccm_opt.motion.guides.hairpin import Hairpin, fold_track
from ccm_opt.motion.guides.straight_interpolation import Interpolation
from ccm_opt.motion.guides.tip_led import TipLed
from ccm_opt.motion.guides.track import Track
from ccm_opt.motion.passage_widths import passage_widths
from ccm_opt.motion.step import Pose, Stepper
from ccm_opt.motion.tip_paths import TipPath

FOLD_LINKS = (5.0, 7.0, 4.0, 9.0)
"""Lengths of the hairpin that are tried, in nominal links (24 to the arm)."""
FOLD_SHARE = 1.18
"""Length of the hairpin that fits a passage, as a share of its width."""
LONGEST_SHAPE = 1.1
"""A taut way from the base may be this share of the arm's length; it cuts no corner, so the arm itself may fit."""
STRAIGHT = 0.02
"""Turn that makes a corner of a path [rad]."""
FEW_CORNERS = 2
"""A route with more corners bends the arm so that straight interpolation seldom works."""
HEADING_WINDOW = 2.0
"""Length over which a track's heading is smoothed, in nominal links."""


@dataclass(frozen=True)
class Candidate:
    """One way to try.

    Attributes:
        name: for messages.
        guide: makes the guide to follow.
        resume: makes the guide that takes over where the first ended or stalled, from that guide and the pose; or None.
    """

    name: str
    guide: Callable[[], Guide]
    resume: Callable[[Guide, Pose], Guide] | None = None


def first_candidates(
    stepper: Stepper,
    start: Pose,
    goal_coordinates: Iterable[FloatArray],
    tip_paths: tuple[TipPath, ...],
    whole_arm: FloatArray | None = None,
) -> Iterator[Candidate]:
    """The candidates that solve most problems, most promising first.

    Args:
        stepper: of the link space they are to run in.
        start: where the motion begins.
        goal_coordinates: of goal poses, for interpolation; unless the tip can go straight, they are asked for when the
            first tip path has failed.
        tip_paths: shortest first.
        whole_arm: coordinates of a goal for the whole arm; a fold that has run to the base is opened onto it.
    """
    interpolated = (
        Candidate(f"interpolation {k + 1}", partial(Interpolation, stepper.space, start.v, goal))
        for k, goal in enumerate(goal_coordinates)
    )
    if whole_arm is not None or goes_straight(tip_paths):
        yield from interpolated
    for path in tip_paths:
        if whole_arm is not None:
            yield from pulled_over(stepper, start, whole_arm, path, fitting_folds(stepper, path)[:1])
        yield tip_led(stepper, start, path)
        if whole_arm is None:
            yield from pulled_over(stepper, start, whole_arm, path, FOLD_LINKS[:1])
            yield from interpolated  # after the first path: a pose at the goal has to be found for it
    yield from interpolated


def goes_straight(tip_paths: tuple[TipPath, ...]) -> bool:
    """Whether the tip's first path is straight and its route has few corners, so that interpolation probably works."""
    return bool(tip_paths) and _corners(tip_paths[0].taut) == 0 and _corners(tip_paths[0].route) <= FEW_CORNERS


def _corners(path: FloatArray) -> int:
    """Number of places where a path (k, 2) turns."""
    turns = np.diff(leg_headings(without_repeats(path, 0.0)))
    return int(np.count_nonzero(np.abs(turns) > STRAIGHT))


def further_candidates(
    stepper: Stepper, start: Pose, tip_paths: tuple[TipPath, ...], whole_arm: FloatArray | None = None
) -> Iterator[Candidate]:
    """Hairpins of other lengths; arguments as for ``first_candidates``."""
    for path in tip_paths:
        folds = FOLD_LINKS if whole_arm is None else fitting_folds(stepper, path)
        yield from pulled_over(stepper, start, whole_arm, path, folds[1:])


def tip_led(stepper: Stepper, start: Pose, path: TipPath) -> Candidate:
    """The tip drawn along the taut path."""
    unit = stepper.space.unit
    track = Track.along(path.taut, HEADING_WINDOW * unit, float(start.headings[-1]))
    return Candidate(f"tip-led, {_side(path)}", partial(TipLed, stepper.space, track))


def fitting_folds(stepper: Stepper, path: TipPath) -> tuple[float, ...]:
    """Lengths of the hairpin, the one that fits the passage first: a turn in width w takes ``FOLD_SHARE`` w."""
    finder, unit = stepper.finder, stepper.space.unit
    widths = passage_widths(finder.walls, path.taut, stepper.space.arm.length)
    width = float(np.quantile(widths, 0.25)) - 2.0 * stepper.space.arm.radius
    fitting = float(np.clip(FOLD_SHARE * width / unit, min(FOLD_LINKS), max(FOLD_LINKS)))
    return fitting, *(links for links in FOLD_LINKS if abs(links - fitting) > 0.5)


def pulled_over(
    stepper: Stepper, start: Pose, whole_arm: FloatArray | None, path: TipPath, folds: tuple[float, ...]
) -> Iterator[Candidate]:
    """The arm pulled over as a rope, for several lengths of the fold; none when the route is too long for the arm."""
    leave = leaving_joint(stepper, start, path)
    if leave is None:
        return
    joint, route = leave
    for links in folds:
        yield Candidate(
            f"hairpin of {links:.2g}, {_side(path)}",
            partial(_fold, stepper, start, path, joint, route, links),
            partial(_pulled_out, stepper, path) if whole_arm is None else partial(_opened, stepper, whole_arm),
        )


def leaving_joint(stepper: Stepper, start: Pose, path: TipPath) -> tuple[int, FloatArray] | None:
    """The joint where the new shape leaves the old one, and the route from there.

    The new shape (old arm up to joint b, then the taut way to the goal) may not be longer than the arm; among those
    the smallest b whose tip path is within one nominal link of the shortest.
    """
    arm = stepper.space.arm

    def new_length(joint: int) -> float:
        return joint * arm.link_length + path_length(path.from_joint(start.points, joint))

    def tip_way(joint: int) -> float:
        return (arm.links - joint) * arm.link_length + path_length(path.from_joint(start.points, joint))

    if new_length(0) > LONGEST_SHAPE * arm.length:
        return None
    if new_length(0) > arm.length:
        return 0, path.from_joint(start.points, 0)
    # Both grow or fall with the joint, for the way from a joint differs from its neighbour's by at most a link.
    last = _last_true(lambda joint: new_length(joint) <= arm.length, arm.links)
    shortest = tip_way(last)
    first = last - _last_true(lambda back: tip_way(last - back) <= shortest + stepper.space.unit, last)
    return first, path.from_joint(start.points, first)


def _last_true(holds: Callable[[int], bool], last: int) -> int:
    """Largest k in [0, last] for which a condition holds that holds at 0 and, once false, stays false."""
    low, high = 0, last
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if holds(middle) else (low, middle - 1)
    return low


def _pulled_out(stepper: Stepper, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """The tip drawn along what remains of a hairpin's track, the fold left to itself."""
    if not isinstance(guide, Hairpin):
        raise TypeError(f"only a hairpin can be pulled out, got {type(guide).__name__}")
    track = guide.track
    rest = track.points[track.arcs > track.nearest_arc(pose.points[-1], guide.tip_arc)]
    way = path.free_space.taut_path(np.vstack((pose.points[-1], rest, path.route[-1])), shrink=path.shrink)
    return TipLed(stepper.space, Track.along(way, HEADING_WINDOW * guide.unit, float(pose.headings[-1])))


def _opened(stepper: Stepper, goal: FloatArray, _: Guide, pose: Pose) -> Guide:
    """The fold opened onto a goal of the whole arm: all but the fold lies there already."""
    return Interpolation(stepper.space, pose.v, goal)


def _fold(stepper: Stepper, start: Pose, path: TipPath, joint: int, route: FloatArray, links: float) -> Hairpin:
    arm, unit = stepper.space.arm, stepper.space.unit
    length = links * unit
    offset = max(2.0 * arm.radius + 2.0 * stepper.finder.margin, length / np.pi)
    last = float(start.headings[-1])
    track, retraced = fold_track(start.points, joint, route, path.side, offset, HEADING_WINDOW * unit, last)
    return Hairpin(stepper.space, track, retraced, start.headings, length, arm.length)


def _side(path: TipPath) -> str:
    return f"{'left' if path.side > 0 else 'right'} of the arm, path of {path.length:.2f} m"
