"""The travelling hairpin: the arm is pulled over to its new route as a rope is, a fold running from tip to base.

The arm ahead of the fold stays on its old shape, a hairpin of some links turns round, the rest follows the track
that leads back along the old arm and on to the goal. The heading reference of every link makes the motion
insensitive to buckling.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.arrays import FloatArray
from ccm_opt.geometry.polyline import arc_lengths
from ccm_opt.motion.guides.track import Track
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.step import Pose, Term

ADVANCE = 0.3
"""Travel of the fold in one step, in nominal links (24 to the arm)."""
LEASH = 2.5
"""How far the tip may lag behind its target before the fold waits, in nominal links."""


@dataclass
class Hairpin:
    """Reference headings and tip targets for one fold.

    Attributes:
        space: the link space.
        track: from the tip back along the arm and on to the goal.
        retraced: arc length on the track beside each joint of the old shape, shape (links + 1,); joints that the
            track does not pass have that of the joint where it leaves.
        old: headings of the old shape, shape (links,) [rad].
        fold_length: length of the hairpin [m].
        fold_at: arc length of the fold on the old shape [m]; runs from L to 0 and on while the fold opens at the base.
    """

    space: LinkSpace
    track: Track
    retraced: FloatArray
    old: FloatArray
    fold_length: float
    fold_at: float

    @property
    def unit(self) -> float:
        """The nominal link [m]."""
        return self.space.unit

    @property
    def tip_arc(self) -> float:
        """Where on the track the tip should be [m]."""
        arm = self.space.arm
        beside = np.interp(self.fold_at, np.arange(arm.links + 1) * arm.link_length, self.retraced)
        return float(beside + arm.length - self.fold_at - self.fold_length)

    def finished(self, pose: Pose) -> bool:
        """Whether the tip's target has reached the end of the track, or the fold has opened at the base."""
        del pose
        return self.tip_arc >= self.track.length or self.fold_at <= -self.fold_length

    def target(self) -> FloatArray:
        """The tip's target, shape (2,) [m]."""
        return self.track.point(self.tip_arc)

    def progress(self, pose: Pose) -> bool:
        """Let the fold travel a little if the tip keeps up."""
        if np.hypot(*(self.target() - pose.points[-1])) > LEASH * self.unit:
            return False
        self.fold_at -= ADVANCE * self.unit
        return True

    def describe(self, pose: Pose) -> str:
        """How far the fold has come."""
        lag = np.hypot(*(self.target() - pose.points[-1]))
        return (
            f"the fold stopped {self.fold_at:.3f} m from the base, "
            f"the tip {1e3 * lag:.0f} mm short of {self.tip_arc:.3f} m on a path of {self.track.length:.3f} m"
        )

    def reference(self) -> FloatArray:
        """Heading every link should have, shape (links,) [rad]."""
        arm = self.space.arm
        middle = arm.link_length * (np.arange(arm.links, dtype=np.float64) + 0.5)
        x = np.clip((middle - self.fold_at) / self.fold_length, 0.0, 1.0)
        blend = x * x * (3.0 - 2.0 * x)
        before = np.interp(np.minimum(middle, self.fold_at), middle, self.old)
        behind = self.track.heading(self.tip_arc - (arm.length - middle))
        reference: FloatArray = (1.0 - blend) * before + blend * behind
        return reference

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """What draws the arm towards the reference."""
        arm, unit = self.space.arm, self.unit
        error = self.target() - pose.points[-1]
        distance = float(np.hypot(*error))
        error *= min(1.0, 1.5 * unit / max(distance, 1e-12))
        share = self.space.share
        middle = (np.arange(arm.links) + 0.5) * arm.link_length
        ahead = np.where(middle < self.fold_at, np.minimum((self.fold_at - middle) / unit, 1.0), 0.0)
        still = np.repeat(ahead * share, 2) * 4.0 + 0.02 * share
        body = jacobians[1:].reshape(2 * arm.links, -1) / unit
        return [
            Term(jacobians[-1] / unit, error / unit, 1.0),
            Term(self.space.matrix, self.reference() - pose.headings, 0.3 * share),
            Term(self.space.matrix, np.zeros(arm.links), 0.002 * share),
            Term(body, np.zeros(len(body)), still),
        ]


def fold_track(
    points: FloatArray, leave: int, route: FloatArray, side: float, offset: float, window: float, last_heading: float
) -> tuple[Track, FloatArray]:
    """The track back along the arm, beside it, and on to the goal.

    Args:
        points: joints of the old shape, shape (links + 1, 2) [m].
        leave: joint where the route leaves the old shape.
        route: from that joint to the goal, shape (k, 2) [m].
        side: +1 folds to the left, -1 to the right.
        offset: distance between the strands [m].
        window: smoothing length of the heading [m].
        last_heading: heading of the old shape's last link [rad].

    Returns:
        The track, and the arc length on it beside every joint, shape (links + 1,).
    """
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    left = np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
    beside = points + side * offset * left
    back = beside[leave:][::-1]
    path = np.vstack((back, _rest_of(route, back[-1], offset) if len(back) > 1 else route))
    track = Track.along(path, window, last_heading + side * np.pi)
    arcs = arc_lengths(back)
    retraced = np.empty(len(points))
    retraced[leave:] = arcs[::-1]
    retraced[:leave] = arcs[-1]
    return track, retraced


def _rest_of(route: FloatArray, place: FloatArray, lead: float) -> FloatArray:
    """The route from a little beyond the point that is nearest to a place, shape (k, 2) [m].

    The strand so joins its route wherever the route's vertices lie.
    """
    line = shapely.LineString(route)
    joined = line.project(shapely.Point(place)) + lead
    arcs = arc_lengths(route)
    rest = route[arcs > joined + 1e-9]
    return np.vstack((line.interpolate(joined).coords[0], rest)) if len(rest) else route[-1:]
