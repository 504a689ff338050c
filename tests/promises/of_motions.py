"""Cases of planar motions, each of which fails one check of the verifier."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.polyline import unit_vector
from ccm_opt.driver.metrics import leader_deviation
from ccm_opt.problem import Coverage, JointPose, LookAt, PlannerOptions, PointLimit, Stop, TipGoal, Tolerances, TourEnd
from ccm_opt.problem.solution import Tour
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.mapping import map_curve
from ccm_opt.robot.tool import Tool, ToolBody
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from tests.arms import plain_arm

from .cases import FULL, LINKS, ROOM, WEIGHTLESS, Case, Mutation, fed, fixed, pausing, peak

SHARE = 0.9
BENDING = 0.9 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Bend angles of a pose without self-collision, shape (LINKS,) [rad]."""


def gap_in_time() -> Case:
    """Return a case with two samples removed."""
    motion = fixed().trajectory
    parts = {name: np.delete(getattr(motion, name), [100, 101], axis=0) for name in ("positions", "velocities")}
    accelerations = np.delete(motion.accelerations, [100, 101], axis=0)
    return fixed().moved(time=np.delete(motion.time, [100, 101]), accelerations=accelerations, **parts)


def inside_a_rock() -> Case:
    """Return a case with the whole arm inside an obstacle, far from its edges."""
    return fixed().asked(workspace=Workspace(ROOM, (Obstacle("rock", PlaneShape(shapely.box(-2.0, -2.0, 2.0, 2.0))),)))


def near_a_wall() -> Case:
    """Return a case with a wall nearer than the required clearance, without contact."""
    wall = Obstacle("wall", PlaneShape(shapely.box(0.8, -1.0, 0.9, 1.0)))
    return fixed().asked(workspace=Workspace(ROOM, (wall,), clearance=0.3))


def rolled_up() -> Case:
    """Return a case with self-collision of an arm of ten links that rolls up."""
    return fixed(1.1, plain_arm(10))


def nudged(case: Case, share: float = 0.02) -> Case:
    """Return a case with accelerations, and so torques, increased at the sample of maximum torque by a fraction."""
    accelerations = case.trajectory.accelerations.copy()
    k = int(np.argmax(np.max(np.abs(case.states.torques), axis=1)))
    accelerations[k] *= 1.0 + share
    return case.moved(accelerations=accelerations)


def torque_at_one_sample() -> Case:
    """Return a case whose torque exceeds its limit at a single sample."""
    case = fixed(BENDING).asked(simulation=WEIGHTLESS)
    return nudged(case.limited(torque=1.01 * peak(case.states.torques)))


def weakened_accelerations() -> Case:
    """Return a case whose accelerations, and so torques, are reported too small where they are large."""
    case = fixed(BENDING).asked(simulation=WEIGHTLESS)
    limit = 0.93 * peak(case.states.torques)
    most = 0.85 * np.max(np.abs(case.trajectory.accelerations), axis=0)
    weak = np.clip(case.trajectory.accelerations, -most, most)
    return case.limited(torque=limit).moved(accelerations=weak)


def weakened_feed() -> Case:
    """Return a case whose feed accelerations, and so forces, are reported too small where they are large."""
    case = fed(end=0.0).asked(simulation=WEIGHTLESS)
    limit = 0.93 * peak(case.states.base_forces)
    weak = case.trajectory.accelerations.copy()
    most = 0.85 * peak(weak[:, -1])
    weak[:, -1] = np.clip(weak[:, -1], -most, most)
    return case.limited(feed_force=limit).moved(accelerations=weak)


def force_at_one_sample() -> Case:
    """Return a case whose feed force exceeds its limit at a single sample."""
    case = fed(end=0.0).asked(simulation=WEIGHTLESS)
    limit = 1.01 * peak(case.states.base_forces)
    accelerations = case.trajectory.accelerations.copy()
    accelerations[int(np.argmax(np.abs(case.states.base_forces[:, 0]))), -1] *= 1.02
    return case.limited(feed_force=limit).moved(accelerations=accelerations)


def bumped_rates(case: Case, column: int, size: float) -> Case:
    """Return a case with velocities of one coordinate that disagree with its positions, and matching accelerations.

    Args:
        case: the case.
        column: index of the coordinate.
        size: maximum deviation of the velocity [rad/s, m/s].
    """
    motion = case.trajectory
    t = (motion.time - 0.8) / 0.4
    inside = (t > 0.0) & (t < 1.0)
    velocities = motion.velocities.copy()
    accelerations = motion.accelerations.copy()
    velocities[inside, column] += size * np.sin(np.pi * t[inside]) ** 2
    accelerations[inside, column] += size * np.pi / 0.4 * np.sin(2.0 * np.pi * t[inside])
    return case.moved(velocities=velocities, accelerations=accelerations)


def still_moving() -> Case:
    """Return a case with a small joint velocity at the last sample."""
    case = fixed()
    velocities = case.trajectory.velocities.copy()
    velocities[-1, 2] = 1e-4
    return case.moved(velocities=velocities)


def feed_still_moving() -> Case:
    """Return a case with a small feed velocity at the last sample."""
    case = fed()
    velocities = case.trajectory.velocities.copy()
    velocities[-1, -1] = 1e-5
    return case.moved(velocities=velocities)


def arc(arm: Arm, curvature: float) -> Configuration:
    """Return a circular arc of the arm's length with its chord along x, of given signed curvature [1/m]."""
    half = 0.5 * curvature * arm.length
    return Configuration.chain(arm.base, -half, [0.5 * arm.length] * 2, [np.full(5, curvature)] * 2)


def bowed(start: float, wanted: float) -> Case:
    """Return a case that starts on an arc of curvature ``start``, while an arc of curvature ``wanted`` is required."""
    arm = plain_arm(12, 0.05)
    begin = map_curve(arm, arc(arm, start), "least-squares")
    return fixed(0.5 * begin, arm, begin).asked(start=JointPose.along(arm, arc(arm, wanted)))


def ending_bowed(end: float, wanted: float) -> Case:
    """Return a case that ends on an arc of curvature ``end``, with an arc of curvature ``wanted`` as goal."""
    arm = plain_arm(12, 0.05)
    there = map_curve(arm, arc(arm, end), "least-squares")
    case = fixed(there, arm, 0.5 * there)
    return case.asked(goal=JointPose.along(arm, arc(arm, wanted)))


def tip_of(case: Case, sample: int) -> tuple[FloatArray, float]:
    """Return position, shape (2,) [m], and heading [rad] of the tip at a sample."""
    arm = case.problem.arm
    place = case.trajectory.positions[sample]
    return arm.joint_positions_at(place)[-1], float(arm.headings(place[: arm.links])[-1])


def missed_tip(*, heading: bool, stop: bool) -> Case:
    """Return a case whose tip misses a goal slightly, in heading or position, at the end or at an intermediate goal."""
    case = pausing() if stop else fixed()
    sample = case.trajectory.stops[0] if stop else -1
    place, turned = tip_of(case, sample)
    goal = (
        TipGoal(place, heading=turned + 0.018) if heading else TipGoal(place + np.array([1.1e-3, 0.0]), heading=turned)
    )
    return case.asked(stops=(Stop(goal, Tolerances()),)) if stop else case.asked(goal=goal)


def seen(*, stop: bool = False, off: float = 0.0, ball: bool = False, **changes: Any) -> Case:
    """Return a case that ends, or rests, in a view of a place 0.2 m ahead.

    Args:
        stop: whether it rests there and goes back.
        off: angle of the place off the axis of sight [rad].
        ball: whether a ball hides the place.
        changes: attributes of the view that differ.
    """
    case = pausing() if stop else fixed()
    place, turned = tip_of(case, case.trajectory.stops[0] if stop else -1)
    ahead = unit_vector(turned + off)
    look_at = replace(LookAt(place + 0.2 * ahead, (0.1, 0.3), 0.4, -ahead, 0.5), **changes)
    goal = TipGoal.looking(look_at)
    if ball:
        post = shapely.Point(place + 0.1 * ahead).buffer(0.01)
        workspace = case.problem.workspace
        case = case.asked(
            workspace=replace(workspace, obstacles=(*workspace.obstacles, Obstacle("post", PlaneShape(post))))
        )
    if stop:
        return case.asked(stops=(Stop(goal, look_at.tolerances),))
    return case.asked(goal=goal, tolerances=look_at.tolerances)


def covering(share: float) -> Case:
    """Return a case that ends before a box 0.2 m ahead, of whose outline a share has to be seen."""
    case = fixed()
    place, turned = tip_of(case, -1)
    corner = place + 0.2 * unit_vector(turned)
    box = Obstacle("target", PlaneShape(shapely.box(*(corner - 0.01), *(corner + 0.01))))
    workspace = replace(case.problem.workspace, obstacles=(*case.problem.workspace.obstacles, box))
    coverage = Coverage(("target",), share, 0.005, (0.1, 0.3), 0.4)
    return case.asked(goal=TipGoal(place, heading=turned), workspace=workspace, coverage=coverage)


VIEWS: dict[str, dict[str, Any]] = {
    "least distance": {"distance": (0.201, 0.3)},
    "greatest distance": {"distance": (0.1, 0.199)},
    "field of view": {"off": 0.21},
    "normal": {"normal": np.array([0.0, 1.0])},
    "line of sight": {"ball": True},
}
"""What breaks one condition of a view, by the name of its check."""


def stopping(goal: JointPose, rest: float = 0.1, pause: float = 0.1) -> Case:
    """Return a case with a rest of a given duration [s], where the problem has a goal and requires a pause [s]."""
    return pausing(rest).asked(stops=(Stop(goal, Tolerances(), pause),))


AT_STOP = JointPose(np.full(LINKS, 0.2))


def touring(*order: int, end: TourEnd = "free", longer: float = 0.0) -> Case:
    """Return a case with two goals in free order, the first visited last, and the order that is said to be theirs.

    Its duration is said to be longer than it is, by a time [s].
    """
    case = pausing()
    goals = case.problem.goal, Stop(AT_STOP, Tolerances())
    planner = replace(FULL, order="free", end=end)
    case = case.asked(stops=(Stop(goals[0], Tolerances()),), goal=goals[1].goal, planner=planner)
    duration = float(case.trajectory.time[-1]) + longer
    return replace(case, tour=Tour(case.problem, order, (), duration, 0.0, duration))


def stopping_bowed(wanted: float) -> Case:
    """Return a case that stops on an arc of curvature 1/m, with an arc of curvature ``wanted`` as required stop."""
    arm = plain_arm(LINKS)
    there = map_curve(arm, arc(arm, 1.0), "least-squares")
    case = fixed(there, arm)
    motion = case.trajectory
    back = replace(motion, positions=motion.positions[::-1], velocities=-motion.velocities[::-1])
    parts = {
        name: np.concatenate((getattr(motion, name), getattr(back, name)[1:])) for name in ("positions", "velocities")
    }
    accelerations = np.concatenate((motion.accelerations, motion.accelerations[::-1][1:]))
    time = np.concatenate((motion.time, motion.time[-1] + motion.time[1:]))
    whole = case.moved(time=time, accelerations=accelerations, stops=(len(motion.time) - 1,), **parts)
    return whole.asked(
        goal=JointPose(np.zeros(LINKS)), stops=(Stop(JointPose.along(arm, arc(arm, wanted)), Tolerances()),)
    )


def fed_stopping() -> Case:
    """Return a case that stops at another feed than required."""
    case = fed()
    motion = case.trajectory
    parts = {
        name: np.concatenate((getattr(motion, name), sign * getattr(motion, name)[::-1][1:]))
        for name, sign in (("positions", 1.0), ("velocities", -1.0), ("accelerations", 1.0))
    }
    time = np.concatenate((motion.time, motion.time[-1] + motion.time[1:]))
    whole = case.moved(time=time, stops=(len(motion.time) - 1,), **parts)
    elsewhere = JointPose(np.full(LINKS, 0.2), 0.21)
    return whole.asked(goal=JointPose(np.zeros(LINKS)), stops=(Stop(elsewhere, Tolerances()),))


def beyond_the_axis() -> Case:
    """Return a case whose feed exceeds the range of the axis, with the tip at its goal."""
    case = fed()
    return case.asked(goal=TipGoal(tip_of(case, -1)[0])).built(feed=Feed(0.0, 0.19, 0.0))


def led_closely() -> Case:
    """Return a case whose allowed deviation from the tip path is slightly less than the actual one."""
    found = leader_deviation(fed().problem.arm, fed().trajectory.positions)
    assert found is not None
    return fed().asked(planner=replace(FULL, follow_within=0.9 * found.worst))


def shared(case: Case) -> Case:
    """Return the case with a limit on the used fraction of all limits."""
    return case.asked(planner=PlannerOptions(effort_share=SHARE))


def effort_above_its_share() -> Case:
    """Return a case whose torque exceeds the allowed fraction of its limit at a single sample."""
    case = fixed(BENDING).asked(simulation=WEIGHTLESS)
    return nudged(shared(case.limited(torque=1.01 * peak(case.states.torques) / SHARE)))


def point(**limits: float) -> Case:
    """Return a case with a limit on velocity or acceleration of a point of the arm."""
    return fixed().asked(limits=replace(fixed().problem.limits, points=(PointLimit(**limits),)))


def greatest_jerk(case: Case, columns: slice = slice(0, LINKS)) -> float:
    """Return the maximum jerk of selected coordinates between samples."""
    motion = case.trajectory
    return peak(np.diff(motion.accelerations[:, columns], axis=0) / np.diff(motion.time)[:, None])


def of(case: Case, name: str, share: float = 0.98) -> float:
    """Return a fraction of the maximum of one quantity of the bend angles, such as velocity."""
    return share * peak(getattr(case.trajectory, name)[:, :LINKS])


def of_axis(case: Case, name: str, share: float = 0.98) -> float:
    """Return a fraction of the maximum of one quantity of the feed, such as velocity."""
    return share * peak(getattr(case.trajectory, name)[:, -1])


TOOL = Tool(
    tip=np.array([0.06, 0.02]),
    direction=np.array([0.8, 0.6]),
    bodies=(ToolBody(np.zeros(2), np.array([0.05, 0.0]), 0.012),),
)


def tooled(tool: Tool = TOOL, *, stop: bool = False) -> Case:
    """Return a case of an arm with a tool, with position and heading of the tool as goal at the end or at a stop."""
    case = pausing() if stop else fixed()
    arm = replace(case.problem.arm, tool=tool)
    place = case.trajectory.positions[case.trajectory.stops[0] if stop else -1]
    heading = float(arm.headings(place)[-1] + np.arctan2(tool.direction[1], tool.direction[0]))
    goal = TipGoal(points_with_tool(arm, place)[-1], heading=heading)
    return case.asked(arm=arm, stops=(Stop(goal, Tolerances()),)) if stop else case.asked(arm=arm, goal=goal)


def retooled(case: Case, **changes: object) -> Case:
    """Return the case with given fields of the tool replaced."""
    return case.built(tool=replace(TOOL, **changes))  # type: ignore[arg-type]


def tool_with(x: float, y: float) -> Tool:
    """Return the tool with a further small disc at a place in the frame of the last link [m]."""
    place = np.array([x, y])
    return replace(TOOL, bodies=(*TOOL.bodies, ToolBody(place, place, 0.012)))


def among(case: Case, *box: float) -> Case:
    """Return the case with a box (xmin, ymin, xmax, ymax) as obstacle [m]."""
    return case.asked(workspace=Workspace(ROOM, (Obstacle("box", PlaneShape(shapely.box(*box))),)))


MOVED, TURNED = TOOL.tip + np.array([0.0, 1.1e-3]), np.array([0.6, 0.8])
TOOL_MUTATIONS: dict[str, Mutation] = {
    "goal position": lambda: retooled(tooled(), tip=MOVED),
    "goal heading": lambda: retooled(tooled(), direction=TURNED),
    "stop N position": lambda: retooled(tooled(stop=True), tip=MOVED),
    "stop N heading": lambda: retooled(tooled(stop=True), direction=TURNED),
    "free side": lambda: among(tooled(tool_with(1.0, 0.0)), 0.7, -0.5, 2.5, 2.5),
    "wall clearance": lambda: among(tooled(), 0.455, 0.413, 0.5, 0.5),
    "self-collision": lambda: tooled(tool_with(-0.28, 0.08)),
}
"""Cases of arms with tools by the name of the check that fails."""
MUTATIONS: dict[str, Mutation] = {
    "samples": gap_in_time,
    "joint names": lambda: fixed().told(names=("yaw", *fixed().states.names[1:])),
    "free side": inside_a_rock,
    "wall clearance": near_a_wall,
    "self-collision": rolled_up,
    "joint limit": lambda: fixed().built(joint_limit=0.19),
    "joint velocity": lambda: fixed().limited(velocity=of(fixed(), "velocities")),
    "joint acceleration": lambda: fixed().limited(acceleration=of(fixed(), "accelerations")),
    "joint jerk": lambda: fixed().limited(jerk=0.98 * greatest_jerk(fixed())),
    "joint torque": torque_at_one_sample,
    "joint torque of the samples": weakened_accelerations,
    "tip velocity": lambda: point(velocity=0.1),
    "tip acceleration": lambda: point(acceleration=0.1),
    "point at 0.3 m velocity": lambda: point(at=0.3, velocity=0.02),
    "point at 0.3 m acceleration": lambda: point(at=0.3, acceleration=0.02),
    "velocities against angles": lambda: bumped_rates(fixed(), 2, 0.05),
    "accelerations against velocities": lambda: fixed().moved(accelerations=0.8 * fixed().trajectory.accelerations),
    "revolutes against bends": lambda: fixed().told(angles=fixed().states.angles + 1e-6 * np.eye(3 * LINKS)[0]),
    "torques against dynamics": lambda: fixed().told(torques=1.001 * fixed().states.torques),
    "feed range": beyond_the_axis,
    "following the tip": led_closely,
    "joints inside the guide": lambda: fed().built(feed=Feed(0.0, 0.3, 0.15)),
    "feed velocity": lambda: fed().limited(feed_velocity=of_axis(fed(), "velocities")),
    "feed acceleration": lambda: fed().limited(feed_acceleration=of_axis(fed(), "accelerations")),
    "feed jerk": lambda: fed().limited(feed_jerk=0.98 * greatest_jerk(fed(), slice(LINKS, None))),
    "feed force": force_at_one_sample,
    "feed force of the samples": weakened_feed,
    "feed velocity against positions": lambda: bumped_rates(fed(), -1, 0.004),
    "feed force against dynamics": lambda: fed().told(base_forces=1.001 * fed().states.base_forces),
    "share of velocity": lambda: shared(fixed().limited(velocity=of(fixed(), "velocities", 1.05))),
    "share of acceleration": lambda: shared(fixed().limited(acceleration=of(fixed(), "accelerations", 1.05))),
    "share of jerk": lambda: shared(fixed().limited(jerk=1.05 * greatest_jerk(fixed()))),
    "share of effort": effort_above_its_share,
    "start joints": lambda: fixed().asked(start=JointPose(np.full(LINKS, 2e-6))),
    "start feed": lambda: fed().asked(start=JointPose(np.zeros(LINKS), 1e-3)),
    "start on the curve": lambda: bowed(2.0, -2.0),
    "start tip": lambda: bowed(1.0, 1.1),
    "rest": still_moving,
    "feed at rest": feed_still_moving,
    "goal position": lambda: missed_tip(heading=False, stop=False),
    "goal heading": lambda: missed_tip(heading=True, stop=False),
    "goal joints": lambda: fixed().asked(goal=JointPose(np.full(LINKS, 0.22))),
    "goal feed": lambda: fed().asked(goal=JointPose(np.full(LINKS, 0.2), 0.202)),
    "goal on the curve": lambda: ending_bowed(2.0, -2.0),
    "goal tip": lambda: ending_bowed(1.0, 1.1),
    "surface seen": lambda: covering(0.9),
    **{f"goal {name}": partial(seen, **changes) for name, changes in VIEWS.items()},
    **{f"stop N {name}": partial(seen, stop=True, **changes) for name, changes in VIEWS.items()},
    "stop N position": lambda: missed_tip(heading=False, stop=True),
    "stop N heading": lambda: missed_tip(heading=True, stop=True),
    "stop N joints": lambda: stopping(JointPose(np.full(LINKS, 0.22))),
    "stop N feed": fed_stopping,
    "stop N on the curve": lambda: stopping_bowed(-1.0),
    "stop N tip": lambda: stopping_bowed(1.1),
    "stop N pause": lambda: stopping(AT_STOP, rest=0.06),
    "order of goals": lambda: touring(2, 1, 2),
    "duration of the tour": lambda: touring(2, 1, longer=1e-3),
    "survived joint error": lambda: fixed().asked(
        joint_error=0.4, workspace=Workspace(ROOM, (Obstacle("wall", PlaneShape(shapely.box(0.8, -1.0, 0.9, 1.0))),))
    ),
}
"""Cases by the name of the check that fails; N stands for the number of an intermediate goal."""
UNHARMED = (
    fixed,
    seen,
    partial(seen, stop=True),
    lambda: covering(0.1),
    tooled,
    lambda: tooled(stop=True),
    fed,
    lambda: stopping(AT_STOP),
    lambda: touring(2, 1),
    lambda: shared(fixed()),
    lambda: fixed().asked(planner=FULL),
)
"""Cases in which all checks pass."""
