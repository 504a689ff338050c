"""Motions in space in which a fed arm lies on the path of its tip at all times.

The path is that of the pose in which a motion ends: along the axis of the guide tube to the first joint that bends, and
a cubic spline through the joints beyond. An arm fed along it ends in that pose. The next link comes out of the tube
straight and leaves the path a little; the joints beyond lead back onto it, so that the tip stays on its path.

An arm that starts on another path is first drawn back along that path, until its part outside the tube lies on both
paths.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis
from ccm_opt.core.length_words import file_length, short_length
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.planning.curve_map import FEED_A_SPAN
from ccm_opt.planning.followable_ways import slid_along
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.planning.limits.following import FOLLOWING_SHARE, FollowingLimit
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.smooth_path import path_near_configurations
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.spline_path import certified_spare
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import bend_shares, free_before, smooth_step
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_STEP_SHARE = 0.4
"""Most feed between two keyframes as a share of the length on which joints stay straight beyond the guide tube, where a
pose bends a joint closer to the tube than usual."""
_LEAST_STEP = 0.03
"""Least feed between two keyframes [u]. Taste: with less, paths have a thousand keyframes."""
_SAMPLES = 16
"""Samples of the path between two joints. Taste: chords of a bend of 45 degrees then err by less than a thousandth of a
link."""
_ROUNDING = 1e-2
"""Most that the arm on its path may differ from the pose at its end [rad]: what sampled chords leave."""
_LONGER = 1.35
"""Most time that the slowest drives may take behind the tip, as a multiple of what they take in the optimised motion.
Taste. Measured: 1.0 to 1.1 in an elbow, a wing box, a row of blades, pipes and baffles; 1.2 to 1.5 where a tour draws
the arm back from each goal."""
_LONGER_WITH_ROOM = 1.75
"""The same where that gains room, a tenth of the wanted gap or more. Taste. Measured between ribs: 1.4 times the time
for 6 mm instead of 1."""
_AS_FAST = 1.05
"""The same as a multiple of the time that the feed takes, below which nothing is gained by optimisation. Taste."""
_GAINED_ROOM = 0.1
"""Share of the wanted gap that counts as room gained. Taste."""
_LOST_ROOM = 0.02
"""Share of the wanted gap by which the motion behind the tip may lack more clearance. Taste."""
_STRAIGHT = 1e-9
"""Bends up to which joints count as straight [rad], and lengths that count as none [arm lengths]."""


@dataclass(frozen=True)
class OwnPath:
    """The path on which a pose lies, beyond the hole.

    Attributes:
        arm: arm on a feed axis.
        pose: configuration, shape (c,).
        straight: length beyond the hole on which the path is the axis of the guide tube [m].
        points: samples of the path from there on, shape (m, 3) [m].
    """

    arm: Arm
    pose: FloatArray
    straight: float
    points: FloatArray

    @classmethod
    def of(cls, arm: Arm, q: FloatArray) -> "OwnPath":
        """Return the path of a configuration, shape (c,)."""
        bent = np.flatnonzero(np.any(np.abs(arm.bend_pairs(q)) > _STRAIGHT, axis=1))
        first = int(bent[0]) if len(bent) else arm.links
        nodes = arm.joint_positions_at(q)[first:]
        straight = float(q[-1]) + first * arm.link_length - arm.hole
        if len(nodes) == 1:
            return cls(arm, q, straight, nodes)
        arcs = arc_lengths(nodes)
        curve = CubicSpline(arcs, nodes, bc_type=((1, arm.direction), (2, np.zeros(3))))
        places = np.interp(np.arange(_SAMPLES * (len(arcs) - 1) + 1) / _SAMPLES, np.arange(len(arcs)), arcs)
        return cls(arm, q, straight, np.asarray(curve(places)))

    @property
    def feed(self) -> float:
        """Feed of the pose [m]."""
        return float(self.pose[-1])

    def slide(self, first: float) -> FloatArray:
        """Return keyframes, shape (K, c), of the arm on the path, from the feed ``first`` [m] to the pose."""
        arm = self.arm
        bends = self.straight > 0.0
        before = min(free_before(arm), 0.5 * self.straight) if bends else free_before(arm)
        unit = arm.length / NOMINAL_LINKS
        step = max(min(FEED_A_SPAN * unit, _STEP_SHARE * before), _LEAST_STEP * unit)
        feeds = np.linspace(first, self.feed, max(2, int(np.ceil((self.feed - first) / step)) + 1))

        def shares(places: FloatArray) -> FloatArray:
            # In the pose the first joint that bends does so fully.
            anywhere = bend_shares(arm, places)
            return np.maximum(anywhere, smooth_step(places, before, self.straight)) if bends else anywhere

        track = ArmTrack.behind((arm.base + first * arm.direction)[None], self.points)
        most = max(arm.joint_limit, float(np.max(np.linalg.norm(arm.bend_pairs(self.pose), axis=1))))
        slid = slid_along(arm, track, feeds, shares, most)
        # The guide tube accepts exactly straight joints only.
        return np.where(np.abs(slid) < _STRAIGHT, 0.0, slid)


def path_behind_tip(task: SpaceTask, motion: SpaceMotion, *, optimised: bool) -> JointPath | None:
    """Return the certified path to the end of a motion on which the arm lies on the path of its tip.

    None where there is no such path, or where it costs too much time and clearance. Under a limit on how far the arm
    may leave the path of its tip, it is accepted at any cost.

    Args:
        task: task of an arm on a feed axis.
        motion: certified motion.
        optimised: whether the path is compared with the motion; if not, the path has to be as fast as the feed allows,
            with all of the preferred clearance.
    """
    keyframes = keyframes_behind_tip(task.arm, motion.configurations[0], motion.configurations[-1])
    if keyframes is None:
        return None
    bounded = any(isinstance(limit, FollowingLimit) for limit in task.held)
    if not (bounded or (_worth(keyframes, motion.configurations, task) if optimised else _best(keyframes, task))):
        return None
    spline = path_near_configurations(keyframes, task)
    if spline is None or task.violated_place(spline) is not None:
        return None
    keyframes, spline, curves = task.keyframes_along(keyframes, spline, legs=False)
    name = f"{motion.candidate}, on the path of the tip"
    return JointPath(spline, keyframes, curves, name, spare=certified_spare(spline, task.certificate))


def _best(behind: FloatArray, task: SpaceTask) -> bool:
    """Return whether no motion between the ends of ``behind`` (K, c) can be much faster or have more clearance."""
    lacking = task.room_lacking(behind)
    fastest = abs(behind[-1, -1] - behind[0, -1]) * task.slowness[-1]
    roomy = np.max(lacking) - np.max(lacking[[0, -1]]) <= _LOST_ROOM * task.wanted_gap
    return bool(roomy) and _time(behind, task) <= _AS_FAST * fastest


def _worth(behind: FloatArray, optimised: FloatArray, task: SpaceTask) -> bool:
    """Return whether to prefer the motion behind the tip to the optimised one; both have shape (K, c).

    The motion behind the tip may lose a little clearance, and may take longer where it gains clearance.
    """
    gained = np.max(task.room_lacking(optimised)) - np.max(task.room_lacking(behind))
    roomier = gained > _GAINED_ROOM * task.wanted_gap
    longest = (_LONGER_WITH_ROOM if roomier else _LONGER) * _time(optimised, task)
    return bool(gained >= -_LOST_ROOM * task.wanted_gap) and _time(behind, task) <= longest


def _time(q: FloatArray, task: SpaceTask) -> float:
    """Return the sum, over the steps between configurations (K, c), of the slowest drive's turn [rad]."""
    return float(np.sum(np.max(np.abs(np.diff(q, axis=0)) * task.slowness, axis=1)))


def keyframes_behind_tip(arm: Arm, start: FloatArray, end: FloatArray) -> FloatArray | None:
    """Return keyframes on the paths of two poses, back along the first and in along the second, shape (K, c).

    None where the paths do not meet these poses, or each other.

    Args:
        arm: arm on a feed axis.
        start: configuration at the start, shape (c,).
        end: configuration at the end, shape (c,).
    """
    out, inwards = OwnPath.of(arm, start), OwnPath.of(arm, end)
    # Where the tip lies on the axis, which both paths share.
    fork = min(out.feed, inwards.feed, min(out.straight, inwards.straight) + arm.hole - arm.length)
    fork = max(fork, arm.base_range[0])
    pieces = []
    if out.feed - fork > _STRAIGHT * arm.length:
        pieces.append(out.slide(fork)[::-1])
    if inwards.feed - fork > _STRAIGHT * arm.length:
        pieces.append(inwards.slide(fork))
    if not pieces:
        return None
    whole = np.clip(np.concatenate(pieces), arm.lower_limits, arm.upper_limits)
    if len(pieces) == 2:
        first = len(pieces[0])
        if np.max(np.abs(whole[first] - whole[first - 1])) > _ROUNDING:
            return None
        whole = np.delete(whole, first, axis=0)
    if np.max(np.abs(whole[[0, -1]] - np.stack((start, end)))) > _ROUNDING:
        return None
    whole[0], whole[-1] = start, end
    return whole


def not_behind_tip(task: SpaceTask, limit: FollowingLimit, motion: SpaceMotion) -> Diagnosis:
    """Return the diagnosis, with the cause, of a motion on which the arm leaves the path of its tip too far.

    Args:
        task: task without the limit.
        limit: the limit that the motion violates.
        motion: certified motion.
    """
    arm = task.arm
    off = limit.worst_deviation(motion.configurations)
    least = tube_bound(arm, motion.configurations[-1])
    keyframes = keyframes_behind_tip(arm, motion.configurations[0], motion.configurations[-1])
    if keyframes is None:
        why = "the feed axis is too short to draw the arm back to where it lies on the path to the goal"
        advice = ("a longer arm.feed.range",)
    elif len(failing := task.certificate.failures(keyframes)):
        points = arm.joint_positions_at(keyframes[failing[0]])
        near = task.tree.nearest(np.stack((points[:-1], points[1:]), axis=1), 2.0 * arm.length)
        owner = int(near.owner[np.argmin(near.gap)])
        why = f"on the path of the pose at the goal it would touch '{task.names[owner]}'" if owner >= 0 else ""
        why = why or "on the path of the pose at the goal its links would touch each other"
        advice = ("move the goal, or add goal.via places on the way",)
    else:
        behind = limit.worst_deviation(keyframes)
        off = min(off, behind)
        why = f"on the path of the pose at the goal it leaves it by {short_length(behind)}"
        advice = (f"planner.follow_within of at least {file_length(1.01 * behind / FOLLOWING_SHARE, 3)}",)
    if least > 0.0:
        why += f"; the tube's straight links allow no less than {short_length(least)}"
    reason = (
        f"a motion was found, but the arm leaves the path of its tip by {short_length(off)}, "
        f"{short_length(off - FOLLOWING_SHARE * limit.within)} too far for planner.follow_within; {why}"
    )
    return Diagnosis(reason, "motion", advice, {"leader_deviation_m": off, "tube_bound_m": least})


def tube_bound(arm: Arm, pose: FloatArray) -> float:
    """Return a lower bound on how far a pose (c,) leaves the path of its tip, as links in the tube are straight [m].

    The tip goes straight on until the joint behind it has left the tube. Any part of the arm that lies within a link
    length of the hole but off the axis is off that path, unless the tip came back there.
    """
    joints = arm.joint_positions_at(pose)
    share = np.linspace(0.0, 1.0, _SAMPLES + 1)[:, None]
    places = joints[:-1, None] + share * (joints[1:, None] - joints[:-1, None])
    along = float(pose[-1]) + arm.link_length * np.add.outer(np.arange(arm.links), share[:, 0]) > arm.hole
    off = places[along] - (arm.base + arm.hole * arm.direction)
    axial = off @ arm.direction
    aside = np.linalg.norm(off - axial[:, None] * arm.direction, axis=1)
    return max(0.0, float(np.max(np.minimum(aside, arm.link_length - axial), initial=0.0)))
