"""Poses over a whole motion in space, and its pieces."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.planning.curve_map import CurveMap, feed_to_next_stop
from ccm_opt.planning.optimisation.interval_rows import IntervalRows
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.step import SpaceStepper


@dataclass(frozen=True, eq=False)
class SpaceSweep:
    """A motion whose unknowns are linear between K + 1 keyframes.

    Attributes:
        stepper: makes poses, and knows what certifies them.
        unknowns: at the keyframes, shape (K + 1, p).
    """

    stepper: SpaceStepper
    unknowns: FloatArray

    @property
    def curve(self) -> CurveMap:
        """The map of the unknowns."""
        return self.stepper.space

    @property
    def intervals(self) -> int:
        """K."""
        return len(self.unknowns) - 1

    @cached_property
    def poses(self) -> tuple[Pose, ...]:
        """At the keyframes."""
        return self.curve.poses(self.unknowns)

    @cached_property
    def configurations(self) -> FloatArray:
        """At the keyframes, shape (K + 1, c) [rad, m]."""
        return np.stack([pose.q for pose in self.poses])

    @cached_property
    def slopes(self) -> FloatArray:
        """Derivatives of the configurations by the unknowns, shape (K + 1, c, p)."""
        return np.stack([pose.slopes for pose in self.poses])

    @cached_property
    def joints(self) -> FloatArray:
        """Joints and tip at the keyframes, shape (K + 1, links + 1, 3) [m]."""
        return np.stack([pose.points for pose in self.poses])

    @cached_property
    def points(self) -> FloatArray:
        """The same, and last the origin, which stands still, shape (K + 1, links + 2, 3) [m]."""
        return np.pad(self.joints, ((0, 0), (0, 1), (0, 0)))

    @cached_property
    def moving(self) -> FloatArray:
        """Derivatives of the points by the unknowns, shape (K + 1, links + 2, 3, p) [m]."""
        return np.pad(np.stack([pose.moving for pose in self.poses]), ((0, 0), (0, 1), (0, 0), (0, 0)))

    @cached_property
    def turn_metrics(self) -> FloatArray:
        """Squared turns of the links by the unknowns, shape (K + 1, p, p)."""
        turning = np.stack([pose.turning for pose in self.poses]).reshape(len(self.poses), -1, self.moving.shape[3])
        return np.asarray(turning.transpose(0, 2, 1) @ turning)

    def deviation(self, rows: IntervalRows) -> float:
        """Nothing: rows reckon with what they lose halfway."""
        del rows
        return 0.0

    def deviation_slopes(self, rows: IntervalRows) -> float:
        """Nothing: what rows lose halfway counts as constant."""
        del rows
        return 0.0

    def curvature(self, rows: IntervalRows, multipliers: FloatArray, pull: FloatArray) -> None:
        """Nothing: in space second derivatives of the rows tie all links to each other."""
        del rows, multipliers, pull

    @cached_property
    def halfway_off(self) -> FloatArray:
        """How far the points are off the mean of the interval's ends halfway, shape (K, links + 1, 3) [m]."""
        return np.asarray(self.middle_points - 0.5 * (self.joints[:-1] + self.joints[1:]))

    @cached_property
    def middle_points(self) -> FloatArray:
        """Joints and tip halfway through the intervals, shape (K, links + 1, 3) [m]."""
        return self.points_at(0.5)

    def points_at(self, share: float) -> FloatArray:
        """Joints and tip when a share of each interval has passed, shape (K, links + 1, 3) [m]."""
        if share == 1.0:
            return self.joints[1:]
        between = (1.0 - share) * self.unknowns[:-1] + share * self.unknowns[1:]
        return self.curve.arm.joint_positions_at(self.curve.configurations(between))


def pieces(stepper: SpaceStepper, before: FloatArray, after: FloatArray) -> list[FloatArray]:
    """Unknowns along an edge, so near that no joint bends in between while the guide tube of a fed arm holds it."""
    arm = stepper.space.arm
    if not arm.base_axes:
        return [before, after]
    column = stepper.space.feed_column
    scale = float(stepper.space.scale[column])
    start = float(before[column]) * scale
    way = float(after[column]) * scale - start
    share = 0.0
    places = [before]
    while share < 1.0:
        room = feed_to_next_stop(stepper.space, start + share * way, forward=way > 0.0)
        share = 1.0 if abs(way) * (1.0 - share) <= room else share + room / abs(way)
        places.append(before + share * (after - before))
    return places


def edge_is_safe(stepper: SpaceStepper, before: FloatArray, after: FloatArray, depth: int | None = None) -> bool:
    """Whether an edge keeps all limits and is certified."""
    return len(failing_edges(stepper, np.stack((before, after)), depth)) == 0


def failing_edges(stepper: SpaceStepper, unknowns: FloatArray, depth: int | None = None) -> IntArray:
    """Numbers of the edges of a motion, unknowns of shape (K + 1, p), that are not certified."""
    edges = [pieces(stepper, before, after) for before, after in pairwise(unknowns)]
    configurations = stepper.space.configurations(np.array([v for edge in edges for v in edge]))
    kept = [stepper.within_limits(q) for q in configurations]
    failing = []
    first = 0
    for k, edge in enumerate(edges):
        places = range(first, first + len(edge))
        first += len(edge)
        if not all(kept[place] for place in places) or not all(
            stepper.certificate.safe(configurations[place], configurations[place + 1], depth) for place in places[:-1]
        ):
            failing.append(k)
    return np.array(failing, dtype=np.intp)


def in_pieces(stepper: SpaceStepper, unknowns: FloatArray) -> FloatArray:
    """The motion with all its edges in pieces, shape (m, p)."""
    found = [unknowns[0]]
    for before, after in pairwise(unknowns):
        found.extend(pieces(stepper, before, after)[1:])
    return np.stack(found)
