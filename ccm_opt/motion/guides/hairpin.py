"""The travelling hairpin: the arm is pulled over to its new route as a rope is, a fold running from tip to base.

Dragging the tip alone leaves it to buckling where the arm folds. Here every link has a heading reference, so that the
fold is where it should be. Arc length s is counted from the base, L and l are the lengths of the arm and of a link;
link k has its middle at m_k = (k + 1/2) l. The hairpin has length λ and begins at f on the old shape; f falls from L
to 0, and on to -λ while the fold opens at the base.

- *Ahead of the fold*, m_k <= f, the arm stays on its old shape: heading φ_old(m_k).
- *Behind it* the arm lies on a track that leads from the tip back beside the old arm, leaves it where the new route
  does, and goes on to the goal. r(s) is the arc length on the track beside place s of the old shape; it is not
  L - s, for in a bend the strand on the outside is longer. The strand that has turned round is L - f - λ long and
  begins beside the fold, so that the tip's target is at

      u = r(f) + (L - f - λ),

  and link k, which is L - m_k behind the tip, should have the track's heading h(u - (L - m_k)), smoothed over two
  nominal links.
- *In the fold* one heading blends into the other,

      φ_ref,k = (1 - b_k) φ_old(min(m_k, f)) + b_k h(u - (L - m_k)),

  with x_k = clip((m_k - f) / λ, 0, 1) and b_k = x_k² (3 - 2 x_k). The two differ by half a turn, to the left or to
  the right: that is the hairpin.

Each step draws the tip to its target and the links to the reference, and keeps the joints ahead of the fold where they
are. The fold travels on as long as the tip keeps up.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import long_length, short_length
from ccm_opt.ground.polyline import arc_lengths
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.motion.guides.tip_track import TipTrack, shortened
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.pose import Pose, Term
from ccm_opt.motion.settings.guide_settings import DEFAULT_GUIDES, HairpinSettings


@dataclass
class Hairpin:
    """Reference headings and tip targets for one fold.

    Attributes:
        space: the link space.
        track: from the tip back along the arm and on to the goal.
        retraced: r at the joints: arc length on the track beside each joint of the old shape, shape (links + 1,) [m];
            joints that the track does not pass have that of the joint where it leaves.
        old: headings φ_old of the old shape, shape (links,) [rad].
        fold_length: length λ of the hairpin [m].
        fold_at: arc length f of the fold on the old shape [m]; runs from L to 0 and on while it opens at the base.
        settings: advances, leashes and weights.
    """

    space: LinkSpace
    track: TipTrack
    retraced: FloatArray
    old: FloatArray
    fold_length: float
    fold_at: float
    settings: HairpinSettings = DEFAULT_GUIDES.hairpin

    @property
    def nominal_length(self) -> float:
        """The nominal link [m]."""
        return self.space.nominal_length

    @property
    def tip_arc(self) -> float:
        """Where on the track the tip should be, u [m]."""
        arm = self.space.arm
        joints = np.arange(arm.links + 1) * arm.link_length
        # Measured on the track: in a bend the strand on the outside is longer than the arm beside it.
        beside_fold = np.interp(self.fold_at, joints, self.retraced)
        return float(beside_fold + arm.length - self.fold_at - self.fold_length)

    def target(self) -> FloatArray:
        """The tip's target, shape (2,) [m]."""
        return self.track.point(self.tip_arc)

    def reference(self) -> FloatArray:
        """Heading φ_ref that every link should have, shape (links,) [rad]."""
        arm = self.space.arm
        middle = self._middles()
        x = np.clip((middle - self.fold_at) / self.fold_length, 0.0, 1.0)
        blend = x * x * (3.0 - 2.0 * x)
        # Inside the fold the old shape goes on as it is at the fold's beginning.
        on_old_shape = np.interp(np.minimum(middle, self.fold_at), middle, self.old)
        on_track = self.track.heading(self.tip_arc - (arm.length - middle))
        reference: FloatArray = (1.0 - blend) * on_old_shape + blend * on_track
        return reference

    def terms(self, pose: Pose, jacobians: FloatArray) -> list[Term]:
        """What draws the arm towards the reference; the tip's error in nominal links has weight 1."""
        settings = self.settings
        links = self.space.arm.links
        per_link = self.space.nominal_per_link
        turns = self.space.matrix
        tip = jacobians[-1] / self.nominal_length
        joints = jacobians[1:].reshape(2 * links, -1) / self.nominal_length

        error = self.target() - pose.points[-1]
        error = shortened(error, settings.longest_error * self.nominal_length)
        still = settings.still_weight * np.repeat(per_link * self._ahead(), 2) + settings.motion_weight * per_link
        return [
            # The tip goes to its target and every link into its reference heading,
            Term(tip, error / self.nominal_length, 1.0),
            Term(turns, self.reference() - pose.headings, settings.heading_weight * per_link),
            # all with little turning, and joints ahead of the fold stay where they are.
            Term(turns, np.zeros(links), settings.turn_weight * per_link),
            Term(joints, np.zeros(2 * links), still),
        ]

    def _ahead(self) -> FloatArray:
        """How much each link lies ahead of the fold, in [0, 1]: wholly from a nominal link on, shape (links,)."""
        middle = self._middles()
        before_fold = np.minimum((self.fold_at - middle) / self.nominal_length, 1.0)
        return np.where(middle < self.fold_at, before_fold, 0.0)

    def _middles(self) -> FloatArray:
        """Arc lengths m_k of the links' middles, shape (links,) [m]."""
        arm = self.space.arm
        return arm.link_length * (np.arange(arm.links, dtype=np.float64) + 0.5)

    def progress(self, pose: Pose) -> bool:
        """Let the fold travel a little if the tip keeps up."""
        # A fold that left its tip behind would ask for headings that fit no place where the arm can be.
        if self._lag(pose) > self.settings.leash * self.nominal_length:
            return False
        self.fold_at -= self.settings.advance * self.nominal_length
        return True

    def finished(self, pose: Pose) -> bool:
        """Whether the tip's target has reached the end of the track, or the fold has opened at the base."""
        del pose  # the fold's travel alone decides; what the tip lags behind is led on later
        return self.tip_arc >= self.track.length or self.fold_at <= -self.fold_length

    def run_through(self) -> None:
        """Put the fold where the tip's target is at the end of the track, at most where it has opened at the base."""
        arm = self.space.arm
        places = np.linspace(-self.fold_length, arm.length, self.settings.places)
        arcs = np.interp(places, np.arange(arm.links + 1) * arm.link_length, self.retraced) - places
        reached = arcs + arm.length - self.fold_length >= self.track.length
        self.fold_at = float(places[reached].max(initial=-self.fold_length))

    def describe(self, pose: Pose) -> str:
        """How far the fold has come."""
        return (
            f"the fold stopped {long_length(self.fold_at)} from the base, "
            f"the tip {short_length(self._lag(pose))} short of {long_length(self.tip_arc)} "
            f"on a path of {long_length(self.track.length)}"
        )

    def _lag(self, pose: Pose) -> float:
        """Distance of the tip from its target [m]."""
        return float(np.hypot(*(self.target() - pose.points[-1])))


def fold_track(
    points: FloatArray, leave: int, route: FloatArray, side: float, offset: float, window: float, last_heading: float
) -> tuple[TipTrack, FloatArray]:
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
    # The strand that comes back lies beside the old shape, on the side to which the arm folds.
    beside = points + side * offset * left
    back = beside[leave:][::-1]
    onward = _rest_of(route, back[-1], offset) if len(back) > 1 else route
    # The tip turns by half a turn to the fold's side, which fixes the winding of all headings on the track.
    track = TipTrack.along(np.vstack((back, onward)), window, last_heading + side * np.pi)

    # Joints before the one where the route leaves stay, so the strand never passes them.
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
    rest = route[arc_lengths(route) > joined + ROUNDING]
    if len(rest) == 0:
        return route[-1:]
    return np.vstack((line.interpolate(joined).coords[0], rest))
