"""Candidates that draw the arm back first.

An arm that lies in a narrow place can leave it only as it came: along itself. Its base is fixed, so what comes out must
go somewhere: a fold opens at the base, where there is room, and travels towards the tip. Links that the fold has passed
lie where they are wanted, those ahead of it slide back along the old shape. Run backwards in time this is the hairpin
that would lead the arm in, from the pose that is wanted; so its reference and its terms are the hairpin's.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import long_length, short_length
from ccm_opt.core.polyline import path_length, whole_turns
from ccm_opt.planning.continuation import Guide, GuideCandidate
from ccm_opt.planning.guides import PoseLed, TipTrack
from ccm_opt.planning.hairpin import FOLD_LENGTHS, FOLD_SHARE, Hairpin, fold_about_to_travel, leaving_joint, led_along
from ccm_opt.planning.passage_widths import WIDTH_SAMPLES, evenly_along, passage_widths
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.step import Stepper
from ccm_opt.planning.tip_paths import TipPath, tip_paths_in

_LONGEST_ERROR = 1.0
"""Error of a joint that is asked to be mended in one step, in nominal links. Taste."""
_STRAND_WEIGHT = 1.0
"""Of the joints of the strand that is drawn back, per nominal link. Taste."""
_HEADING_WEIGHT = 0.3
"""Of every link's heading against the reference, per nominal link. Taste."""
_TURN_WEIGHT = 0.002
"""Of every link's turn, per nominal link. Taste."""
_MOTION_WEIGHT = 0.02
"""Of every joint's motion, per nominal link. Taste."""

_BESIDE = 2.5
"""A place of the tip's way that is nearer to the arm than this lies beside it, in nominal links. Taste."""
_LEASH = 0.3
"""How far the strand may lag before the fold waits, in nominal links. Taste."""

_LEAST_WAY = 2.0
"""Of the tip back through passages in which the arm lies and a fold has no room, for drawing back to be tried first, in
nominal links. Taste."""
_NEAR_BASE = 3.0
"""Links nearer to the base along the arm than this do not count, in nominal links. Taste."""


_ADVANCE = 0.15
"""Travel of the fold in one step, in nominal links. Taste."""


@dataclass
class Withdrawal:
    """Leads a fold from where the arm leaves its new shape to the tip.

    Attributes:
        fold: the hairpin of the way in: its old shape is the one wanted here, its track leads from that shape's tip
            back beside it and out to where the tip is when the withdrawal begins.
        turns: whole turns of the base by which the way back winds the pose that is wanted [rad].
        free_from: arc length on the track before which the arm fills no passage [m]: drawn back so far, the tip can go
            on as it likes.
    """

    fold: Hairpin
    turns: float = 0.0
    free_from: float = 0.0

    def afresh(self) -> "Withdrawal":
        """Return the same with its fold where that is now, to be followed on its own."""
        return replace(self, fold=replace(self.fold))

    def terms(self, pose: Pose) -> list[Term]:
        """Return what draws the arm on from a pose."""
        space = self.fold.space
        links = space.arm.links
        per_link = space.nominal_per_link
        turns = space.turns
        unit = space.nominal_length
        joints = pose.moving[1:].reshape(2 * links, -1) / unit

        error = self._errors(pose)
        distance = np.linalg.norm(error, axis=1)
        longest = _LONGEST_ERROR * unit
        error *= (longest / np.maximum(distance, longest))[:, None]
        drawn = _STRAND_WEIGHT * np.repeat(per_link * self._on_strand(), 2)
        return [
            Term(joints, error.ravel() / unit, drawn),
            Term(turns, self.fold.reference() - space.arm.headings(pose.q), _HEADING_WEIGHT * per_link),
            Term(turns, np.zeros(links), _TURN_WEIGHT * per_link),
            Term(joints, np.zeros(2 * links), _MOTION_WEIGHT * per_link),
        ]

    def _errors(self, pose: Pose) -> FloatArray:
        """From every joint but the base to its place on the track, shape (links, 2) [m]."""
        arm = self.fold.space.arm
        behind_tip = arm.length - arm.link_length * np.arange(1, arm.links + 1, dtype=np.float64)
        return self.fold.track.at(self.fold.tip_arc - behind_tip) - pose.points[1:]

    def _on_strand(self) -> FloatArray:
        """How much each joint belongs to the strand that is drawn back: wholly beyond the fold, shape (links,)."""
        arm = self.fold.space.arm
        arcs = arm.link_length * np.arange(1, arm.links + 1)
        beyond = (arcs - self.fold.fold_at - self.fold.fold_length) / self.fold.nominal_length
        return np.clip(beyond, 0.0, 1.0)

    def progress(self, pose: Pose) -> bool:
        """Let the fold travel a little towards the tip if that keeps up."""
        if self._lag(pose) > _LEASH * self.fold.nominal_length:
            return False
        self.fold.fold_at += _ADVANCE * self.fold.nominal_length
        return True

    def _lag(self, pose: Pose) -> float:
        """Return how far the strand is from its track, at the end the tip [m]."""
        weight = self._on_strand()
        weight[-1] = 1.0
        return float(np.linalg.norm(self._errors(pose), axis=1) @ weight / weight.sum())

    def finished(self, pose: Pose) -> bool:
        """Return whether the arm has been drawn back as far as it must, or the fold has reached the tip."""
        del pose  # how the fold opens there is left to what leads the tip on
        at_tip = self.fold.fold_at + self.fold.fold_length >= self.fold.space.arm.length
        return at_tip or self.fold.tip_arc < self.free_from

    def describe(self, pose: Pose) -> str:
        """Return how far the fold has come."""
        return (
            f"drawing back, the fold stopped {long_length(self.fold.fold_at)} from where it opened, "
            f"the arm {short_length(self._lag(pose))} behind"
        )

    def onward(self) -> FloatArray:
        """Return what remains of the tip's way: along the new shape to its tip, shape (k, 2) [m]."""
        track = self.fold.track
        return np.asarray(track.points[track.arcs < self.fold.tip_arc][::-1])


WayBack: TypeAlias = tuple[TipPath, tuple[int, FloatArray]]
"""A way of the tip back to the start, and the joint at which the arm leaves the pose at the goal, with the route."""


def drawn_back(
    stepper: Stepper, start: Pose, wanted: FloatArray, path: TipPath, lengths: tuple[float, ...], *, whole_arm: bool
) -> Iterator[GuideCandidate]:
    """Yield the arm drawn back along itself and laid on another shape, for both sides and several lengths of the fold.

    Args:
        stepper: of the link space.
        start: where the motion begins.
        wanted: coordinates of a pose at the goal.
        path: any of the tip's, for its free space.
        lengths: of the fold, in nominal links.
        whole_arm: whether the motion has to end in that very pose, and not only with its tip.
    """
    end = stepper.pose(wanted)
    led = partial(_led_out, stepper, path)
    laid = partial(_laid_out, stepper, end)
    ways = ways_back(stepper, start, end, path)
    for length in lengths:
        for name, guide in withdrawals(stepper, start, end, ways, length):
            if whole_arm and guide.turns != 0.0:
                # The arm would come to lie where it should, but for whole turns of its base.
                continue
            yield GuideCandidate(name, guide.afresh, (laid,) if whole_arm else (laid, led))
            if guide.free_from > 0.0:
                wholly = replace(guide, free_from=0.0)
                yield GuideCandidate(f"{name}, wholly", wholly.afresh, (laid,) if whole_arm else (led,))


def ways_back(stepper: Stepper, start: Pose, end: Pose, path: TipPath) -> list[WayBack]:
    """Return the ways of the tip from a pose at the goal back to the start, and where the arm leaves that pose on each.

    Args:
        stepper: of the link space.
        start: where the motion begins.
        end: the pose at the goal.
        path: any of the tip's, for its free space.
    """
    ways = tip_paths_in(path.free_space, end.points, (start.points,), path.shrink)
    left = [(way, leaving_joint(stepper, end, way)) for way in ways]
    return [(way, leave) for way, leave in left if leave is not None]


def withdrawals(
    stepper: Stepper, start: Pose, end: Pose, ways: list[WayBack], length: float
) -> list[tuple[str, Withdrawal]]:
    """Return the named ways back to a pose at the goal, on either side, that with the least turn of the base first.

    Args:
        stepper: of the link space.
        start: where the motion begins.
        end: the pose at the goal.
        ways: of the tip, from ``ways_back``.
        length: of the fold, in nominal links.
    """
    base_heading = stepper.space.arm.headings(start.q)[0]
    found = []
    for way, leave in ways:
        guide = withdrawal(stepper, start, end, (way, leave), length)
        if guide is not None:
            side = "left" if way.side > 0 else "right"
            found.append((f"drawn back by a fold of {length:.2g}, {side} of the goal pose", guide))
    return sorted(found, key=lambda named: abs(named[1].fold.old[0] - base_heading))


def lies_confined(stepper: Stepper, start: Pose, path: TipPath) -> bool:
    """Whether the tip's way leads back through a gate beside the arm that is too narrow for it, or far beside the arm.

    Args:
        stepper: of the link space.
        start: where the motion begins.
        path: of the tip.
    """
    widths = widths_beside_arm(stepper, start, path.taut)
    gate = 4.0 * stepper.space.arm.radius + 2.0 * stepper.finder.margin
    least = _LEAST_WAY * stepper.space.nominal_length
    folded = widths < fold_width(stepper)
    return bool(widths.min(initial=np.inf) < gate or np.mean(folded) * path.length > least)


def fold_width(stepper: Stepper) -> float:
    """Return the width of a passage in which a fold has room [m]."""
    return 2.0 * stepper.space.arm.radius + FOLD_LENGTHS[0] / FOLD_SHARE * stepper.space.nominal_length


def widths_beside_arm(stepper: Stepper, start: Pose, way: FloatArray) -> FloatArray:
    """Width of the passage at places evenly along a way of the tip where the arm lies in it, else inf, (samples,) [m].

    Args:
        stepper: of the link space.
        start: the pose that counts.
        way: of the tip, shape (k, 2) [m].
    """
    unit = stepper.space.nominal_length
    if path_length(way) <= 0.0:
        return np.full(WIDTH_SAMPLES, np.inf)
    places, _ = evenly_along(way)
    widths = passage_widths(stepper.finder.walls, way, stepper.space.arm.length)
    axis = shapely.LineString(start.points)
    apart = shapely.distance(shapely.points(places), axis)
    # Near the base the way back and the way on lie beside the same links.
    beyond_base = shapely.line_locate_point(axis, shapely.points(places)) > _NEAR_BASE * unit
    beside = beyond_base & (apart < np.minimum(widths, _BESIDE * unit))
    return np.where(beside, widths, np.inf)


def withdrawal(stepper: Stepper, start: Pose, end: Pose, way_back: WayBack, length: float) -> Withdrawal | None:
    """Return the way in from a pose at the goal, about to be run backwards; None where the base could not turn so far.

    Args:
        stepper: of the link space.
        start: where the withdrawal begins.
        end: the pose at the goal.
        way_back: of the tip from there to the start, and where the arm leaves the pose.
        length: of the fold, in nominal links.
    """
    arm = stepper.space.arm
    way, (joint, route) = way_back
    near_base = _NEAR_BASE * stepper.space.nominal_length
    if joint * arm.link_length <= near_base:
        # An arm with length to spare curls round its base; from the base itself the way on knows nothing of that.
        joint = 0
        route = way.from_joint(end.points, 0)
    fold = fold_about_to_travel(stepper, end, way, joint, route, length)
    fold.run_through()
    # Headings count full turns, paths do not: the way in has to end as the arm is wound now.
    turns = whole_turns(float(np.median(arm.headings(start.q) - fold.reference())))
    wound = end.q.copy()
    wound[0] += turns
    if abs(wound[0]) > arm.base_limit:
        return None
    fold = fold_about_to_travel(stepper, replace(end, q=wound), way, joint, route, length)
    fold.run_through()
    return Withdrawal(fold, turns, _free_fold_start(stepper, start, fold.track))


def _free_fold_start(stepper: Stepper, start: Pose, track: TipTrack) -> float:
    """Arc length on a track from a goal pose's tip to the start's before which a fold has room beside the arm [m]."""
    confined = np.flatnonzero(widths_beside_arm(stepper, start, track.points) < fold_width(stepper))
    return track.length * float(confined[0]) / WIDTH_SAMPLES if len(confined) else 0.0


def _led_out(stepper: Stepper, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """Return the tip drawn along what remains of its way to the goal."""
    if not isinstance(guide, Withdrawal):
        raise TypeError(f"only a withdrawal can be led out, got {type(guide).__name__}")
    remaining = np.vstack((pose.points[-1], guide.onward()))
    taut = path.free_space.taut_path(remaining, shrink=path.shrink)
    return led_along(stepper, taut)


def _laid_out(stepper: Stepper, end: Pose, guide: Guide, pose: Pose) -> Guide:
    """Return the whole arm drawn straight to the pose at the goal, wound as the withdrawal leads to it."""
    wound = end.v.copy()
    if isinstance(guide, Withdrawal):
        wound[0] += guide.turns
    return PoseLed(stepper.space, pose.v, wound)
