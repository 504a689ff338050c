"""Motions of a fed arm along the track of its tip, and their fit by the unknowns of a curve.

Links are chords of the track, so the joints stay on it however few links the arm has. Only joints near the end of the
guide tube, which may bend little, deviate from it.

Between the joints a configuration does not determine the curve of the arm. If each configuration were fitted
separately, the curve would oscillate there as the joints slide by, and the optimisation would have to remove that. So
the fit also penalises changes of the curve from one configuration to the next.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.planning.curve_map import SETTLING, CurveMap
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.inverse_kinematics import configuration_from_positions
from ccm_opt.robot.tube_exit import bend_shares

_FINE = 0.02
"""Spacing of the samples of the track among which the next joint's position is found, in links."""
_AHEAD = 100
"""Number of samples of the track that are searched for the next joint: two links of track, as an arc that a link spans
is at most a half circle, π / 2 links long."""
_BACK = 40
"""Number of samples by which the search for a joint begins before the sample one link of track after the last joint."""


def slid_along(
    arm: Arm,
    track: ArmTrack,
    feeds: FloatArray,
    shares: Callable[[FloatArray], FloatArray] | None = None,
    most: float | None = None,
) -> FloatArray:
    """Return the configurations of an arm that is fed along a track, shape (k, c) [rad, m].

    A joint near the end of the guide tube may use only a fraction of its largest bend, and turns its link towards the
    track as far as that permits; joints farther out turn the arm back onto the track.

    Args:
        arm: arm on a feed axis; with the base at the first feed, all joints are on the track.
        track: track of the tip, which begins at the base for the first feed.
        feeds: positions of the base, increasing, shape (k,) [m].
        shares: returns the permitted fractions of the largest bend, shape (k,), from a joint's arc lengths beyond the
            tube's end at all feeds, shape (k,) [m]; None for ``bend_shares``.
        most: largest bend of a joint [rad]; None for the joint limit.
    """
    shares = partial(bend_shares, arm) if shares is None else shares
    longest = float(np.max(arm.lengths))
    spacing = _FINE * longest
    ends = track.length + 2.0 * longest
    places = _prolonged(track, np.arange(0.0, ends, spacing))
    tube = arm.direction
    points = [arm.base + feeds[:, None] * tube]
    directions = np.broadcast_to(tube, (len(feeds), 3))
    # Least index on the track of each joint's place.
    first = np.round((feeds - feeds[0]) / spacing).astype(np.intp)
    limits = np.full(arm.links, arm.joint_limit if most is None else most)
    limits *= arm.limit_shares
    for joint, link in enumerate(arm.lengths.tolist()):
        free = shares(feeds + arm.joint_places[joint] - arm.hole)[:, None]
        window = np.clip(first[:, None] - _BACK + np.arange(_AHEAD + _BACK), 0, len(places) - 1)
        nearest, chord = _chord(places[window], points[-1], link)
        directions = _turned(directions, chord, free[:, 0] * limits[joint])
        points.append(points[-1] + link * directions)
        here = window[np.arange(len(feeds)), nearest]
        first = np.where(free[:, 0] > 0.0, here, first) + round(link / spacing)
    return configuration_from_positions(arm, np.stack(points, axis=1))


def _turned(directions: FloatArray, wanted: FloatArray, most: FloatArray) -> FloatArray:
    """Return unit vectors (k, 3) turned towards others (k, 3), each by at most an angle in ``most``, (k,) [rad]."""
    along = np.sum(directions * wanted, axis=1)
    aside = wanted - along[:, None] * directions
    away = np.linalg.norm(aside, axis=1)
    angle = np.minimum(np.arctan2(away, along), most)[:, None]
    return np.asarray(np.cos(angle) * directions + np.sin(angle) * aside / np.maximum(away, TINY)[:, None])


def feeds_to_end(arm: Arm, track: ArmTrack, start: float, step: float) -> FloatArray:
    """Return evenly spaced positions of the base from a start to where the tip is nearest to its track's end, (k,) [m].

    Args:
        arm: arm on a feed axis.
        track: track of the tip.
        start: position of the base at the start of the motion [m].
        step: maximum spacing of the positions [m].
    """
    # Links are chords of bends, so the tip is at the end before the base has advanced by the track's length.
    farthest = max(min(start + track.length - track.start, arm.base_range[1]), start)
    before = np.linspace(max(start, farthest - 2.0 * float(np.max(arm.lengths))), farthest, 41)
    feeds = np.concatenate(([start], before))
    tips = arm.joint_positions_at(slid_along(arm, track, feeds))[1:, -1]
    last = float(before[np.argmin(np.linalg.norm(tips - track.points[-1], axis=1))])
    return np.linspace(start, last, max(2, int(np.ceil((last - start) / step)) + 1))


def _chord(window: FloatArray, joints: FloatArray, link: float) -> tuple[FloatArray, FloatArray]:
    """Return, for k positions of a joint, the nearest track points' indices (k,) and the next link's directions (k, 3).

    The link points to the first track point after the nearest one that is a link length away from the joint.

    Args:
        window: consecutive points of the track for each position, shape (k, m, 3) [m].
        joints: positions of the joint at k feeds, shape (k, 3) [m].
        link: length of a link [m].
    """
    away = np.linalg.norm(window - joints[:, None], axis=2)
    rows = np.arange(len(joints))
    nearest = np.argmin(away[:, :_AHEAD], axis=1)
    behind = np.arange(window.shape[1]) <= nearest[:, None]
    beyond = np.argmax((away >= link) & ~behind, axis=1)
    # Where the track ends too soon, aim at its end.
    beyond = np.where(beyond == 0, window.shape[1] - 1, beyond)
    before = beyond - 1
    grown = away[rows, beyond] - away[rows, before]
    share = np.clip((link - away[rows, before]) / np.where(grown > 0.0, grown, 1.0), 0.0, 1.0)[:, None]
    aim = (1.0 - share) * window[rows, before] + share * window[rows, beyond] - joints
    return nearest, aim / np.maximum(np.linalg.norm(aim, axis=1), 1e-12)[:, None]


def _prolonged(track: ArmTrack, arcs: FloatArray) -> FloatArray:
    """Return the points at arc lengths (m,) [m] of a track extended straight beyond its end, shape (m, 3) [m]."""
    last = track.points[-1] - track.points[-2]
    last = last / np.linalg.norm(last)
    return np.asarray(track.at(arcs) + np.maximum(arcs - track.length, 0.0)[:, None] * last)


STILL = 1e-3
"""Weight of squared changes of the curve's bends, relative to squared errors of joint angles. Measured on bent paths
with 8 to 36 links: the squares of these changes are mostly less than a twentieth of those of separate fits of each
configuration, and joint angles are reproduced as well, to 0.01 rad."""


def fitted_slide(curve: CurveMap, start: FloatArray, configurations: FloatArray) -> FloatArray:
    """Return unknowns fitted to the joint angles of an arm that slides along a track, shape (k, p).

    Args:
        curve: map from unknowns to configurations, exact for the first configuration.
        start: unknowns of the first configuration, shape (p,).
        configurations: configurations at even steps of the feed, shape (k, c) [rad, m].
    """
    links = curve.arm.links
    shown = 2 * curve.knots
    unknowns = np.zeros((len(configurations), curve.dimension))
    unknowns[0] = start
    unknowns[1:, curve.feed_column] = configurations[1:, -1] / curve.scale[curve.feed_column]
    bends = (curve.nominal_length * curve.scale[: curve.knots]) ** 2
    ties = SETTLING * np.diff(np.eye(curve.knots), axis=0)
    blocks = []
    targets = []
    for v, q in zip(unknowns[1:], configurations[1:], strict=True):
        # Knots turn the joints alike about both axes.
        rows = curve.slopes(v)[0 : 2 * links : 2, : curve.knots]
        turns = q[: 2 * links].reshape(links, 2) - curve.offsets(curve.places(float(q[-1])), v)
        blocks.append(rows.T @ rows + ties.T @ ties)
        targets.append(rows.T @ turns)
    targets[0] = targets[0] + STILL * bends[:, None] * start[:shown].reshape(2, curve.knots).T
    count = len(blocks)
    changes = np.eye(count) - np.eye(count, k=-1)
    still = STILL * sp.kron(changes.T @ changes, np.diag(bends))
    found = np.asarray(spsolve(sp.csc_array(sp.block_diag(blocks) + still), np.vstack(targets)))
    unknowns[1:, :shown] = found.reshape(count, curve.knots, 2).transpose(0, 2, 1).reshape(count, shown)
    return unknowns


_PLACED = 2
"""Number of iterations that fit unknowns to joint positions. Measured on bent paths: a third changes nothing."""


def placed_slide(curve: CurveMap, unknowns: FloatArray, configurations: FloatArray) -> FloatArray:
    """Return unknowns of a sliding arm fitted to the positions of the joints, shape (k, p).

    Small errors of many joint angles add up along the arm, so curves that reproduce all joint angles well may still
    miss the end of the track.

    Args:
        curve: map from unknowns to configurations.
        unknowns: unknowns fitted to the joint angles, by ``fitted_slide``, shape (k, p).
        configurations: configurations at even steps of the feed, shape (k, c) [rad, m].
    """
    turns = 2 * curve.arm.links
    shown = 2 * curve.knots
    unit = curve.nominal_length
    unknowns = unknowns.copy()
    wanted = curve.arm.joint_positions_at(configurations[1:])[:, 1:]
    bends = np.tile((unit * curve.scale[: curve.knots]) ** 2, 2)
    uneven = SETTLING * np.diff(np.eye(curve.knots), axis=0)
    ties = np.kron(np.eye(2), uneven.T @ uneven)
    count = len(wanted)
    changes = np.eye(count) - np.eye(count, k=-1)
    still = STILL * sp.kron(changes.T @ changes, np.diag(bends))
    for _ in range(_PLACED):
        blocks = []
        targets = []
        for pose, places, q in zip(curve.poses(unknowns[1:]), wanted, configurations[1:], strict=True):
            rows = np.vstack((pose.moving[1:].reshape(-1, curve.dimension) / unit, pose.slopes[:turns]))[:, :shown]
            missing = np.concatenate(((places - pose.points[1:]).ravel() / unit, (q - pose.q)[:turns]))
            blocks.append(rows.T @ rows + ties)
            targets.append(rows.T @ (missing + rows @ pose.v[:shown]))
        targets[0] = targets[0] + STILL * bends * unknowns[0, :shown]
        found = spsolve(sp.csc_array(sp.block_diag(blocks) + still), np.concatenate(targets))
        unknowns[1:, :shown] = np.asarray(found).reshape(count, shown)
    return unknowns
