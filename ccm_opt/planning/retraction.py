"""Candidates that first retract the arm along its own shape.

An arm in a narrow passage can leave it only along its own shape. Since the base is fixed, the retracted length is taken
up by a fold, which opens at the base, where there is clearance, and travels towards the tip. Links that the fold has
passed lie on the new shape; those between the fold and the tip slide back along the old shape. Reversed in time, this
motion is the hairpin that would lead the arm from the new pose into the passage; so a withdrawal uses the reference and
the terms of a hairpin.
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
"""Largest position error of a joint that a step is required to correct, in nominal links; larger ones are corrected
in part. Heuristic."""
_STRAND_WEIGHT = 1.0
"""Weight of the position errors of the joints that slide back along the old shape, per nominal link. Heuristic."""
_HEADING_WEIGHT = 0.3
"""Weight of each link's deviation from the reference heading, per nominal link. Heuristic."""
_TURN_WEIGHT = 0.002
"""Weight of each link's change of heading in a step, per nominal link. Heuristic."""
_MOTION_WEIGHT = 0.02
"""Weight of each joint's displacement in a step, per nominal link. Heuristic."""

_BESIDE = 2.5
"""Distance from the arm below which a point of the tip path counts as next to the arm, in nominal links. Heuristic."""
_LEASH = 0.3
"""Largest mean position error of the joints beyond the fold at which the fold still advances, in nominal links.
Heuristic."""

_LEAST_WAY = 2.0
"""Total length of the tip path that leads beside the arm through passages too narrow for a fold, above which
withdrawals are tried first, in nominal links. Heuristic."""
_NEAR_BASE = 3.0
"""Arc length from the base below which points of the arm do not count as beside the tip path, in nominal links.
Heuristic."""


_ADVANCE = 0.15
"""Travel of the fold in one step, in nominal links. Heuristic."""


@dataclass
class Withdrawal:
    """Guide that retracts the arm by a fold travelling from the joint at which the arm leaves its new shape to the tip.

    Attributes:
        fold: hairpin of the reversed motion; its old shape is the new shape of the withdrawal, and its track leads from
            the tip of that shape back beside the shape, and on to the position of the tip at the start.
        turns: whole turns to add to the base angle of the goal pose [rad].
        free_from: arc length on the track up to which a fold fits beside the arm [m]; once the tip is retracted to
            there, it can be led on to the goal.
    """

    fold: Hairpin
    turns: float = 0.0
    free_from: float = 0.0

    def afresh(self) -> "Withdrawal":
        """Return a copy whose fold starts where the fold is now, and advances independently of the original."""
        return replace(self, fold=replace(self.fold))

    def terms(self, pose: Pose) -> list[Term]:
        """Return the least-squares terms of a QP step: joint positions, reference headings and small motion."""
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
        """Return vectors from the joints beyond the base, and the tip, to their track positions, (links, 2) [m]."""
        arm = self.fold.space.arm
        behind_tip = arm.length - arm.joint_places[1:]
        return self.fold.track.at(self.fold.tip_arc - behind_tip) - pose.points[1:]

    def _on_strand(self) -> FloatArray:
        """Return a weight for each joint beyond the base: 0 if the fold has passed it, 1 if not, (links,).

        The weight rises linearly from 0 to 1 over one nominal link beyond the end of the fold.
        """
        arm = self.fold.space.arm
        arcs = arm.joint_places[1:]
        beyond = (arcs - self.fold.fold_at - self.fold.fold_length) / self.fold.nominal_length
        return np.clip(beyond, 0.0, 1.0)

    def progress(self, pose: Pose) -> bool:
        """Advance the fold towards the tip unless the joints beyond it lag too far behind their positions on the track.

        Returns:
            Whether the fold was advanced.
        """
        if self._lag(pose) > _LEASH * self.fold.nominal_length:
            return False
        self.fold.fold_at += _ADVANCE * self.fold.nominal_length
        return True

    def _lag(self, pose: Pose) -> float:
        """Return the weighted mean distance of the joints beyond the fold from their positions on the track [m]."""
        weight = self._on_strand()
        weight[-1] = 1.0
        return float(np.linalg.norm(self._errors(pose), axis=1) @ weight / weight.sum())

    def finished(self, pose: Pose) -> bool:
        """Return whether the tip has been retracted to ``free_from``, or the fold has reached the tip."""
        del pose  # the next guide opens the fold
        at_tip = self.fold.fold_at + self.fold.fold_length >= self.fold.space.arm.length
        return at_tip or self.fold.tip_arc < self.free_from

    def describe(self, pose: Pose) -> str:
        """Return a message with the position of the fold and the lag of the arm."""
        return (
            f"drawing back, the fold stopped {long_length(self.fold.fold_at)} from where it opened, "
            f"the arm {short_length(self._lag(pose))} behind"
        )

    def onward(self) -> FloatArray:
        """Return the rest of the tip's path, which leads along the new shape to its tip, shape (k, 2) [m]."""
        track = self.fold.track
        return np.asarray(track.points[track.arcs < self.fold.tip_arc][::-1])


WayBack: TypeAlias = tuple[TipPath, tuple[int, FloatArray]]
"""Tip path from the tip of a goal pose to the tip at the start; and a pair: the joint at which the reversed motion
begins to leave the goal pose, and the route from that joint, shape (k, 2) [m]."""


def retraction_candidates(
    stepper: Stepper, start: Pose, wanted: FloatArray, path: TipPath, lengths: tuple[float, ...], *, whole_arm: bool
) -> Iterator[GuideCandidate]:
    """Yield candidates that retract the arm along its own shape and lay it onto a goal pose.

    They differ in the length of the travelling fold and the side of the goal pose on which the fold lies.

    Args:
        stepper: solver of QP steps.
        start: start pose of the motion.
        wanted: coordinates of a goal pose, shape (p,).
        path: any tip path; gives the free space and the distance from corners.
        lengths: lengths of the fold, in nominal links.
        whole_arm: whether the motion has to end in exactly that pose, and not only with the tip at the goal.
    """
    end = stepper.pose(wanted)
    led = partial(_led_out, stepper, path)
    laid = partial(_laid_out, stepper, end)
    ways = ways_back(stepper, start, end, path)
    for length in lengths:
        for name, guide in withdrawals(stepper, start, end, ways, length):
            if whole_arm and guide.turns != 0.0:
                # The arm would end in the right shape, but with the base off by whole turns.
                continue
            yield GuideCandidate(name, guide.afresh, (laid,) if whole_arm else (laid, led))
            if guide.free_from > 0.0:
                wholly = replace(guide, free_from=0.0)
                yield GuideCandidate(f"{name}, wholly", wholly.afresh, (laid,) if whole_arm else (led,))


def ways_back(stepper: Stepper, start: Pose, end: Pose, path: TipPath) -> list[WayBack]:
    """Return tip paths from a goal pose back to the start, each with the joint where the arm leaves that pose.

    Args:
        stepper: solver of QP steps.
        start: start pose of the motion.
        end: the goal pose.
        path: any tip path; gives the free space and the distance from corners.
    """
    ways = tip_paths_in(path.free_space, end.points, (start.points,), path.shrink)
    left = [(way, leaving_joint(stepper, end, way)) for way in ways]
    return [(way, leave) for way, leave in left if leave is not None]


def withdrawals(
    stepper: Stepper, start: Pose, end: Pose, ways: list[WayBack], length: float
) -> list[tuple[str, Withdrawal]]:
    """Return named guides that retract the arm onto a goal pose, the one with the least turn of the base first.

    Args:
        stepper: solver of QP steps.
        start: start pose of the motion.
        end: the goal pose.
        ways: tip paths, each with the joint at which the reversed motion leaves the goal pose, from ``ways_back``.
        length: length of the fold, in nominal links.
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
    """Return whether the arm lies in a passage too narrow for a second strand, or far in ones too narrow for a fold.

    Args:
        stepper: solver of QP steps.
        start: start pose of the motion.
        path: tip path.
    """
    widths = widths_beside_arm(stepper, start, path.taut)
    gate = 4.0 * stepper.space.arm.radius + 2.0 * stepper.finder.margin
    least = _LEAST_WAY * stepper.space.nominal_length
    folded = widths < fold_width(stepper)
    return bool(widths.min(initial=np.inf) < gate or np.mean(folded) * path.length > least)


def fold_width(stepper: Stepper) -> float:
    """Return the minimum width of a passage in which a fold fits [m]."""
    return 2.0 * stepper.space.arm.radius + FOLD_LENGTHS[0] / FOLD_SHARE * stepper.space.nominal_length


def widths_beside_arm(stepper: Stepper, start: Pose, way: FloatArray) -> FloatArray:
    """Return passage widths at points spaced evenly along a tip path, (samples,) [m]; inf at points far from the arm.

    Args:
        stepper: solver of QP steps; gives arm and walls.
        start: pose of the arm.
        way: tip path, shape (k, 2) [m].
    """
    unit = stepper.space.nominal_length
    if path_length(way) <= 0.0:
        return np.full(WIDTH_SAMPLES, np.inf)
    places, _ = evenly_along(way)
    widths = passage_widths(stepper.finder.walls, way, stepper.space.arm.length)
    axis = shapely.LineString(start.points)
    apart = shapely.distance(shapely.points(places), axis)
    # Near the base, the paths of retraction and of advance lie beside the same links.
    beyond_base = shapely.line_locate_point(axis, shapely.points(places)) > _NEAR_BASE * unit
    beside = beyond_base & (apart < np.minimum(widths, _BESIDE * unit))
    return np.where(beside, widths, np.inf)


def withdrawal(stepper: Stepper, start: Pose, end: Pose, way_back: WayBack, length: float) -> Withdrawal | None:
    """Return the guide that retracts the arm onto a goal pose; None if the base would have to turn beyond its limit.

    Args:
        stepper: solver of QP steps.
        start: start pose of the withdrawal.
        end: the goal pose.
        way_back: tip path from that pose to the start, and the joint where the arm leaves the pose, with its route.
        length: length of the fold, in nominal links.
    """
    arm = stepper.space.arm
    way, (joint, route) = way_back
    near_base = _NEAR_BASE * stepper.space.nominal_length
    if arm.joint_places[joint] <= near_base:
        # An arm with surplus length curls round its base; a path from the base itself ignores that curl.
        joint = 0
        route = way.from_joint(end.points, 0)
    fold = fold_about_to_travel(stepper, end, way, joint, route, length)
    fold.run_through()
    # Headings count whole turns, paths do not: the reversed motion has to end with the arm's current winding.
    turns = whole_turns(float(np.median(arm.headings(start.q) - fold.reference())))
    wound = end.q.copy()
    wound[0] += turns
    if abs(wound[0]) > arm.base_limit:
        return None
    fold = fold_about_to_travel(stepper, replace(end, q=wound), way, joint, route, length)
    fold.run_through()
    return Withdrawal(fold, turns, _free_fold_start(stepper, start, fold.track))


def _free_fold_start(stepper: Stepper, start: Pose, track: TipTrack) -> float:
    """Return the arc length on a track, from a goal pose's tip, up to which a fold fits beside the arm [m]."""
    confined = np.flatnonzero(widths_beside_arm(stepper, start, track.points) < fold_width(stepper))
    return track.length * float(confined[0]) / WIDTH_SAMPLES if len(confined) else 0.0


def _led_out(stepper: Stepper, path: TipPath, guide: Guide, pose: Pose) -> Guide:
    """Return the guide that leads the tip along the shortest path to the goal homotopic to the rest of the path.

    Args:
        stepper: solver of QP steps.
        path: tip path; gives the free space and the distance from corners.
        guide: the withdrawal that has ended.
        pose: the pose in which it ended.

    Raises:
        TypeError: the guide is no withdrawal.
    """
    if not isinstance(guide, Withdrawal):
        raise TypeError(f"only a withdrawal can be led out, got {type(guide).__name__}")
    remaining = np.vstack((pose.points[-1], guide.onward()))
    taut = path.free_space.taut_path(remaining, shrink=path.shrink)
    return led_along(stepper, taut)


def _laid_out(stepper: Stepper, end: Pose, guide: Guide, pose: Pose) -> Guide:
    """Return the guide along a straight line in coordinates to the goal pose.

    The whole turns of the preceding withdrawal are added to the base angle of that pose.
    """
    wound = end.v.copy()
    if isinstance(guide, Withdrawal):
        wound[0] += guide.turns
    return PoseLed(stepper.space, pose.v, wound)
