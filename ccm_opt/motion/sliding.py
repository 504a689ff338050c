"""Candidates that slide the arm out of narrow gates, and go on to the goal from there."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import TypeAlias

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.polyline import arc_lengths
from ccm_opt.motion.continuation import Guide
from ccm_opt.motion.guide_candidate import GuideCandidate
from ccm_opt.motion.guides.sliding_out import SlidingOut
from ccm_opt.motion.guides.straight_interpolation import Interpolation
from ccm_opt.motion.guides.tip_led import TipLed
from ccm_opt.motion.guides.tip_track import TipTrack
from ccm_opt.motion.pose import Pose
from ccm_opt.motion.pulling_over import heading_window
from ccm_opt.motion.step import Stepper
from ccm_opt.motion.tip_paths import TipPath

WayOn: TypeAlias = Callable[[TipPath, Guide, Pose], Guide]
"""Makes the guide that leads on from a pose, along a path of the tip, when another guide has ended there."""


def slid_out(
    stepper: Stepper, start: Pose, whole_arm: FloatArray | None, paths: tuple[TipPath, ...]
) -> Iterator[GuideCandidate]:
    """The arm slid out of the gates in which it lies, to either side; none where it lies in no gate.

    Args:
        stepper: of the link space.
        start: where the motion begins.
        whole_arm: coordinates of a goal for the whole arm, or None.
        paths: of the tip.
    """
    settings = stepper.settings.guides.sliding
    mouths = [(path, mouth_of_gates(stepper, start, path)) for path in paths]
    for onward in ways_on(stepper, whole_arm):
        # What goes straight on from the gates does not ask along which path.
        tried: set[tuple[float, int]] = set()
        for path, mouth in mouths:
            if mouth is None:
                continue
            for side in (path.side, -path.side):
                straight_on = whole_arm is not None and len(onward) == 1
                if straight_on and (round(mouth, 6), side) in tried:
                    continue
                tried.add((round(mouth, 6), side))
                make_guide = partial(SlidingOut, stepper.space, start.points, mouth, side, settings)
                name = f"slid out of gates, bowed to the {'left' if side > 0 else 'right'}"
                resume = tuple(partial(each, path) for each in onward)
                yield GuideCandidate(f"{name}, {path.name}", make_guide, resume)


def ways_on(stepper: Stepper, whole_arm: FloatArray | None) -> list[tuple[WayOn, ...]]:
    """Guides, one after the other, that lead an arm on to its goal when it has come out; the quickest way first."""
    by_tip = partial(_by_tip, stepper)
    if whole_arm is None:
        return [(by_tip,)]
    # Straight on, an arm that has come out may be swept back into the wall that it has come through.
    straight = partial(_straight_on, stepper, whole_arm)
    return [(straight,), (by_tip, straight)]


def mouth_of_gates(stepper: Stepper, start: Pose, path: TipPath) -> float | None:
    """Arc length from the base at which the arm enters the first gate that it lies in [m]; None if it lies in none."""
    axis = shapely.LineString(start.points)
    beside = stepper.settings.guides.sliding.beside * stepper.space.nominal_length
    lain_in = [rail for rail in path.rails if shapely.distance(shapely.Point(rail[len(rail) // 2]), axis) < beside]
    ends = [axis.project(shapely.Point(end)) for rail in lain_in for end in rail[[0, -1]]]
    return min(ends, default=None)


def _straight_on(stepper: Stepper, whole_arm: FloatArray, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """From before the gates straight to a pose of the whole arm."""
    del path
    del guide
    return Interpolation(stepper.space, pose.v, whole_arm, settings=stepper.settings.guides.interpolation)


def _by_tip(stepper: Stepper, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """From before the gates the tip along the rest of its path."""
    del guide
    line = shapely.LineString(path.taut)
    rest = path.taut[arc_lengths(path.taut) > line.project(shapely.Point(pose.points[-1]))]
    taut = path.free_space.taut_path(np.vstack((pose.points[-1], rest)), shrink=path.shrink)
    track = TipTrack.along(taut, heading_window(stepper), float(pose.headings[-1]))
    return TipLed(stepper.space, track, settings=stepper.settings.guides.tip_led)
