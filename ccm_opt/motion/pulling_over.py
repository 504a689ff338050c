"""Candidates that pull the arm over to its new route as a rope, by a fold that travels from the tip to the base."""

from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import path_length
from ccm_opt.motion.continuation import Guide
from ccm_opt.motion.guide_candidate import GuideCandidate
from ccm_opt.motion.guides.hairpin import Hairpin, fold_track
from ccm_opt.motion.guides.straight_interpolation import Interpolation
from ccm_opt.motion.guides.tip_led import TipLed
from ccm_opt.motion.guides.tip_track import TipTrack
from ccm_opt.motion.passage_widths import passage_widths
from ccm_opt.motion.pose import Pose
from ccm_opt.motion.step import Stepper
from ccm_opt.motion.tip_paths import TipPath


def fitting_folds(stepper: Stepper, path: TipPath) -> tuple[float, ...]:
    """Lengths of the hairpin in nominal links, the one that fits the passage first: width times ``passage_share``."""
    arm = stepper.space.arm
    settings = stepper.settings.guides
    hairpin = settings.hairpin
    widths = passage_widths(stepper.finder.walls, path.taut, arm.length, settings.passages.samples)
    # A fold turns inside the width that the arm's own thickness leaves.
    width = float(np.quantile(widths, hairpin.passage_quantile)) - 2.0 * arm.radius
    wanted = hairpin.passage_share * width / stepper.space.nominal_length
    fitting = float(np.clip(wanted, min(hairpin.lengths), max(hairpin.lengths)))
    others = [length for length in hairpin.lengths if abs(length - fitting) > hairpin.same_length]
    return fitting, *others


def pulled_over(
    stepper: Stepper, start: Pose, whole_arm: FloatArray | None, path: TipPath, lengths: tuple[float, ...]
) -> Iterator[GuideCandidate]:
    """The arm pulled over as a rope, for several lengths of the fold; none when the route is too long for the arm.

    Args:
        stepper: of the link space.
        start: where the motion begins.
        whole_arm: coordinates of a goal for the whole arm, or None.
        path: of the tip.
        lengths: of the hairpin, in nominal links.
    """
    leave = leaving_joint(stepper, start, path)
    if leave is None:
        return
    joint, route = leave
    resume = partial(_pulled_out, stepper, path) if whole_arm is None else partial(_opened, stepper, whole_arm)
    for length in lengths:
        make_guide = partial(fold_about_to_travel, stepper, start, path, joint, route, length)
        yield GuideCandidate(f"hairpin of {length:.2g}, {path.name}", make_guide, (resume,))


def leaving_joint(stepper: Stepper, start: Pose, path: TipPath) -> tuple[int, FloatArray] | None:
    """The joint where the new shape leaves the old one, and the route from there.

    The new shape (old arm up to joint b, then the taut path to the goal) may not be longer than the arm; among those
    the smallest b whose tip path is within one nominal link of the shortest.
    """
    arm = stepper.space.arm

    @cache
    def onward(joint: int) -> float:
        return path_length(path.from_joint(start.points, joint))

    def new_length(joint: int) -> float:
        return joint * arm.link_length + onward(joint)

    def tip_path_length(joint: int) -> float:
        return (arm.links - joint) * arm.link_length + onward(joint)

    longest = stepper.settings.guides.hairpin.longest_shape * arm.length
    if new_length(0) > longest:
        return None
    # Hardly too long: the arm leaves its old shape at the base, and may fit where the path keeps off corners.
    if new_length(0) > arm.length:
        return 0, path.from_joint(start.points, 0)

    # Both lengths grow or fall with the joint, for the path from a joint differs from its neighbour's by at most a
    # link; so bisection finds where they cross a bound, and few taut paths have to be drawn.
    last = _last_true(lambda joint: new_length(joint) <= arm.length, arm.links)
    near_shortest = tip_path_length(last) + stepper.space.nominal_length
    first = last - _last_true(lambda back: tip_path_length(last - back) <= near_shortest, last)
    return first, path.from_joint(start.points, first)


def _last_true(holds: Callable[[int], bool], last: int) -> int:
    """Largest k in [0, last] for which a condition holds that holds at 0 and, once false, stays false."""
    low = 0
    high = last
    while low < high:
        middle = (low + high + 1) // 2
        if holds(middle):
            low = middle
        else:
            high = middle - 1
    return low


def fold_about_to_travel(
    stepper: Stepper, start: Pose, path: TipPath, joint: int, route: FloatArray, length: float
) -> Hairpin:
    """The guide of a fold of some length, in nominal links, that has not begun to travel yet."""
    arm = stepper.space.arm
    fold_length = length * stepper.space.nominal_length
    # The strands lie at least so far apart that the arm keeps its planning margin from itself; a half circle of the
    # fold's length has them further apart.
    strands = max(2.0 * arm.radius + 2.0 * stepper.finder.margin, fold_length / np.pi)
    last_heading = float(start.headings[-1])
    window = heading_window(stepper)
    track, retraced = fold_track(start.points, joint, route, path.side, strands, window, last_heading)
    settings = stepper.settings.guides.hairpin
    return Hairpin(stepper.space, track, retraced, start.headings, fold_length, arm.length, settings)


def _pulled_out(stepper: Stepper, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """The tip drawn along what remains of a hairpin's track, the fold left to itself."""
    if not isinstance(guide, Hairpin):
        raise TypeError(f"only a hairpin can be pulled out, got {type(guide).__name__}")
    track = guide.track
    # The tip may have got ahead of its target or lag behind it: what remains begins beside it.
    rest = track.points[track.arcs > track.nearest_arc(pose.points[-1], guide.tip_arc)]
    remaining = np.vstack((pose.points[-1], rest, path.route[-1]))
    taut = path.free_space.taut_path(remaining, shrink=path.shrink)
    return led_along(stepper, pose, taut)


def _opened(stepper: Stepper, goal: FloatArray, _: Guide, pose: Pose) -> Guide:
    """The fold opened onto a goal of the whole arm: all but the fold lies there already."""
    return Interpolation(stepper.space, pose.v, goal, settings=stepper.settings.guides.interpolation)


def led_along(stepper: Stepper, pose: Pose, taut: FloatArray) -> TipLed:
    """The tip of a pose drawn along a taut path that begins there, shape (k, 2) [m]."""
    track = TipTrack.along(taut, heading_window(stepper), float(pose.headings[-1]))
    return TipLed(stepper.space, track, settings=stepper.settings.guides.tip_led)


def heading_window(stepper: Stepper) -> float:
    """Length over which a track's heading is smoothed [m]."""
    return stepper.settings.guides.heading_window * stepper.space.nominal_length
