"""Motions in space, each of which fails one check of the verifier, and motions that pass all checks."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.driver.metrics import leader_deviation
from ccm_opt.problem import (
    Coverage,
    JointPose,
    LookAt,
    PlannerOptions,
    Problem,
    SimulationOptions,
    Stop,
    TipGoal,
    Tolerances,
)
from ccm_opt.problem.solution import JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.coordinates import DriveLimits, Limits, PointLimit
from ccm_opt.scene.bodies import BOX_FACES, BoxBody, MeshBody, SphereBody, box_corners
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.chain_motion import LinkFrames
from tests.space_arms import space_arm
from tests.space_plans import SpacePlan, places_of, with_body

from .cases import FULL, WEIGHTLESS, peak, quintic

LINKS = 6
SHARE = 0.9
Mutation = Callable[[], SpacePlan]


def bends(first: float, second: float = 0.0) -> FloatArray:
    """Return equal pairs of bend angles for all joints, shape (2 LINKS,) [rad]."""
    return np.tile([first, second], LINKS)


def between(start: FloatArray, end: FloatArray, arm: Arm) -> SpacePlan:
    """Return a straight motion in joint space in an empty room, from a start to a goal configuration."""
    time, *parts = quintic(start, end)
    trajectory = JointTrajectory(time, *parts, arm.coordinates)
    one = np.ones(3 * LINKS)
    on_axis = {"feed_velocity": 0.25, "feed_acceleration": 0.5, "feed_force": 20.0} if arm.feed else {}
    each = np.ones(len(arm.carrier))
    axes = DriveLimits(1.0 * each, 0.5 * each, np.inf * each, np.inf * each) if arm.carrier else None
    limits = Limits(2.0 * one, 10.0 * one, 20.0 * one, **on_axis, axes=axes)
    room = Workspace(bounds=np.array([[-3.0, -3.0, -3.0], [3.0, 3.0, 3.0]]), obstacles=())
    ends = [JointPose.from_configuration(place, arm.coordinates) for place in (start, end)]
    problem = Problem("in space", room, arm, limits, *ends, planner=FULL)
    problem = replace(problem, simulation=SimulationOptions(gravity=np.array([0.0, 0.0, -9.81])))
    unknown = np.zeros((len(time), 3 * LINKS))
    plan = SpacePlan(problem, trajectory, JointStates((), unknown, unknown, unknown, unknown))
    return plan.moving()


@cache
def fixed(first: float = 0.15, second: float = -0.1) -> SpacePlan:
    """Return a motion of an arm with a fixed base from straight to equal bend angles at all joints."""
    return between(bends(0.0), bends(first, second), space_arm(LINKS))


@cache
def fed(carried: float = 0.2, *, bent: bool = True) -> SpacePlan:
    """Return a motion of an arm on a feed axis, with the end of the guide tube at the lower limit of the base.

    Args:
        carried: final feed [m].
        bent: whether the arm bends.
    """
    arm = space_arm(LINKS, feed=Feed(0.0, 0.3, 0.0))
    end = bends(0.15, -0.1) if bent else bends(0.0)
    return between(np.append(bends(0.0), 0.0), np.append(end, carried), arm)


def stopping(there: SpacePlan, stop: JointPose | TipGoal, pause: float = 0.0, rest: float = 0.0) -> SpacePlan:
    """Return a motion, a rest and the motion back, for a problem with a goal at the rest.

    Args:
        there: the motion.
        stop: goal at the rest.
        pause: required duration of the rest [s].
        rest: actual duration of the rest [s].
    """
    motion = there.trajectory
    count = round(rest / 0.004)
    held = np.repeat(motion.positions[-1:], count, axis=0)
    still = np.zeros_like(held)
    times = motion.time[-1] + 0.004 * np.arange(1, count + 1)
    begin = times[-1] if count else motion.time[-1]
    back = {
        "positions": (motion.positions, held, motion.positions[::-1][1:]),
        "velocities": (motion.velocities, still, -motion.velocities[::-1][1:]),
        "accelerations": (motion.accelerations, still, motion.accelerations[::-1][1:]),
    }
    whole = {name: np.concatenate(parts) for name, parts in back.items()}
    time = np.concatenate((motion.time, times, begin + motion.time[1:]))
    goal = JointPose.from_configuration(motion.positions[0], motion.coordinates)
    asked = there.asking(goal=goal, stops=(Stop(stop, Tolerances(), pause),))
    return asked.moving(time=time, stops=(len(motion.time) - 1,), **whole)


def pose_at_end(plan: SpacePlan, off: float = 0.0, carried: float = 0.0) -> JointPose:
    """Return the pose at the end of a motion, with offsets of bend angles [rad] and feed [m]."""
    pose = JointPose.from_configuration(plan.trajectory.positions[-1], plan.trajectory.coordinates)
    return JointPose(pose.bends + off, pose.feed + carried)


def tip_at_end(plan: SpacePlan, off: float = 0.0, turned: float = 0.0, via: tuple[FloatArray, ...] = ()) -> TipGoal:
    """Return the tip pose at the end of a motion as a goal, with offsets of position [m] and direction."""
    frames = LinkFrames.from_configurations(plan.problem.arm, plan.trajectory.positions[-1:])
    along = frames.along[0, -1] + turned * frames.first_axes[0, -1]
    place = places_of(plan)[-1, -1] + np.array([0.0, 0.0, off])
    return TipGoal(place, along / np.linalg.norm(along), via=via)


def along(plan: SpacePlan, off: float = 0.0) -> TipGoal:
    """Return a goal with the path of the tip over a motion, whose middle is off that path by a distance [m]."""
    path = places_of(plan)[:, -1][np.linspace(0, len(plan.trajectory.time) - 1, 9).astype(int)]
    path[4] += np.array([0.0, 0.0, off])
    return TipGoal(path[-1], path=path)


def halfway(plan: SpacePlan) -> FloatArray:
    """Return the position of the tip at the middle of a motion, shape (3,) [m]."""
    return places_of(plan)[len(plan.trajectory.time) // 2, -1]


def limited(plan: SpacePlan, **changes: float) -> SpacePlan:
    """Return a plan with given limits replaced; a number applies to all revolute joints."""
    arrays = {"velocity", "acceleration", "torque", "jerk"}
    values = {name: np.full(3 * LINKS, value) if name in arrays else value for name, value in changes.items()}
    return plan.asking(limits=replace(plan.problem.limits, **values))


def built(plan: SpacePlan, **changes: object) -> SpacePlan:
    """Return a plan with given fields of the arm replaced."""
    return plan.asking(arm=replace(plan.problem.arm, **changes))  # type: ignore[arg-type]


def in_room(plan: SpacePlan, **changes: object) -> SpacePlan:
    """Return a plan with given fields of the workspace replaced."""
    return plan.asking(workspace=replace(plan.problem.workspace, **changes))  # type: ignore[arg-type]


def told(plan: SpacePlan, **changes: object) -> SpacePlan:
    """Return a plan with given fields of the reported states of the drives replaced."""
    return replace(plan, joints=replace(plan.joints, **changes))  # type: ignore[arg-type]


def led_closely() -> SpacePlan:
    """Return a plan whose allowed deviation from the tip path is slightly less than the actual one."""
    found = leader_deviation(fed().problem.arm, fed().trajectory.positions)
    assert found is not None
    return fed().asking(planner=replace(FULL, follow_within=0.9 * found.worst))


def shared(plan: SpacePlan) -> SpacePlan:
    """Return a plan with a limit on the used fraction of all limits."""
    return plan.asking(planner=PlannerOptions(effort_share=SHARE))


def of(plan: SpacePlan, name: str, share: float = 0.98) -> float:
    """Return a fraction of the maximum of one quantity of the bend angles, such as velocity."""
    return share * peak(getattr(plan.trajectory, name)[:, : 2 * LINKS])


def of_axis(plan: SpacePlan, name: str, share: float = 0.98) -> float:
    """Return a fraction of the maximum of one quantity of the feed, such as velocity."""
    return share * peak(getattr(plan.trajectory, name)[:, -1])


def jerk_of(plan: SpacePlan, share: float, columns: slice = slice(0, 2 * LINKS)) -> float:
    """Return a fraction of the maximum jerk of selected coordinates between samples."""
    motion = plan.trajectory
    return share * peak(np.diff(motion.accelerations[:, columns], axis=0) / np.diff(motion.time)[:, None])


def without_two_samples() -> SpacePlan:
    """Return a motion with two samples removed."""
    motion = fixed().trajectory
    names = ("time", "positions", "velocities", "accelerations")
    return fixed().moving(**{name: np.delete(getattr(motion, name), [100, 101], axis=0) for name in names})


def inside_a_shell() -> SpacePlan:
    """Return a motion of an arm inside a closed mesh, without contact."""
    corners = box_corners(np.full(3, -2.0), np.full(3, 2.0))
    return with_body(fixed(), "shell", MeshBody(corners, BOX_FACES))


def bumped(plan: SpacePlan, column: int, size: float) -> SpacePlan:
    """Return a motion with velocities of one coordinate that contradict its positions, and matching accelerations."""
    motion = plan.trajectory
    t = (motion.time - 0.8) / 0.4
    inside = (t > 0.0) & (t < 1.0)
    velocities = motion.velocities.copy()
    accelerations = motion.accelerations.copy()
    velocities[inside, column] += size * np.sin(np.pi * t[inside]) ** 2
    accelerations[inside, column] += size * np.pi / 0.4 * np.sin(2.0 * np.pi * t[inside])
    return plan.moving(velocities=velocities, accelerations=accelerations)


def still_moving(plan: SpacePlan, column: int, speed: float) -> SpacePlan:
    """Return a motion with a given velocity of one coordinate at the last sample."""
    velocities = plan.trajectory.velocities.copy()
    velocities[-1, column] = speed
    return plan.moving(velocities=velocities)


def greatest_torque(plan: SpacePlan) -> float:
    """Return the maximum reported torque [N m]."""
    return peak(plan.joints.torques)


def weightless(plan: SpacePlan) -> SpacePlan:
    """Return a motion without gravity, so that efforts depend on accelerations only."""
    return plan.asking(simulation=WEIGHTLESS).moving()


def nudged(plan: SpacePlan, efforts: FloatArray, columns: slice) -> SpacePlan:
    """Return a motion with accelerations increased at the sample of maximum effort only."""
    accelerations = plan.trajectory.accelerations.copy()
    accelerations[int(np.argmax(np.max(np.abs(efforts), axis=1))), columns] *= 1.02
    return plan.moving(accelerations=accelerations)


def weakened(plan: SpacePlan, columns: slice) -> SpacePlan:
    """Return a motion whose accelerations, and so efforts, are reported too small where they are large."""
    accelerations = plan.trajectory.accelerations.copy()
    most = 0.9 * np.max(np.abs(accelerations[:, columns]), axis=0)
    accelerations[:, columns] = np.clip(accelerations[:, columns], -most, most)
    return plan.moving(accelerations=accelerations)


def torque_at_one_sample(share: float = 1.0) -> SpacePlan:
    """Return a motion whose torque exceeds its limit, or a fraction of the limit, at a single sample."""
    plan = weightless(fixed())
    plan = limited(plan, torque=1.01 * greatest_torque(plan) / share)
    return nudged(plan, plan.joints.torques, slice(None))


def force_at_one_sample() -> SpacePlan:
    """Return a motion whose feed force exceeds its limit at a single sample."""
    plan = weightless(fed())
    plan = limited(plan, feed_force=1.01 * peak(plan.joints.base_forces))
    return nudged(plan, plan.joints.base_forces, slice(2 * LINKS, None))


def weakened_torques() -> SpacePlan:
    """Return a motion whose torques are reported too small where they are large."""
    plan = weightless(fixed(0.5, -0.4))
    most = of(plan, "accelerations", 1.05)
    return weakened(limited(plan, torque=0.95 * greatest_torque(plan), acceleration=most), slice(None))


def weakened_forces() -> SpacePlan:
    """Return a motion of a straight arm whose feed forces are reported too small where they are large."""
    plan = weightless(fed(bent=False))
    return weakened(limited(plan, feed_force=0.95 * peak(plan.joints.base_forces)), slice(2 * LINKS, None))


def beyond_the_axis() -> SpacePlan:
    """Return a motion whose feed exceeds the range of the axis, with the tip at its goal."""
    return built(fed().asking(goal=tip_at_end(fed())), feed=Feed(0.0, 0.19, 0.0))


def to_tip(off: float = 0.0, turned: float = 0.0, via: tuple[FloatArray, ...] = ()) -> SpacePlan:
    """Return a motion with its final tip pose as goal, with offsets of position [m] and direction, and via points."""
    return fixed().asking(goal=tip_at_end(fixed(), off, turned, via))


def at_stop(off: float = 0.0, turned: float = 0.0, via: tuple[FloatArray, ...] = ()) -> SpacePlan:
    """Return a motion and its reverse, with the tip pose in between as goal, with offsets and via points."""
    return stopping(fixed(), tip_at_end(fixed(), off, turned, via))


def seen(*, stop: bool = False, off: float = 0.0, ball: bool = False, **changes: Any) -> SpacePlan:
    """Return a motion that ends, or rests before its reverse, in a view of a place 0.2 m ahead.

    Args:
        stop: whether it rests there and goes back.
        off: angle of the place off the axis of sight [rad].
        ball: whether a ball hides the place.
        changes: attributes of the view that differ.
    """
    there = fixed()
    pose = tip_at_end(there, turned=float(np.tan(off)))
    assert pose.direction is not None
    place = pose.position + 0.2 * pose.direction
    if ball:
        there = with_body(there, "ball", SphereBody(pose.position + 0.1 * pose.direction, 0.01))
    look_at = replace(LookAt(place, (0.1, 0.3), 0.4, -pose.direction, 0.5), **changes)
    goal = TipGoal.looking(look_at)
    if not stop:
        return there.asking(goal=goal, tolerances=look_at.tolerances)
    both = stopping(there, pose)
    return both.asking(stops=(Stop(goal, look_at.tolerances),))


def covering(share: float) -> SpacePlan:
    """Return a motion that ends before a box 0.2 m ahead, of whose surface a share has to be seen."""
    there = fixed()
    pose = tip_at_end(there)
    assert pose.direction is not None
    corner = pose.position + 0.2 * pose.direction
    coverage = Coverage(("target",), share, 0.01, (0.1, 0.3), 0.4)
    return with_body(there, "target", BoxBody(corner - 0.01, corner + 0.01)).asking(goal=pose, coverage=coverage)


VIEWS: dict[str, dict[str, Any]] = {
    "least distance": {"distance": (0.201, 0.3)},
    "greatest distance": {"distance": (0.1, 0.199)},
    "field of view": {"off": 0.21},
    "normal": {"normal": np.array([0.0, 0.0, 1.0])},
    "line of sight": {"ball": True},
}
"""What breaks one condition of a view, by the name of its check."""
SPACE_MUTATIONS: dict[str, tuple[Mutation, ...]] = {
    "samples": (without_two_samples,),
    "joint names": (lambda: told(fixed(), names=("yaw", *fixed().joints.names[1:])),),
    "free side": (inside_a_shell, lambda: in_room(fixed(), bounds=np.array([[-3.0, -3, -3], [-2.0, 3, 3]]))),
    "wall clearance": (
        lambda: with_body(in_room(fixed(), clearance=0.3), "ball", SphereBody(np.array([0.8, 0.0, 0.1]), 0.05)),
        lambda: with_body(fixed(), "box", BoxBody(halfway(fixed()) - 0.01, halfway(fixed()) + 0.01)),
        lambda: built(with_body(fixed(), "ball", SphereBody(np.array([0.3, 0.0, 0.2]), 0.05)), radius=0.2),
    ),
    "self-collision": (lambda: limited(built(fixed(1.1), joint_limit=1.2), velocity=9.0, acceleration=99.0),),
    "joint limit": (lambda: built(fixed(), joint_limit=0.14), lambda: built(fixed(), base_limit=0.14)),
    "joint velocity": (lambda: limited(fixed(), velocity=of(fixed(), "velocities")),),
    "joint acceleration": (lambda: limited(fixed(), acceleration=of(fixed(), "accelerations")),),
    "joint jerk": (lambda: limited(fixed(), jerk=jerk_of(fixed(), 0.98)),),
    "joint torque": (torque_at_one_sample,),
    "joint torque of the samples": (weakened_torques,),
    "tip velocity": (lambda: fixed().asking(limits=replace(fixed().problem.limits, points=(PointLimit(None, 0.1),))),),
    "tip acceleration": (
        lambda: fixed().asking(limits=replace(fixed().problem.limits, points=(PointLimit(None, np.inf, 0.1),))),
    ),
    "point at 0.3 m velocity": (
        lambda: fixed().asking(limits=replace(fixed().problem.limits, points=(PointLimit(0.3, 0.02),))),
    ),
    "point at 0.3 m acceleration": (
        lambda: fixed().asking(limits=replace(fixed().problem.limits, points=(PointLimit(0.3, np.inf, 0.02),))),
    ),
    "velocities against angles": (lambda: bumped(fixed(), 4, 0.05), lambda: bumped(fixed(), 5, 0.05)),
    "accelerations against velocities": (lambda: fixed().moving(accelerations=0.8 * fixed().trajectory.accelerations),),
    "revolutes against bends": (
        lambda: told(fixed(), angles=fixed().joints.angles + 1e-6 * np.eye(3 * LINKS)[2]),
        lambda: told(fixed(), velocities=-fixed().joints.velocities),
    ),
    "torques against dynamics": (
        lambda: told(fixed(), torques=1.001 * fixed().joints.torques),
        lambda: built(fixed(), payload=0.01),
        lambda: built(fixed(), inertia_axial=np.full(LINKS, 1.0)),
    ),
    "feed range": (beyond_the_axis,),
    "following the tip": (led_closely,),
    "joints inside the guide": (lambda: built(fed(), feed=Feed(0.0, 0.3, 0.15)),),
    "feed velocity": (lambda: limited(fed(), feed_velocity=of_axis(fed(), "velocities")),),
    "feed acceleration": (lambda: limited(fed(), feed_acceleration=of_axis(fed(), "accelerations")),),
    "feed jerk": (lambda: limited(fed(), feed_jerk=jerk_of(fed(), 0.98, slice(2 * LINKS, None))),),
    "feed force": (force_at_one_sample,),
    "feed force of the samples": (weakened_forces,),
    "feed velocity against positions": (lambda: bumped(fed(), -1, 0.004),),
    "feed force against dynamics": (lambda: told(fed(), base_forces=1.001 * fed().joints.base_forces),),
    "share of velocity": (lambda: shared(limited(fixed(), velocity=of(fixed(), "velocities", 1.05))),),
    "share of acceleration": (lambda: shared(limited(fixed(), acceleration=of(fixed(), "accelerations", 1.05))),),
    "share of jerk": (lambda: shared(limited(fixed(), jerk=jerk_of(fixed(), 1.05))),),
    "share of effort": (lambda: shared(torque_at_one_sample(SHARE)),),
    "start joints": (lambda: fixed().asking(start=JointPose(np.full((LINKS, 2), 2e-6))),),
    "start feed": (lambda: fed().asking(start=JointPose(np.zeros((LINKS, 2)), 1e-3)),),
    "rest": (lambda: still_moving(fixed(), 3, 1e-4),),
    "feed at rest": (lambda: still_moving(fed(), -1, 1e-5),),
    "goal position": (lambda: to_tip(off=1.1e-3),),
    "goal direction": (lambda: to_tip(turned=0.018),),
    "goal joints": (lambda: fixed().asking(goal=pose_at_end(fixed(), 0.02)),),
    "goal feed": (lambda: fed().asking(goal=pose_at_end(fed(), carried=2e-3)),),
    "goal path": (lambda: fed().asking(goal=along(fed(), 2e-3)),),
    "goal via N": (lambda: to_tip(via=(halfway(fixed()) + 0.3,)),),
    "stop N position": (lambda: at_stop(off=1.1e-3),),
    "stop N direction": (lambda: at_stop(turned=0.018),),
    "stop N joints": (lambda: stopping(fixed(), pose_at_end(fixed(), 0.02)),),
    "stop N feed": (lambda: stopping(fed(), pose_at_end(fed(), carried=0.01)),),
    "stop N path": (lambda: stopping(fed(), along(fed(), 2e-3)),),
    "stop N via N": (lambda: at_stop(via=(halfway(fixed()) + 0.3,)),),
    "survived joint error": (
        lambda: with_body(fixed(), "wall", BoxBody(np.array([0.8, -1.0, -1.0]), np.array([0.9, 1.0, 1.0]))).asking(
            joint_error=0.4
        ),
    ),
    "stop N pause": (lambda: stopping(fixed(), pose_at_end(fixed()), pause=0.1, rest=0.06),),
    "surface seen": (lambda: covering(0.9),),
    **{f"goal {name}": (partial(seen, **changes),) for name, changes in VIEWS.items()},
    **{f"stop N {name}": (partial(seen, stop=True, **changes),) for name, changes in VIEWS.items()},
}
"""Motions by the name of the check that fails; N stands for the number of a via point or an intermediate goal."""
SPACE_UNHARMED: tuple[Mutation, ...] = (
    fixed,
    seen,
    partial(seen, stop=True),
    lambda: covering(0.1),
    fed,
    to_tip,
    lambda: fed().asking(goal=along(fed())),
    lambda: stopping(fed(), along(fed())),
    lambda: to_tip(via=(halfway(fixed()),)),
    at_stop,
    lambda: at_stop(via=(halfway(fixed()),)),
    lambda: stopping(fed(), pose_at_end(fed()), pause=0.1, rest=0.1),
    lambda: shared(fixed()),
)
"""Motions in space that pass all checks."""
