"""Arms slid along the way of their tip.

Links are chords of the track, so the arm stays on it however few links it has. Joints that are about to leave the tube,
or have just left it, bend little, as everywhere in planning: they stay near the line of the tube a little longer.

Where no joint is, the joints of one configuration say nothing of the curve. If every configuration were fitted by
itself it would swing there as the joints slide by, which the optimisation would have to take back first. So the curve
is asked to lie still from one configuration to the next beside showing the joints.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.curve_map import SETTLING, CurveMap
from ccm_opt.planning.space_guides import SpaceTipTrack
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import free_shares_of_bends
from ccm_opt.robot.inverse_kinematics import configuration_from_positions

_FINE = 0.02
"""Spacing of places at which the track is looked at for the next joint, in links."""
_AHEAD = 100
"""So many of them are looked at, which is two links: a half circle that a link spans has π / 2."""
_BACK = 40
"""From so many before where a joint would lie on a straight track: in bends links leave out a part of it."""


def slid_along(arm: Arm, track: SpaceTipTrack, feeds: FloatArray) -> FloatArray:
    """Configurations of an arm that is fed along a track, shape (k, c) [rad, m].

    Args:
        arm: on a feed axis, with all joints on the track where its base is at the first of the feeds.
        track: of its tip; it begins at the base there.
        feeds: positions of the base, increasing, shape (k,) [m].
    """
    link = arm.link_length
    spacing = _FINE * link
    ends = track.length + 2.0 * link
    places = _prolonged(track, np.arange(0.0, ends, spacing))
    tube = arm.direction
    points = [arm.base + feeds[:, None] * tube]
    directions = np.broadcast_to(tube, (len(feeds), 3))
    # Where on the track, in places, each joint is at the least.
    first = np.round((feeds - feeds[0]) / spacing).astype(np.intp)
    per_link = round(1.0 / _FINE)
    for joint in range(arm.links):
        free = free_shares_of_bends(arm, feeds + joint * link - arm.hole)[:, None]
        window = np.clip(first[:, None] - _BACK + np.arange(_AHEAD + _BACK), 0, len(places) - 1)
        nearest, chord = _chord(places[window], points[-1], link)
        directions = (1.0 - free) * directions + free * chord
        directions = directions / np.linalg.norm(directions, axis=1)[:, None]
        points.append(points[-1] + link * directions)
        here = window[np.arange(len(feeds)), nearest]
        first = np.where(free[:, 0] > 0.0, here, first) + per_link
    return configuration_from_positions(arm, np.stack(points, axis=1))


def feeds_to_end(arm: Arm, track: SpaceTipTrack, start: float, step: float) -> FloatArray:
    """Positions of the base from the start of a motion to where the tip is nearest to the end of its track, shape (k,).

    Args:
        arm: on a feed axis.
        track: of its tip.
        start: where the base is at first [m].
        step: about how far apart they are [m].
    """
    # Links leave out a part of bends, so the tip is at the end before the base has come as far as the track is long.
    farthest = max(min(start + track.length - track.start, arm.base_range[1]), start)
    before = np.linspace(max(start, farthest - 2.0 * arm.link_length), farthest, 41)
    feeds = np.concatenate(([start], before))
    tips = arm.joint_positions_at(slid_along(arm, track, feeds))[1:, -1]
    last = float(before[np.argmin(np.linalg.norm(tips - track.corners[-1], axis=1))])
    return np.linspace(start, last, max(2, int(np.ceil((last - start) / step)) + 1))


def _chord(window: FloatArray, joints: FloatArray, link: float) -> tuple[FloatArray, FloatArray]:
    """The number of the place nearest to each joint, and the direction to where the track is a link away from it.

    Args:
        window: places of the track in their order, shape (k, m, 3) [m].
        joints: shape (k, 3) [m].
        link: length of a link [m].
    """
    away = np.linalg.norm(window - joints[:, None], axis=2)
    rows = np.arange(len(joints))
    nearest = np.argmin(away[:, :_AHEAD], axis=1)
    behind = np.arange(window.shape[1]) <= nearest[:, None]
    beyond = np.argmax((away >= link) & ~behind, axis=1)
    # Where the track ends too soon, towards its end.
    beyond = np.where(beyond == 0, window.shape[1] - 1, beyond)
    before = beyond - 1
    grown = away[rows, beyond] - away[rows, before]
    share = np.clip((link - away[rows, before]) / np.where(grown > 0.0, grown, 1.0), 0.0, 1.0)[:, None]
    aim = (1.0 - share) * window[rows, before] + share * window[rows, beyond] - joints
    return nearest, aim / np.maximum(np.linalg.norm(aim, axis=1), 1e-12)[:, None]


def _prolonged(track: SpaceTipTrack, arcs: FloatArray) -> FloatArray:
    """Places at arc lengths, straight on beyond the end of the track, shape (m, 3) [m]."""
    last = track.corners[-1] - track.corners[-2]
    last = last / np.linalg.norm(last)
    return np.asarray(track.at(arcs) + np.maximum(arcs - track.length, 0.0)[:, None] * last)


STILL = 1e-3
"""Weight on the squares of changes of the curve's bends, beside those of the joints' turns. Measured on bent ways with
8 to 36 links: the squares of these changes are mostly less than a twentieth of those of fits of each configuration by
itself, and joints are shown as well, to 0.01 rad."""


def fitted_slide(curve: CurveMap, start: FloatArray, configurations: FloatArray) -> FloatArray:
    """Unknowns at configurations of an arm on a feed axis, shape (k, p).

    Args:
        curve: which holds the first of them exactly.
        start: unknowns there, shape (p,).
        configurations: at even steps of the feed, shape (k, c) [rad, m].
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
        # About both axes knots turn the joints alike.
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
