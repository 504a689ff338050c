"""The taut path as headings over length, and where it passes from region to region."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import WHOLE_TURN, arc_lengths, leg_headings, legs_at, points_at, without_repeats, wrap
from ccm_opt.ik.configuration_task import ConfigurationTask

_PATH_SAMPLES = 401
"""Samples of the taut path at which its region is looked up. Taste."""


@dataclass(frozen=True)
class PathProfile:
    """The taut path in units of the arm's length, base at the origin.

    Attributes:
        points: shape (k, 2).
        arcs: length up to each point, shape (k,).
        directions: unwrapped heading of each leg, shape (k - 1,) [rad].
        base_heading: heading at the base [rad].
        tip_heading: heading at the tip, whole turns included [rad].
    """

    points: FloatArray
    arcs: FloatArray
    directions: FloatArray
    base_heading: float
    tip_heading: float

    @property
    def end_turns(self) -> float:
        """Total turn at both ends, from base heading to path and from path to tip heading [rad]."""
        return abs(float(self.directions[0]) - self.base_heading) + abs(self.tip_heading - float(self.directions[-1]))

    def direction_at(self, length: FloatArray) -> FloatArray:
        """Unwrapped heading of the path at lengths along it [rad]."""
        return self.directions[legs_at(self.arcs, length)]

    def point_at(self, length: FloatArray) -> FloatArray:
        """Points of the path at lengths along it, shape (m, 2)."""
        return points_at(self.points, self.arcs, length)


def path_profile(task: ConfigurationTask, base_turns: int = 0, tip_turns: int = 0) -> PathProfile:
    """Headings along the task's taut path, unwrapped from base to tip.

    Args:
        task: with the corridor whose route is followed.
        base_turns: whole turns added between the base heading and the path.
        tip_turns: whole turns added between the path and the goal heading.
    """
    points = _taut_points(task)
    directions = leg_headings(points)
    base_heading = _nearest_heading(task.base_heading_range, float(directions[0]))
    first = base_heading + wrap(float(directions[0]) - base_heading) + WHOLE_TURN * base_turns
    # All headings are shifted together, so that turns along the path stay what they are.
    directions += first - directions[0]
    tip = float(directions[-1])
    if task.goal_heading is not None:
        tip += wrap(task.goal_heading - tip) + WHOLE_TURN * tip_turns
    return PathProfile(points, arc_lengths(points), directions, base_heading, tip)


def region_crossings(profile: PathProfile, task: ConfigurationTask) -> FloatArray:
    """Lengths of the taut path at which it passes from region to region, ends included, shape (regions + 1,)."""
    t = np.linspace(0.0, profile.arcs[-1], _PATH_SAMPLES)
    world = profile.point_at(t) * task.length + task.base
    inside = [np.all(world @ region.normals.T <= region.offsets + 1e-9, axis=1) for region in task.corridor.regions]
    crossings = [0.0]
    for here, there in pairwise(inside):
        # Two regions overlap along a stretch of the path: it passes from one to the other in the middle of it.
        both = t[here & there & (t >= crossings[-1])]
        crossings.append(float(both.mean()) if len(both) else crossings[-1])
    return np.append(crossings, profile.arcs[-1])


def _taut_points(task: ConfigurationTask) -> FloatArray:
    """The route's taut string from base to goal without double points, scaled, at least two points."""
    points = (np.vstack((task.base, task.corridor.route.taut[1:-1], task.goal)) - task.base) / task.length
    points = without_repeats(points, 1e-6)
    return points if len(points) > 1 else np.vstack((points, points[0] + np.array([1e-3, 0.0])))


def _nearest_heading(bounds: tuple[float, float], direction: float) -> float:
    """The heading within bounds that is nearest to a direction, whole turns aside."""
    low, high = bounds
    middle = 0.5 * (low + high)
    return float(np.clip(middle + wrap(direction - middle), low, high))
