"""Motions in space in which a fed arm lies on the path of its tip at all times ("follow the leader").

The tip path is that of the end pose of a motion: along the axis of the guide tube to the first joint that bends, then a
cubic spline through the joints beyond. An arm fed along this path ends in that pose. Each link comes out of the tube
straight and deviates slightly; the joints beyond return to the path, so that the tip stays on the path.

An arm that starts on another path is first retracted along that path, until its part outside the tube lies on both.

As joints bend only after they have left the tube, each begins to bend suddenly, and those beyond compensate. The
accelerations of single joints would then determine the duration of the motion, so the bends are smoothed along the
feed: with the bends q as functions of the feed x and the displacement p of the joints and the tip from the path, across
the links,

    min ∫ |q''|² + w |p|² dx

is solved by the Gauss–Newton method with a banded matrix. Bends at the ends of the motion, and of joints in the tube,
are kept.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded

from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import Diagnosis
from ccm_opt.core.length_words import file_length, short_length
from ccm_opt.core.native import NativeCall
from ccm_opt.core.polyline import arc_lengths
from ccm_opt.planning.curve_map import FEED_A_SPAN
from ccm_opt.planning.followable_ways import slid_along
from ccm_opt.planning.guides import ArmTrack
from ccm_opt.planning.limits.following import FOLLOWING_SHARE, FollowingLimit
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.smooth_path import path_near_configurations
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.planning.spline_path import certified_spare
from ccm_opt.problem.solution import ClearanceLimit, JointPath
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.biarc import bend_shares, free_before, smooth_step
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

_STEP_SHARE = 0.4
"""Maximum feed between two keyframes, as a fraction of the length on which joints stay straight beyond the guide tube,
if a pose bends a joint closer to the tube than usual."""
_LEAST_STEP = 0.03
"""Minimum feed between two keyframes, in nominal links. Heuristic: with less, paths have a thousand keyframes."""
_SAMPLES = 16
"""Number of samples of the path between two joints. Heuristic: chords of a bend of 45 degrees then err by less than a
thousandth of a link."""
_ROUNDING = 1e-2
"""Tolerance of bends between the pose at the end of a path and the arm on the sampled path [rad]."""
_LONGER = 1.35
"""Maximum duration of the motion along the tip's path, as a multiple of that of the optimised motion. Heuristic.
Measured: 1.0 to 1.1 in an elbow, a wing box, a row of blades, pipes and baffles; 1.2 to 1.5 in tours that retract the
arm from each goal."""
_LONGER_WITH_ROOM = 1.75
"""Maximum duration of the motion along the tip's path if it has more clearance, as a multiple of that of the optimised
motion. Heuristic. Measured between ribs: 1.4 times the time for 6 mm instead of 1."""
_GAINED_ROOM = 0.1
"""Gain of clearance, as a fraction of the preferred clearance, from which a motion may take longer. Heuristic."""
_LOST_ROOM = 0.02
"""Loss of clearance, as a fraction of the preferred clearance, at which the motion along the tip's path is still
accepted. Heuristic."""
_WEIGHTS = (1e3, 1e4, np.inf)
"""Weights w on displacements of joints and tip from the path, relative to second derivatives of bends, with lengths in
nominal links; the first that loses no clearance is taken. Measured in a wing box and in a row of blades: with the
first, motions take three quarters and two thirds of their time, and deviate from the tip's path by half a millimetre
more at worst; with a tenth they take another twentieth less, and deviate by up to one and a half millimetres more."""
_SMOOTHINGS = 2
"""Number of Gauss-Newton steps of the smoothing. Heuristic: the second one changes little."""
_MOST_SMOOTHED = 60
"""Number of links above which bends are not smoothed. Measured: with 60 links smoothing takes 0.3 s and gains little,
as short links deviate less from the path."""
_STRAIGHT = 1e-9
"""Bends up to which joints count as straight [rad], and lengths that count as none [arm lengths]."""


@dataclass(frozen=True)
class OwnPath:
    """Path in space, from the end of the guide tube on, on which the joints of a pose lie.

    Attributes:
        arm: arm on a feed axis.
        pose: configuration of the pose, shape (c,) [rad, m].
        straight: length beyond the end of the tube on which the path is the axis of the tube [m].
        points: samples of the path from the end of the straight part on, shape (m, 3) [m].
    """

    arm: Arm
    pose: FloatArray
    straight: float
    points: FloatArray

    @classmethod
    def from_configuration(cls, arm: Arm, q: FloatArray) -> "OwnPath":
        """Return the path through the joints and the tip of a configuration (c,), from the end of the guide tube on."""
        bent = np.flatnonzero(np.any(np.abs(arm.bend_pairs(q)) > _STRAIGHT, axis=1))
        first = int(bent[0]) if len(bent) else arm.links
        nodes = arm.joint_positions_at(q)[first:]
        straight = float(q[-1] + arm.joint_places[first]) - arm.hole
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
        """Return keyframes (K, c) of the arm sliding along the path, from a given feed [m] to that of the pose."""
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


def _smoothed(arm: Arm, slide: FloatArray, weight: float) -> FloatArray:
    """Return keyframes of a fed arm with bends smoothed along the feed, shape (K, c) [rad, m].

    The first and last keyframe are kept, and bends that are zero, as those of joints in the tube are.

    Args:
        arm: arm on a feed axis.
        slide: configurations at even steps of the feed, shape (K, c) [rad, m].
        weight: weight on displacements of the joints across the links; if infinite, the slide is unchanged.
    """
    if weight == np.inf or arm.links > _MOST_SMOOTHED:
        return slide
    bends = slice(0, 2 * arm.links)
    free = slide[:, bends] != 0.0
    free[[0, -1]] = False
    if not np.any(free):
        return slide
    index = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
    width = _bandwidth(index)
    unit = arm.length / NOMINAL_LINKS
    step = (slide[-1, -1] - slide[0, -1]) / unit / (len(slide) - 1)
    place = arm.joint_positions_at(slide)
    smooth = slide.copy()
    for _ in range(_SMOOTHINGS):
        matrix, gradient = np.zeros((np.count_nonzero(free), width + 1)), np.zeros(np.count_nonzero(free))
        NativeCall(
            "smoothing_program", count=len(slide), links=arm.links, width=width, uneven=step**-4, pull=weight / unit**2,
            bends=smooth[:, bends], index=index, points=arm.joint_positions_at(smooth), place=place,
            frames=arm.link_rotations(smooth), base=arm.base_rotation, matrix=matrix, gradient=gradient,
            slopes=np.empty((3, 2 * arm.links)),
        )()  # fmt: skip
        smooth[:, bends][free] -= solveh_banded(matrix.T, gradient, overwrite_ab=True, lower=True)
    return smooth


def _bandwidth(index: IntArray) -> int:
    """Return by how much two free bends that a smoothing program couples differ in their indices at most.

    Args:
        index: index of each bend in K keyframes among the free ones, −1 where it is kept, shape (K, m).
    """
    width = int(np.max(np.count_nonzero(index >= 0, axis=1))) - 1
    for later in (1, 2):
        apart = np.where(index[:-later] >= 0, index[later:] - index[:-later], 0)
        width = max(width, int(np.max(apart, initial=0)))
    return width


def path_behind_tip(task: SpaceTask, motion: SpaceMotion, *, optimised: bool) -> JointPath | None:
    """Return a certified joint path to the end of a motion on which the arm lies on the path of its tip, or None.

    The result is None if there is no such path, or if it costs too much time or clearance. Under a limit on the
    deviation of the arm from the path of its tip, the path is accepted at any cost.

    Args:
        task: task of an arm on a feed axis.
        motion: certified motion.
        optimised: whether the path is compared with the motion; if not, the path has to be preferable to any motion
            between these ends.
    """
    ends = motion.configurations[0], motion.configurations[-1]
    bounded = any(isinstance(limit, FollowingLimit) for limit in task.held)
    if not bounded and _fed_too_far(motion.configurations, task, optimised=optimised):
        return None
    slides = _slides(task.arm, *ends)
    on_path = _joined_slides(task.arm, *ends, slides, np.inf)
    if on_path is None or len(task.certificate.failures(on_path)) > 0:
        return None
    most_lack = np.max(task.clearance_shortfall(on_path)) + _LOST_ROOM * task.wanted_gap
    for weight in _WEIGHTS:
        if weight < np.inf and task.deadline.passed():
            continue
        keyframes = _joined_slides(task.arm, *ends, slides, weight) if weight < np.inf else on_path
        if keyframes is None or (lack := float(np.max(task.clearance_shortfall(keyframes)))) > most_lack:
            continue
        if not bounded and not (_worth(keyframes, lack, motion, task) if optimised else _best(keyframes, task)):
            continue
        path = certified_path(keyframes, f"{motion.candidate}, on the path of the tip", task)
        if path is not None:
            return with_clearance_limit(path, "path of the tip", task)
    return None


def certified_path(keyframes: FloatArray, name: str, task: SpaceTask) -> JointPath | None:
    """Return the smooth path of the given name near keyframes (K, c) between which motions are certified, or None."""
    spline = path_near_configurations(keyframes, task)
    if spline is None or task.violated_place(spline) is not None:
        return None
    keyframes, spline, curves = task.keyframes_along(keyframes, spline, legs=False)
    return JointPath(spline, keyframes, curves, name, spare=certified_spare(spline, task.certificate))


def with_clearance_limit(path: JointPath, limit: ClearanceLimit, task: SpaceTask) -> JointPath:
    """Return a joint path, with the given cause of its small clearance if clearance is lacking on the way."""
    lacks = task.shortfall_on_the_way(path.keyframes) > _GAINED_ROOM * task.wanted_gap
    return replace(path, clearance_limit=limit) if lacks else path


def _best(behind: FloatArray, task: SpaceTask) -> bool:
    """Return whether ``_worth`` would prefer a motion (K, c) to every possible motion between its ends."""
    # No motion has more clearance than its ends, or is faster than its feed.
    roomy = task.shortfall_on_the_way(behind) <= _LOST_ROOM * task.wanted_gap
    return roomy and travel_time(behind, task) <= _LONGER * _fastest(behind, task)


def _worth(behind: FloatArray, lack: float, optimised: SpaceMotion, task: SpaceTask) -> bool:
    """Return whether the motion along the tip's path is preferred to the optimised one.

    The motion along the tip's path may have slightly less clearance, and may take longer if it has more.

    Args:
        behind: keyframes of the motion along the tip's path, shape (K, c).
        lack: its largest shortfall from the preferred clearance [m].
        optimised: the optimised motion.
        task: task with the preferred clearance.
    """
    gained = float(np.max(task.clearance_shortfall(optimised.configurations))) - lack
    roomier = gained > _GAINED_ROOM * task.wanted_gap
    longest = (_LONGER_WITH_ROOM if roomier else _LONGER) * travel_time(optimised.configurations, task)
    return gained >= -_LOST_ROOM * task.wanted_gap and travel_time(behind, task) <= longest


def travel_time(q: FloatArray, task: SpaceTask) -> float:
    """Return a measure of a motion's duration: the turn of the drive that takes longest, summed over intervals [rad].

    Args:
        q: configurations at the keyframes, shape (K, c).
        task: task with the slowness of the drives.
    """
    return float(np.sum(np.max(np.abs(np.diff(q, axis=0)) * task.slowness, axis=1)))


def _fastest(q: FloatArray, task: SpaceTask) -> float:
    """Return a lower bound of ``travel_time`` of all motions between the ends of one (K, c), from their feed [rad]."""
    return float(abs(q[-1, -1] - q[0, -1]) * task.slowness[-1])


def _fed_too_far(q: FloatArray, task: SpaceTask, *, optimised: bool) -> bool:
    """Return whether the feed alone makes the motion along the tip's path too long, so that it is not worth making.

    Args:
        q: keyframes of the motion with which it would be compared, shape (K, c).
        task: task with the slowness of the drives.
        optimised: whether it would be compared with this motion only, not with all between its ends.
    """
    out, inwards, fork = _paths(task.arm, q[0], q[-1])
    fed = (out.feed - fork) + (inwards.feed - fork)
    longest = _LONGER_WITH_ROOM * travel_time(q, task) if optimised else _LONGER * _fastest(q, task)
    return bool(fed * task.slowness[-1] > (1.0 + _STRAIGHT) * longest + _STRAIGHT * task.arm.length)


def keyframes_behind_tip(
    arm: Arm, start: FloatArray, end: FloatArray, weight: float = _WEIGHTS[0]
) -> FloatArray | None:
    """Return keyframes (K, c) of an arm retracted along the start pose's path, then fed along the end pose's path.

    The result is None if the paths do not meet the poses, or each other.

    Args:
        arm: arm on a feed axis.
        start: configuration at the start, shape (c,).
        end: configuration at the end, shape (c,).
        weight: weight on displacements from the paths for the sake of smooth bends; if infinite, bends are not
            smoothed.
    """
    return _joined_slides(arm, start, end, _slides(arm, start, end), weight)


def _slides(arm: Arm, start: FloatArray, end: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the slides (K, c) of an arm out along the start pose's path, to the start, and along that of the end pose.

    Both begin where the tip lies on the axis, which both paths share; either is None if its pose lies there already.
    """
    out, inwards, fork = _paths(arm, start, end)
    least = _STRAIGHT * arm.length
    slides = [path.slide(fork) if path.feed - fork > least else None for path in (out, inwards)]
    return slides[0], slides[1]


def _paths(arm: Arm, start: FloatArray, end: FloatArray) -> tuple[OwnPath, OwnPath, float]:
    """Return the paths of two poses (c,), and the feed at which the tip lies on the axis, which both share [m]."""
    out, inwards = OwnPath.from_configuration(arm, start), OwnPath.from_configuration(arm, end)
    fork = min(out.feed, inwards.feed, min(out.straight, inwards.straight) + arm.hole - arm.length)
    return out, inwards, max(fork, arm.base_range[0])


def _joined_slides(
    arm: Arm, start: FloatArray, end: FloatArray, slides: tuple[FloatArray | None, FloatArray | None], weight: float
) -> FloatArray | None:
    """Return the keyframes of ``keyframes_behind_tip`` from slides that are not yet smoothed."""
    back, onward = (None if slide is None else _smoothed(arm, slide, weight) for slide in slides)
    pieces = ([] if back is None else [back[::-1]]) + ([] if onward is None else [onward])
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
    """Return a diagnosis of why the arm deviates too far from the path of its tip on a motion.

    Args:
        task: task without the limit on the deviation.
        limit: the limit that the motion violates.
        motion: certified motion.
    """
    arm = task.arm
    off = limit.worst_deviation(motion.configurations)
    least = tube_bound(arm, motion.configurations[-1])
    keyframes = keyframes_behind_tip(arm, motion.configurations[0], motion.configurations[-1], np.inf)
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
    """Return a lower bound on the deviation of a pose (c,) from the path of its tip, due to the guide tube [m].

    The tip moves straight until the joint before it has left the tube. Any part of the arm within a link length of the
    end of the tube but off the axis is off the tip's path, unless the tip has returned there.
    """
    joints = arm.joint_positions_at(pose)
    share = np.linspace(0.0, 1.0, _SAMPLES + 1)[:, None]
    places = joints[:-1, None] + share * (joints[1:, None] - joints[:-1, None])
    along = (
        float(pose[-1]) + np.add(arm.joint_places[:-1, None], np.multiply.outer(arm.lengths, share[:, 0])) > arm.hole
    )
    off = places[along] - (arm.base + arm.hole * arm.direction)
    axial = off @ arm.direction
    aside = np.linalg.norm(off - axial[:, None] * arm.direction, axis=1)
    return max(0.0, float(np.max(np.minimum(aside, float(np.min(arm.lengths)) - axial), initial=0.0)))
