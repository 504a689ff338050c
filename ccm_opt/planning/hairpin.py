"""Guide that pulls a planar arm over to a new route by a fold (hairpin) that travels from the tip to the base.

Leading the tip alone leaves it to chance where the arm folds. Here every link has a reference heading, which determines
the position of the fold. Arc length s is counted from the base, L and l are the lengths of the arm and of a link; link
k has its middle at m_k = (k + 1/2) l. The fold has length λ and begins at the arc length f of the arm's initial shape;
f falls from L to 0, and on to -λ while the fold opens at the base.

- *Between base and fold*, m_k <= f, the arm keeps its initial shape: heading φ_old(m_k).
- *Between fold and tip* the arm lies on a track that leads from the initial tip back next to the arm, leaves the arm
  where the new route does, and goes on to the goal. r(s) is the arc length on the track next to the point s of the
  initial shape; it is not L - s, because in a bend the outer strand is longer. The strand that has turned round is
  L - f - λ long and begins next to the fold, so that the target of the tip is at

      u = r(f) + (L - f - λ)

  on the track, and the reference heading of link k, which is L - m_k before the tip, is that of the track,
  h(u - (L - m_k)), smoothed over two nominal links.
- *In the fold* one heading blends into the other,

      φ_ref,k = (1 - b_k) φ_old(min(m_k, f)) + b_k h(u - (L - m_k)),

  with x_k = clip((m_k - f) / λ, 0, 1) and b_k = x_k² (3 - 2 x_k). The two differ by half a turn to the left or right.

Each step pulls the tip to its target and the links to their reference headings, and keeps the joints between base and
fold in place. The fold travels on as long as the tip keeps up with its target.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import shapely

from ccm_opt.core.arrays import ROUNDING, TINY, FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import arc_lengths, leg_headings, path_length, whole_turns
from ccm_opt.planning.continuation import Guide, GuideCandidate
from ccm_opt.planning.guides import PoseLed, TipLed, TipTrack, shortened, tip_path
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.passage_widths import passage_widths
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.tip_paths import TipPath

_LONGEST_ERROR = 1.5
"""Largest error of the tip that a step aims to correct, in nominal links. Heuristic."""
_HEADING_WEIGHT = 0.3
"""Weight of the deviation of every link from its reference heading, per nominal link. Measured."""
_TURN_WEIGHT = 0.002
"""Weight of every link's turn, per nominal link. Measured."""
_MOTION_WEIGHT = 0.02
"""Weight of every joint's displacement, per nominal link. Heuristic."""
_STILL_WEIGHT = 4.0
"""Additional weight of displacements of joints between base and fold, where the arm should not move. Heuristic."""

_PLACES = 400
"""Number of sampled positions of the fold among which the one with the tip's target at the end of the track is found.
Heuristic."""

_PASSAGE_QUANTILE = 0.25
"""Quantile of the widths along a path that counts as the passage's width; the least width may be a corner that is only
touched. Heuristic."""
_SAME_LENGTH = 0.5
"""Difference of the lengths of two folds below which they count as equal, in nominal links. Heuristic."""
_LONGEST_SHAPE = 1.1
"""Maximum length of a new shape, the shortest path from base to goal, as a multiple of the arm's length. Heuristic:
above 1, because the arm may fit where the path, which keeps off corners, seems slightly too long."""


# Measured on OMPL's kinematic chains of 12 to 96 links: a prototype with these numbers solved all fifteen at the first
# attempt, and 150 of 150 from perturbed starts; tests/benchmarks/bench_ompl.py runs them.
FOLD_LENGTHS = (5.0, 7.0, 4.0, 9.0)
"""Lengths of the fold that are tried, in nominal links. Measured: the length that suits a passage lies between the
least and the greatest."""
FOLD_SHARE = 1.18
"""Length of the fold that fits a passage, as a multiple of the passage's width. Measured."""
_ADVANCE = 0.3
"""Travel of the fold in one step, in nominal links. Measured."""
_HEADING_WINDOW = 2.0
"""Length over which the heading of a track is smoothed, in nominal links. Measured."""
_SAMPLES = 8
"""Number of samples of the smoothed heading per smoothing length, between which the heading is linear."""
_LEASH = 2.5
"""Distance of the tip from its target beyond which the fold waits, in nominal links. Measured."""


@dataclass(frozen=True, eq=False)
class FoldTrack(TipTrack):
    """Path of the tip as a polyline, with a smoothed heading for links that lie on the path.

    Attributes:
        sample_arcs: arc lengths of ``sample_headings``, shape (m,) [m].
        sample_headings: unwrapped heading of the path, smoothed over a window, shape (m,) [rad].
    """

    sample_arcs: FloatArray
    sample_headings: FloatArray

    @classmethod
    def smoothed(cls, points: FloatArray, window: float, first_heading: float) -> "FoldTrack":
        """Return a track along a polyline, with its heading smoothed.

        Args:
            points: vertices, shape (k, 2) [m]; repeated points are dropped.
            window: length over which the heading is smoothed [m].
            first_heading: heading from which that of the first leg differs by at most half a turn [rad].
        """
        points = tip_path(points)
        arcs = arc_lengths(points)
        headings = leg_headings(points)
        headings += whole_turns(first_heading - headings[0])
        middles = np.linspace(0.0, arcs[-1], max(2, int(np.ceil(arcs[-1] / window * _SAMPLES))))
        return cls(points, middles, _moving_mean(middles, arcs, headings, window))

    def heading(self, arc: FloatArray | float) -> FloatArray:
        """Return the smoothed heading [rad] at arc lengths [m], in their shape; they are clipped to the ends."""
        return np.asarray(np.interp(arc, self.sample_arcs, self.sample_headings), dtype=np.float64)


def _moving_mean(samples: FloatArray, arcs: FloatArray, headings: FloatArray, window: float) -> FloatArray:
    """Return the exact mean of a polyline's heading over windows of its arc length.

    Beyond both ends the polyline is extrapolated along its first and last leg.

    Args:
        samples: centres of the windows, shape (m,) [m].
        arcs: arc lengths at which the heading changes, both ends included, shape (k,) [m].
        headings: headings between consecutive arc lengths, shape (k - 1,) [rad].
        window: length of a window [m].

    Returns:
        Mean headings, shape (m,) [rad].
    """
    # The integral of the heading is piecewise linear, so interpolation gives it exactly at any arc length.
    primitive = np.concatenate(([0.0], np.cumsum(headings * np.diff(arcs))))
    left = samples - 0.5 * window
    right = samples + 0.5 * window
    to_right = np.interp(np.clip(right, 0.0, arcs[-1]), arcs, primitive)
    to_left = np.interp(np.clip(left, 0.0, arcs[-1]), arcs, primitive)
    inside = to_right - to_left
    # In windows that reach beyond the ends, the track goes straight on.
    before = np.minimum(left, 0.0) * -headings[0]
    behind = np.maximum(right - arcs[-1], 0.0) * headings[-1]
    mean: FloatArray = (inside + (before + behind)) / window
    return mean


@dataclass
class Hairpin:
    """Guide that moves one fold along a planar arm, from the tip to the base, as the module describes.

    Attributes:
        space: map from coordinates to configurations.
        track: track from the initial tip back along the arm and on to the goal.
        retraced: arc length r on the track next to each joint of the initial shape, shape (links + 1,) [m]; joints that
            the track does not pass have the value of the joint where the track leaves the initial shape.
        old: headings φ_old of the initial shape, shape (links,) [rad].
        fold_length: length λ of the fold [m].
        fold_at: arc length f at which the fold begins on the initial shape [m]; decreases from L to 0, and below 0
            while the fold opens at the base.
    """

    space: LinkSpace
    track: FoldTrack
    retraced: FloatArray
    old: FloatArray
    fold_length: float
    fold_at: float

    @property
    def nominal_length(self) -> float:
        """Length of a nominal link [m]."""
        return self.space.nominal_length

    @property
    def tip_arc(self) -> float:
        """Arc length of the tip's target on the track [m]."""
        arm = self.space.arm
        joints = arm.joint_places
        # Measured on the track: in a bend the outer strand is longer than the arm next to it.
        beside_fold = np.interp(self.fold_at, joints, self.retraced)
        return float(beside_fold + arm.length - self.fold_at - self.fold_length)

    def target(self) -> FloatArray:
        """Return the point on the track to which the tip is pulled, shape (2,) [m]."""
        return self.track.at(self.tip_arc)

    def reference(self) -> FloatArray:
        """Return the reference heading of every link for the present position of the fold, shape (links,) [rad]."""
        arm = self.space.arm
        middle = self._middles()
        x = np.clip((middle - self.fold_at) / self.fold_length, 0.0, 1.0)
        blend = x * x * (3.0 - 2.0 * x)
        # Inside the fold the old shape continues with its heading at the fold's beginning.
        on_old_shape = np.interp(np.minimum(middle, self.fold_at), middle, self.old)
        on_track = self.track.heading(self.tip_arc - (arm.length - middle))
        reference: FloatArray = (1.0 - blend) * on_old_shape + blend * on_track
        return reference

    def terms(self, pose: Pose) -> list[Term]:
        """Return the least-squares terms of a QP step that pull the tip to its target and links to their headings.

        The tip's error in nominal links has weight 1.
        """
        links = self.space.arm.links
        per_link = self.space.nominal_per_link
        turns = self.space.turns
        tip = pose.moving[-1] / self.nominal_length
        joints = pose.moving[1:].reshape(2 * links, -1) / self.nominal_length

        error = self.target() - pose.points[-1]
        error = shortened(error, _LONGEST_ERROR * self.nominal_length)
        still = _STILL_WEIGHT * np.repeat(per_link * self._ahead(), 2) + _MOTION_WEIGHT * per_link
        return [
            # The tip goes to its target and every link into its reference heading,
            Term(tip, error / self.nominal_length, 1.0),
            Term(turns, self.reference() - self.space.arm.headings(pose.q), _HEADING_WEIGHT * per_link),
            # all with little turning, and joints between base and fold stay where they are.
            Term(turns, np.zeros(links), _TURN_WEIGHT * per_link),
            Term(joints, np.zeros(2 * links), still),
        ]

    def _ahead(self) -> FloatArray:
        """Return the distance along the arm from each link to the fold, in nominal links, capped at 1, shape (links,).

        It is 0 for links in the fold and beyond.
        """
        middle = self._middles()
        before_fold = np.minimum((self.fold_at - middle) / self.nominal_length, 1.0)
        return np.where(middle < self.fold_at, before_fold, 0.0)

    def _middles(self) -> FloatArray:
        """Return the arc lengths of the links' midpoints from the base, shape (links,) [m]."""
        arm = self.space.arm
        return arm.link_middles

    def progress(self, pose: Pose) -> bool:
        """Move the fold towards the base if the tip is near its target, and return whether the fold was moved."""
        # A fold too far from the tip would demand headings that fit no pose of the arm.
        if self._lag(pose) > _LEASH * self.nominal_length:
            return False
        self.fold_at -= _ADVANCE * self.nominal_length
        return True

    def finished(self, pose: Pose) -> bool:
        """Return whether the tip's target has reached the end of the track, or the fold has opened at the base."""
        del pose  # the travel of the fold alone decides; the next guide leads a tip that lags behind
        return self.tip_arc >= self.track.length or self.fold_at <= -self.fold_length

    def run_through(self) -> None:
        """Move the fold to where the tip's target is at the end of the track, or the fold has opened at the base."""
        arm = self.space.arm
        places = np.linspace(-self.fold_length, arm.length, _PLACES)
        arcs = np.interp(places, arm.joint_places, self.retraced) - places
        reached = arcs + arm.length - self.fold_length >= self.track.length
        self.fold_at = float(places[reached].max(initial=-self.fold_length))

    def describe(self, pose: Pose) -> str:
        """Return a message with the position of the fold and the lag of the tip."""
        return (
            f"the fold stopped {long_length(self.fold_at)} from the base, "
            f"the tip {short_length(self._lag(pose))} short of {long_length(self.tip_arc)} "
            f"on a path of {long_length(self.track.length)}"
        )

    def _lag(self, pose: Pose) -> float:
        """Return the distance of the tip from its target [m]."""
        return float(np.hypot(*(self.target() - pose.points[-1])))


def fold_track(
    points: FloatArray, leave: int, route: FloatArray, side: float, offset: float, window: float, last_heading: float
) -> tuple[FoldTrack, FloatArray]:
    """Return the track that leads the tip back beside the arm's initial shape, then along a route to the goal.

    Args:
        points: joints and tip of the initial shape, shape (links + 1, 2) [m].
        leave: index of the joint at which the route leaves the initial shape.
        route: route from that joint to the goal, shape (k, 2) [m].
        side: +1 folds to the left, -1 to the right.
        offset: distance between the two strands of the fold [m].
        window: length over which the heading is smoothed [m].
        last_heading: heading of the last link of the initial shape [rad].

    Returns:
        The track, and the arc length on the track next to every joint, shape (links + 1,) [m].
    """
    tangent = np.gradient(points, axis=0)
    lengths = np.linalg.norm(tangent, axis=1)[:, None]
    # Where links to a body beside the arm double back, there is no tangent: both strands meet.
    tangent = np.divide(tangent, lengths, out=np.zeros_like(tangent), where=lengths > TINY)
    left = np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
    # The returning strand lies next to the old shape, on the side to which the arm folds.
    beside = points + side * offset * left
    back = beside[leave:][::-1]
    onward = _route_beyond(route, back[-1], offset) if len(back) > 1 else route
    # The tip turns by half a turn to the fold's side, which fixes the winding of all headings on the track.
    track = FoldTrack.smoothed(np.vstack((back, onward)), window, last_heading + side * np.pi)

    # Joints before the one where the route leaves stay in place, so the strand never passes them.
    arcs = arc_lengths(back)
    retraced = np.empty(len(points))
    retraced[leave:] = arcs[::-1]
    retraced[:leave] = arcs[-1]
    return track, retraced


def _route_beyond(route: FloatArray, place: FloatArray, lead: float) -> FloatArray:
    """Return the part of a route that begins a distance ``lead`` beyond its point nearest to a given point, (k, 2) [m].

    So the returning strand joins the route smoothly wherever the vertices of the route lie.
    """
    line = shapely.LineString(route)
    joined = line.project(shapely.Point(place)) + lead
    rest = route[arc_lengths(route) > joined + ROUNDING]
    if len(rest) == 0:
        return route[-1:]
    return np.vstack((line.interpolate(joined).coords[0], rest))


def fitting_folds(stepper: Stepper, path: TipPath) -> tuple[float, ...]:
    """Return the fold lengths to try on a tip path, in nominal links, first the one that fits the passage's width."""
    arm = stepper.space.arm
    widths = passage_widths(stepper.finder.walls, path.taut, arm.length)
    # A fold turns inside the width that remains beyond the arm's own thickness.
    width = float(np.quantile(widths, _PASSAGE_QUANTILE)) - 2.0 * arm.radius
    wanted = FOLD_SHARE * width / stepper.space.nominal_length
    fitting = float(np.clip(wanted, min(FOLD_LENGTHS), max(FOLD_LENGTHS)))
    others = [length for length in FOLD_LENGTHS if abs(length - fitting) > _SAME_LENGTH]
    return fitting, *others


def pulled_over(
    stepper: Stepper, start: Pose, whole_arm: FloatArray | None, path: TipPath, lengths: tuple[float, ...]
) -> Iterator[GuideCandidate]:
    """Yield candidates that lay the arm onto a new route by a fold that travels from tip to base, one per fold length.

    Nothing is yielded if the route is too long for the arm.

    Args:
        stepper: solver of QP steps in the plane.
        start: pose at which the motion begins.
        whole_arm: coordinates of a goal for the whole arm, or None.
        path: tip path, with the route.
        lengths: lengths of the fold, in nominal links.
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
    """Return the joint b at which a new shape of the arm leaves the initial one, and the path from b to the goal.

    The new shape is the initial one up to joint b, then the shortest path in the homotopy class. Of the joints whose
    new shape is no longer than the arm, b is the smallest with a path of the tip within one nominal link of the
    shortest. If every new shape is slightly longer than the arm, b is 0; if all are much longer, the result is None.

    Args:
        stepper: solver of QP steps, for the arm.
        start: pose with the initial shape.
        path: tip path, with the homotopy class.

    Returns:
        The index b, and the path, shape (k, 2) [m].
    """
    arm = stepper.space.arm

    @cache
    def onward(joint: int) -> float:
        return path_length(path.from_joint(start.points, joint))

    def new_length(joint: int) -> float:
        return float(arm.joint_places[joint]) + onward(joint)

    def tip_path_length(joint: int) -> float:
        return float(arm.places_from_tip[joint]) + onward(joint)

    longest = _LONGEST_SHAPE * arm.length
    if new_length(0) > longest:
        return None
    # Only slightly too long: the arm leaves its old shape at the base, and may fit where the path keeps off corners.
    if new_length(0) > arm.length:
        return 0, path.from_joint(start.points, 0)

    # Both lengths are monotonic in the joint, because the path from a joint differs from its neighbour's by at most a
    # link; so bisection finds where they cross a bound, and few taut paths have to be computed.
    last = _last_true(lambda joint: new_length(joint) <= arm.length, arm.links)
    near_shortest = tip_path_length(last) + stepper.space.nominal_length
    first = last - _last_true(lambda back: tip_path_length(last - back) <= near_shortest, last)
    return first, path.from_joint(start.points, first)


def _last_true(holds: Callable[[int], bool], last: int) -> int:
    """Return the largest k in [0, last] for which ``holds`` is true; it is true up to that k and false beyond."""
    return bisect_left(range(1, last + 1), 1, key=lambda k: int(not holds(k)))


def fold_about_to_travel(
    stepper: Stepper, start: Pose, path: TipPath, joint: int, route: FloatArray, length: float
) -> Hairpin:
    """Return a guide with a fold at the tip, before the fold travels to the base.

    Args:
        stepper: solver of QP steps in the plane.
        start: pose at which the motion begins.
        path: tip path, for the side of the fold.
        joint: index of the joint at which the route leaves the initial shape.
        route: route from that joint to the goal, shape (k, 2) [m].
        length: length of the fold, in nominal links.
    """
    arm = stepper.space.arm
    fold_length = length * stepper.space.nominal_length
    # The strands lie at least far enough apart that the arm keeps its planning margin from itself; a half circle of the
    # fold's length has them further apart.
    strands = max(2.0 * arm.radius + 2.0 * stepper.finder.margin, fold_length / np.pi)
    old = arm.headings(start.q)
    window = _HEADING_WINDOW * stepper.space.nominal_length
    track, retraced = fold_track(start.points, joint, route, path.side, strands, window, float(old[-1]))
    return Hairpin(stepper.space, track, retraced, old, fold_length, arm.length)


def _pulled_out(stepper: Stepper, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """Return a guide that leads the tip along the rest of the track of a hairpin, whose fold is no longer controlled.

    Args:
        stepper: solver of QP steps in the plane.
        path: tip path, for its free space and goal.
        guide: the guide with the fold.
        pose: present pose of the arm.
    """
    if not isinstance(guide, Hairpin):
        raise TypeError(f"only a hairpin can be pulled out, got {type(guide).__name__}")
    track = guide.track
    # The tip may be ahead of its target or lag behind it: the rest of the track begins next to the tip.
    rest = track.points[track.arcs > track.nearest_arc(pose.points[-1], guide.tip_arc)]
    remaining = np.vstack((pose.points[-1], rest, path.route[-1]))
    taut = path.free_space.taut_path(remaining, shrink=path.shrink)
    return led_along(stepper, taut)


def _opened(stepper: Stepper, goal: FloatArray, _: Guide, pose: Pose) -> Guide:
    """Return a guide that leads the arm from a pose with a fold to a goal of the whole arm, which opens the fold."""
    return PoseLed(stepper.space, pose.v, goal)


def led_along(stepper: Stepper, taut: FloatArray) -> TipLed:
    """Return a guide that leads the tip along a path that begins at the tip, shape (k, 2) [m]."""
    return TipLed(stepper.space, TipTrack.along(taut))
