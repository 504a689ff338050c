"""Candidates that draw the arm back along the way it lies, out of a narrow passage into the room about its base.

Where the base stands in a narrow room itself, as in a bottle, no fold has room to open there and to travel out. But
what lies in the passage can be drawn back along itself, as out of a gate, while the rest bows to one side and coils up.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.drawing_back import width_of_fold, widths_beside_arm
from ccm_opt.motion.guide_candidate import GuideCandidate
from ccm_opt.motion.guides.sliding_out import SlidingOut
from ccm_opt.motion.passage_widths import evenly_along
from ccm_opt.motion.pose import Pose
from ccm_opt.motion.sliding import ways_on
from ccm_opt.motion.step import Stepper
from ccm_opt.motion.tip_paths import TipPath


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
