"""Shorter, evener motions: shortcuts by interpolation, then red-black averaging, every pose kept clear."""

from collections.abc import Callable

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.motion.continuation import BENDING, Deadline, Stalled, follow
from ccm_opt.motion.interpolation import Interpolation
from ccm_opt.motion.step import Pose, Stepper, Term

SHORTCUT_LEVELS = 3
SWEEPS = 2
PATIENCE = 10
"""Steps without progress before a shortcut is given up."""
_WORTH = 0.9
"""A shortcut is taken when it shortens the travel at least to this share."""

Certified = Callable[[FloatArray], bool]
"""Whether a piecewise-linear motion of link headings, shape (K, links), is certified."""


def travel(poses: list[Pose]) -> float:
    """Sum over the steps of the largest link turn [rad]: a proxy for the duration."""
    headings = np.array([pose.headings for pose in poses])
    return float(np.abs(np.diff(headings, axis=0)).max(axis=1).sum()) if len(poses) > 1 else 0.0


def shortcut(stepper: Stepper, poses: list[Pose], certified: Certified, deadline: Deadline) -> list[Pose]:
    """Replace stretches by interpolation wherever that is shorter: the whole, then halves, then quarters.

    Args:
        stepper: takes the steps.
        poses: a certified motion.
        certified: judges a candidate.
        deadline: when to stop trying.
    """
    for level in range(SHORTCUT_LEVELS):
        share = 0.5**level
        for start in np.arange(0.0, 1.0 - 0.75 * share, 0.5 * share if level else share):
            places = [_at_travel(poses, start), _at_travel(poses, min(1.0, start + share))]
            direct = _direct(stepper, poses[places[0]], poses[places[1]], deadline)
            old = poses[places[0] : places[1] + 1]
            if direct and travel(direct) < _WORTH * travel(old) and certified(headings_of(direct)):
                poses = poses[: places[0]] + direct + poses[places[1] + 1 :]
            if deadline.passed():
                return poses
    return poses


def average(stepper: Stepper, poses: list[Pose], certified: Certified, deadline: Deadline) -> list[Pose]:
    """Red-black sweeps: each inner pose moves towards the mean of its neighbours, rows kept; certified or undone."""
    for parity in (1, 0) * SWEEPS:
        moved = list(poses)
        for k in range(1 + parity, len(poses) - 1, 2):
            moved[k] = _averaged(stepper, moved[k - 1], moved[k], moved[k + 1])
        if deadline.passed() or not certified(headings_of(moved)):
            return poses
        poses = moved
    return poses


def headings_of(poses: list[Pose]) -> FloatArray:
    """Link headings of a motion, shape (K, links) [rad]."""
    return np.array([pose.headings for pose in poses])


def without_pauses(poses: list[Pose], least: float = 0.02) -> list[Pose]:
    """The motion without poses nearer than ``least`` [rad] to the one before; both ends stay."""
    kept = [poses[0]]
    for pose in poses[1:-1]:
        if np.max(np.abs(pose.headings - kept[-1].headings)) >= least:
            kept.append(pose)
    if len(kept) > 1 and np.max(np.abs(poses[-1].headings - kept[-1].headings)) < least:
        kept.pop()
    return [*kept, poses[-1]]


def _at_travel(poses: list[Pose], share: float) -> int:
    """Index of the pose at a share of the whole travel."""
    turns = np.abs(np.diff(headings_of(poses), axis=0)).max(axis=1)
    covered = np.concatenate(([0.0], np.cumsum(turns)))
    return int(np.argmin(np.abs(covered - share * covered[-1])))


def _direct(stepper: Stepper, start: Pose, end: Pose, deadline: Deadline) -> list[Pose] | None:
    """The interpolation between two poses, ending exactly on the second, or None when it gets stuck."""
    try:
        poses = follow(stepper, Interpolation(stepper.space, start.v, end.v), start, deadline, PATIENCE)
    except Stalled:
        return None
    return [*poses, end]


def _averaged(stepper: Stepper, before: Pose, pose: Pose, after: Pose) -> Pose:
    space = stepper.space
    wanted = 0.5 * (before.headings + after.headings) - pose.headings
    surplus = 0.5 * (before.v + after.v) - pose.v
    terms = [Term(space.matrix, wanted, 1.0), Term(np.eye(len(surplus)), surplus, BENDING)]
    return stepper.step(pose, space.jacobians(pose.headings), terms)
