"""Made-up scenes that between them ask everything of proofs and verifier: good plans, bad ones, hostile ones.

Nothing in them is planned, since plans depend on the versions of solvers. All lengths of an arm are multiplied by a
number next to 1, by which figures that are rounding alone are told.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import CcmError
from ccm_opt.driver.clearance_over_time import clearance_over_time
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.problem import (
    JointPose,
    Limits,
    PlannerOptions,
    PointLimit,
    Problem,
    Stop,
    TipGoal,
    Tolerances,
    VerificationOptions,
)
from ccm_opt.problem.solution import JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.scene.bad_pose import clearance_advice, refuse_bad_pose
from ccm_opt.scene.certificate import Certificate, MotionParts, PairProofs, WallProofs
from ccm_opt.scene.contact_finder import WallFinder
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.consistency import check_followed_curves, check_keyframes, check_nearest_curves
from ccm_opt.verification.interpolated_message import interpolation_deviation
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.selfcollision import check_self_collision
from ccm_opt.verification.tolerance.error_model import error_models
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_error
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.verification.verifier import left_unchecked, verify
from ccm_opt.verification.wall_clearance import check_walls
from tests.arms import bare_problem, plain_arm

ROOM = shapely.box(-1.6, -1.5, 1.7, 1.4)
LINKS = 6
Scene = Callable[[float], object]


def arm_of(scale: float, *, fed: bool = False, links: int = LINKS, **changes: object) -> Arm:
    """An arm none of whose numbers is 0 or 1."""
    values: dict[str, object] = {
        "base": np.array([0.013, -0.021]),
        "base_heading": 0.31,
        "joint_limit": 1.9,
        "base_limit": 2.2,
        "mount_length": 0.057 * scale,
        "masses": np.linspace(0.13, 0.07, links),
        "payload": 0.05,
        "rotor_inertia": 0.002,
        "friction": 0.03,
    }
    values |= {"feed": Feed(-0.02, 0.31, 0.11)} if fed else {}
    values |= {"radius": 0.017 * scale} | changes
    return plain_arm(links, 0.6 * scale / links, **values)


def walls() -> tuple[Obstacle, ...]:
    """Obstacles of all kinds, one of them of very many edges and one with a hole."""
    angles = np.linspace(0.0, 2.0 * np.pi, 150, endpoint=False)
    radius = 0.2 + 0.01 * np.sin(7.0 * angles)
    blob = shapely.Polygon(np.array([0.5, 0.62]) + radius[:, None] * np.column_stack((np.cos(angles), np.sin(angles))))
    ring = shapely.Polygon(
        shapely.box(-0.9, -0.7, -0.4, -0.3).exterior.coords, [shapely.box(-0.8, -0.6, -0.5, -0.4).exterior.coords]
    )
    return (
        Obstacle("blob", PlaneShape(blob)),
        Obstacle("post", PlaneShape(shapely.Point(0.45, -0.33), 0.071)),
        Obstacle("wire", PlaneShape(shapely.LineString([(0.8, -0.5), (0.86, -0.1), (0.95, 0.1)]), 0.013)),
        Obstacle("ring", PlaneShape(ring)),
        Obstacle("wedge", PlaneShape(shapely.Polygon([(0.1, 0.41), (0.17, 0.9), (-0.2, 0.6)]))),
    )


def moved(arm: Arm, poses: FloatArray, samples: int = 320, rest: int = 14) -> JointTrajectory:
    """A motion through poses, shape (k, c), each 1.3 s after the one before, resting at each; its steps are uneven."""
    u = np.linspace(0.0, 1.0, samples)[1:]
    u = (u + 0.004 * np.sin(7.0 * np.pi * u))[:, None]
    shapes = (10 * u**3 - 15 * u**4 + 6 * u**5, 30 * u**2 - 60 * u**3 + 30 * u**4, 60 * u - 180 * u**2 + 120 * u**3)
    parts = [[np.zeros(1)], [poses[:1]], [0.0 * poses[:1]], [0.0 * poses[:1]]]
    for start, end in pairwise(poses):
        still = np.zeros((rest, poses.shape[1]))
        parts[0] += [parts[0][-1][-1] + 1.3 * u[:, 0]]
        parts[0] += [parts[0][-1][-1] + 0.004 * np.arange(1, rest + 1)]
        parts[1] += [start + shapes[0] * (end - start), end + still]
        parts[2] += [shapes[1] * (end - start) / 1.3, still]
        parts[3] += [shapes[2] * (end - start) / 1.3**2, still]
    columns = [np.concatenate(part) for part in parts]
    each = samples - 1 + rest
    stops = tuple(each * k + samples - 1 for k in range(len(poses) - 2))
    return JointTrajectory(*columns, arm.coordinates, stops=stops)


def tips(arm: Arm, poses: FloatArray) -> FloatArray:
    """Places of the tip, shape (k, 2) [m]."""
    ends = arm.joint_positions(arm.headings(poses[:, : arm.links]))[:, -1]
    return (
        ends
        + poses[:, arm.links :]
        @ np.array([[np.cos(arm.base_heading), np.sin(arm.base_heading)]])[: len(poses[0]) - arm.links]
    )


def states_of(problem: Problem, trajectory: JointTrajectory) -> JointStates:
    """The same for all drives."""
    planar = (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    motion = (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    torques, force = drive_efforts(problem.arm, problem.simulation.gravity, *motion)
    angles = [revolute_angles(problem.arm, values) for values in planar]
    return JointStates(joint_names(problem.arm), *angles, torques, force)


def plan_of(scale: float, *, fed: bool, strict: bool = False) -> tuple[Problem, JointTrajectory]:
    """A problem with goals on the way of both kinds, and a motion that solves it, or all but."""
    arm = arm_of(scale, fed=fed, **({} if strict or not fed else {"feed": Feed(-0.02, 0.31, 0.0)}))
    middle = np.array([0.11, -0.23, 0.31, -0.17, 0.13, 0.07])
    last = np.array([-0.21, 0.33, 0.12, -0.41, 0.22, 0.18])
    bends = np.vstack((np.zeros(LINKS), middle, last))
    feeds = np.array([[0.0], [0.12], [0.23]])
    poses = np.hstack((bends, feeds)) if fed else bends
    trajectory = moved(arm, poses)
    one = np.linspace(0.8, 1.2, 3 * LINKS)
    low = 0.31 if strict else 1.0
    limits = Limits(
        velocity=2.1 * low * one,
        acceleration=9.0 * low * one,
        torque=3.0 * low * one,
        jerk=700.0 * low * one,
        feed_velocity=0.9 * low if fed else None,
        feed_acceleration=4.0 * low if fed else None,
        feed_force=30.0 * low if fed else None,
        feed_jerk=90.0 * low if fed else None,
        points=(PointLimit(None, 1.9 * low, 13.0 * low), PointLimit(0.33 * scale, 1.1 * low, 9.0 * low)),
    )
    tip = tips(arm, poses)[1] + np.array([0.4e-3, -0.3e-3])
    stop = Stop(TipGoal(tip, heading=0.31 + float(np.sum(middle)) + 0.004), Tolerances(1e-3, 0.02), 0.05)
    problem = Problem(
        "pinned",
        Workspace(ROOM, walls(), 0.003),
        arm,
        limits,
        JointPose(np.zeros(LINKS)),
        JointPose(last, 0.23 if fed else 0.0),
        stops=(stop,),
        planner=PlannerOptions(effort_share=0.83),
        joint_error=0.001,
    )
    return problem, trajectory


def checked(*, fed: bool, strict: bool) -> Scene:
    """The verifier on a whole plan, with room and what is left out."""

    def scene(scale: float) -> None:
        problem, trajectory = plan_of(scale, fed=fed, strict=strict)
        checks = verify(problem, trajectory, states_of(problem, trajectory))
        clearance_over_time(problem, trajectory, 0.02, checks)
        clearance_over_time(problem, trajectory, 0.11)
        left_unchecked(problem, trajectory)
        interpolation_deviation(problem.arm, trajectory)

    return scene


def falsified(field: str, *, fed: bool) -> Scene:
    """The verifier on a plan one array of which was changed here and there."""

    def scene(scale: float) -> None:
        problem, trajectory = plan_of(scale, fed=fed)
        joints = states_of(problem, trajectory)
        holder = trajectory if hasattr(trajectory, field) else joints
        values = np.array(getattr(holder, field))
        values[90] += 0.37 * (1.0 + np.abs(values[90]))
        values[310] *= 1.7
        if field == "time":
            values = np.array(trajectory.time)
            values[20:] *= 0.99
        if holder is trajectory:
            trajectory = replace(trajectory, **{field: values})
        else:
            joints = replace(joints, **{field: values})
        verify(problem, trajectory, joints)

    return scene


def other_goals(scale: float) -> None:
    """Starts and goals that are curves or places of the tip, on both kinds of arm."""
    for fed in (False, True):
        problem, trajectory = plan_of(scale, fed=fed)
        arm = problem.arm
        joints = states_of(problem, trajectory)
        curves = nearest_curves(arm, trajectory.positions[[0, -1]])
        tip = tips(arm, trajectory.positions[-1:])[0]
        for goal in (
            JointPose.along(arm, curves[1], feed=0.23 if fed else 0.0),
            TipGoal(tip),
            TipGoal(tip + 0.1, heading=0.3),
        ):
            changed = replace(problem, start=JointPose.along(arm, curves[0]), goal=goal, joint_error=0.0)
            verify(changed, trajectory, joints)


def unlimited(scale: float) -> None:
    """Arms of which little is asked: no torque, force, jerk or points, no goals on the way, and links that may meet."""
    for fed in (False, True):
        problem, trajectory = plan_of(scale, fed=fed)
        few = {"torque": None, "jerk": None, "feed_force": None, "feed_jerk": None, "points": ()}
        asked = replace(
            problem,
            limits=replace(problem.limits, **few),  # type: ignore[arg-type]
            arm=replace(problem.arm, self_collision=False, payload=0.0, friction=0.0, rotor_inertia=0.0),
            stops=(),
            planner=PlannerOptions(effort_share=1.0),
            joint_error=0.0,
        )
        moving = replace(trajectory, stops=())
        checks = verify(asked, moving, states_of(asked, moving))
        clearance_over_time(asked, moving, 0.0, checks)
        left_unchecked(asked, moving)


def malformed(scale: float) -> None:
    """Samples that are none."""
    problem, trajectory = plan_of(scale, fed=True)
    joints = states_of(problem, trajectory)
    verify(problem, trajectory, replace(joints, names=("one", *joints.names[1:-1])))
    broken = (
        {"time": trajectory.time[:-1]},
        {"time": trajectory.time[:, None]},
        {"time": -trajectory.time},
        {"time": trajectory.time * np.nan},
        {"time": np.linspace(0.0, 1e6, len(trajectory.time))},
        {"time": trajectory.time + 0.5},
        {"positions": trajectory.positions[:, :-1]},
        {"velocities": trajectory.velocities * np.inf},
        {"stops": ()},
        {"stops": (0,)},
        {"stops": (1000,)},
    )
    for change in broken:
        verify(problem, replace(trajectory, **change), joints)  # type: ignore[arg-type]
    for name in ("angles", "torques", "base_forces"):
        verify(problem, trajectory, replace(joints, **{name: getattr(joints, name)[:-1]}))
        verify(problem, trajectory, replace(joints, **{name: getattr(joints, name) * np.nan}))


def drawn_motions(scale: float) -> None:
    """Rough motions among walls and into themselves, with and without room, and of arms without a body."""
    rng = np.random.default_rng(3)
    for k in range(12):
        links = (5, 9, 14)[k % 3]
        arm = arm_of(scale, links=links, fed=k % 2 == 1, radius=(0.012, 0.0)[k % 5 == 4])
        start = rng.normal(0.0, 2.4 / links, links) + rng.choice((0.0, 4.5 / links))
        poses = start + np.cumsum(rng.normal(0.0, 0.15, (5, links)), axis=0)
        if arm.feed:
            poses = np.hstack((poses, 0.04 * np.arange(5)[:, None]))
        motion = ChainMotion(arm, 0.01 * np.arange(5) ** 1.1, poses)
        room = Workspace(ROOM, walls()[k % 3 :], 0.002)
        settings = DEFAULT_VERIFICATION if k % 4 else replace(DEFAULT_VERIFICATION, most_pairs=40)
        check_walls(motion, room, settings)
        check_self_collision(motion, settings)


def given_up(scale: float) -> None:
    """Proofs that are given up, reports that are cut short, and motions that nothing can be asked of."""
    poses = np.array([[0.0, 0.3, 0.2, -0.1, 0.2, 0.1], [0.4, 0.2, -0.3, 0.1, 0.0, 0.2]])
    time = np.array([0.0, 0.1])
    room = Workspace(ROOM, walls(), 0.002)
    arm = arm_of(scale)
    motion = ChainMotion(arm, time, poses)
    for change in ({"resolution": 0.5}, {"most_pairs": 1}, {"most_report_pairs": 1}):
        settings = replace(DEFAULT_VERIFICATION, **change)  # type: ignore[arg-type]
        check_walls(motion, room, settings)
        curled = ChainMotion(arm, time, np.array([np.full(LINKS, 1.0), np.full(LINKS, 1.3)]))
        check_self_collision(curled, settings)
    fed = arm_of(scale, fed=True)
    slid = np.column_stack((np.tile(0.001 * np.arange(LINKS), (3, 1)), np.array([0.0, 0.03, 0.11])))
    check_walls(ChainMotion(fed, np.array([0.0, 0.1, 0.2]), slid), room)
    short = arm_of(scale, links=2)
    check_self_collision(ChainMotion(short, time, poses[:, :2]))
    check_walls(ChainMotion(arm_of(scale, mount_length=0.7 * scale), time, poses), room)
    still = np.zeros_like(poses)
    trajectory = JointTrajectory(0.004 * np.arange(2), 0.02 * poses, still, still, arm.coordinates)
    mean = np.diff(trajectory.positions, axis=0) / 0.004
    # Either end of a cubic may lead beyond the step.
    for first, last in ((3.5, 1.0), (1.0, 3.5)):
        interpolation_deviation(arm, replace(trajectory, velocities=np.vstack((first * mean, last * mean))))
    problem, _ = plan_of(scale, fed=False)
    asked = replace(problem, stops=(), verification=VerificationOptions(contact_tolerance=1e-4))
    verify(asked, trajectory, states_of(asked, trajectory))


def survived(scale: float) -> None:
    """Errors that motions survive, and the tubes that they sweep."""
    for fed in (False, True):
        arm = arm_of(scale, fed=fed, mount_length=0.0)
        poses = np.linspace(-0.1, 0.24, LINKS) * np.linspace(0.3, 1.0, 4)[:, None]
        poses = np.hstack((poses, 0.05 * np.arange(4)[:, None])) if fed else poses
        still = np.zeros_like(poses)
        trajectory = JointTrajectory(0.01 * np.arange(4), poses, still, still, arm.coordinates)
        room = Workspace(ROOM, walls(), 0.001)
        for model in error_models(arm).values():
            tolerated_error(bare_problem(arm, room), trajectory, model)


def keyframes_held(scale: float) -> None:
    """Keyframes and curves beside a motion, right and wrong."""
    for fed in (False, True):
        problem, trajectory = plan_of(scale, fed=fed)
        arm = problem.arm
        keyframes = trajectory.positions[[0, 80, 200, 333, 420, 560, -1]]
        curves = nearest_curves(arm, keyframes)
        longer = [Configuration(c.base, c.segments[:-1]) for c in curves]
        for some in (keyframes, keyframes + 0.05, keyframes[::-1], keyframes[:0], keyframes[2:]):
            check_keyframes(arm, trajectory, some)
            check_followed_curves(arm, curves, some)
        for some in (curves, curves[1:], curves[::-1], longer):
            check_nearest_curves(some, curves)


def proved_motions(scale: float) -> None:
    """The planner's certificate on rough motions, compiled and interpreted."""
    rng = np.random.default_rng(4)
    for k in range(9):
        links = (6, 12)[k % 2]
        arm = arm_of(scale, links=links, mount_length=(0.0, 0.06, 0.13)[k % 3] * scale)
        headings = np.cumsum(rng.normal(0.0, 2.0 / links, links) + rng.choice((0.0, 5.0 / links)))
        turned = np.array([headings, headings + rng.normal(0.0, 0.1, links), headings + rng.normal(0.0, 0.4, links)])
        room = Workspace(ROOM, walls()[k % 2 :], 0.002)
        Certificate(arm, room, spare=0.001).failures(arm.bends(turned))
        Certificate.allowing_contact(arm, room).failures(arm.bends(turned), depth=3)
        spans = MotionParts(arm, arm.bends(turned)[:-1], arm.bends(turned)[1:], np.arange(2))
        least = arm.radius + 0.002 + 0.001 * np.arange(links)
        asked = (room, least, (k % 3, 0.3))
        WallProofs(*asked).unproved(spans, None)
        WallProofs(*asked).unproved(spans, (np.array([0, 1, 1]), np.array([3, 3, 4])))
        pairs, _ = PairProofs(arm.next_self_pairs, least).unproved(spans, None)
        PairProofs(arm.next_self_pairs, least).unproved(spans, tuple(rows[:3] for rows in pairs))
        spans.moved.sum()


def near_poses(scale: float) -> None:
    """Contacts of poses, compiled and not, and poses that are refused."""
    rng = np.random.default_rng(5)
    for k in range(12):
        links = (6, 12)[k % 2]
        arm = arm_of(scale, links=links, mount_length=(0.0, 0.06, 0.13)[k % 3] * scale)
        bends = rng.normal(0.0, 1.6 / links, links) + rng.choice((0.0, 5.0 / links))
        headings = arm.headings(bends)
        points = arm.joint_positions(headings)
        room = Workspace(ROOM, walls()[k % 2 :], 0.002)
        search = WallFinder(arm, room.flat_walls, 0.002, 0.003, (0.03, 0.2)[k % 2])
        search.find(points).shortfall()
        search.find(points + 1e-4)
        search.crosses(points)
        finder = WallFinder(arm, room.flat_walls, 0.002, 0.003, 0.1)
        contacts = finder.find(points)
        finder.describe(contacts)
        finder.tightest(contacts)
        finder.crosses(points)
        clearance_advice(arm.radius, room.clearance)
        clearance_advice(arm.radius, 0.0)
        for pose in (headings, headings + 0.3 * k, np.linspace(0.0, 9.0, links), np.linspace(0.3, 5.9, links)):
            with suppress(CcmError):
                refuse_bad_pose(arm, room, arm.bends(pose), "start")
            with suppress(CcmError):
                refuse_bad_pose(replace(arm, base=np.array([1.4, 0.2])), room, arm.bends(0.2 * pose), "goal")
        clearance_advice(0.0, room.clearance)


SCENES: dict[str, Scene] = {
    **{
        f"{'fed' if fed else 'fixed'} {'strict' if strict else 'good'}": checked(fed=fed, strict=strict)
        for fed in (False, True)
        for strict in (False, True)
    },
    **{
        f"{'fed' if fed else 'fixed'}, {field} falsified": falsified(field, fed=fed)
        for fed in (False, True)
        for field in ("positions", "velocities", "accelerations", "time", "angles", "torques")
    },
    "fed, base_forces falsified": falsified("base_forces", fed=True),
    "other goals": other_goals,
    "unlimited": unlimited,
    "malformed": malformed,
    "drawn motions": drawn_motions,
    "given up": given_up,
    "survived": survived,
    "keyframes": keyframes_held,
    "proved motions": proved_motions,
    "near poses": near_poses,
}
