"""Motions in space of arms on several base axes, of sections that bend evenly and with tools, likewise."""

from dataclasses import replace
from functools import cache

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, TipGoal
from ccm_opt.robot.arc_sections import Tendons
from ccm_opt.robot.base_axes import BaseAxis
from ccm_opt.robot.couplings import CoupledJoints
from ccm_opt.robot.tool import Tool, ToolBody
from ccm_opt.scene.bodies import BoxBody, SphereBody
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.verification.chain_motion import pointing, upward
from ccm_opt.verification.drives import of_drives
from ccm_opt.verification.tool_chain import motion_of
from tests.arc_arms import arc_arm
from tests.space_arms import space_arm
from tests.space_plans import SpacePlan, with_body

from .cases import peak
from .in_space import LINKS, Mutation, bends, between, built, bumped, still_moving, stopping, told

AXES = (
    BaseAxis(np.array([0.0, 0.0, 1.0]), -0.1, 0.3, revolute=False, inertia=5.0),
    BaseAxis(np.array([0.0, 0.0, 1.0]), -1.0, 1.0, revolute=True, point=np.array([-0.2, 0.0, 0.0]), inertia=1.0),
)
"""A lift that carries a turntable."""
TOOL = Tool(
    tip=np.array([0.06, 0.0, 0.02]),
    direction=np.array([0.8, 0.0, 0.6]),
    bodies=(ToolBody(np.zeros(3), np.array([0.05, 0.0, 0.0]), 0.012),),
)

ROLLED = np.array([-0.6, np.tan(np.deg2rad(1.03)), 0.8])
"""The tool's up axis turned by 1.03° about its direction."""


@cache
def carried() -> SpacePlan:
    """Return a motion of an arm that a lift and a turntable carry."""
    arm = space_arm(LINKS, carrier=AXES)
    plan = between(np.append(bends(0.0), [0.0, 0.0]), np.append(bends(0.15, -0.1), [0.2, 0.3]), arm)
    return with_axes(plan, effort=np.array([200.0, 20.0]))


def with_axes(plan: SpacePlan, **changes: FloatArray) -> SpacePlan:
    """Return a plan with given limits of the base axes replaced."""
    axes = plan.problem.limits.axes
    assert axes is not None
    return plan.asking(limits=replace(plan.problem.limits, axes=replace(axes, **changes)))


def just_below(values: FloatArray, number: int) -> FloatArray:
    """Return limits of both base axes, of which one is slightly less than the maximum of its values (T, 2)."""
    return np.array([0.98 * peak(values[:, k]) if k == number else 1e3 for k in range(2)])


def slower(name: str, number: int) -> SpacePlan:
    """Return a plan with a limit on velocity or acceleration of one base axis that is slightly too low."""
    values = {"velocity": carried().trajectory.base_velocities, "acceleration": carried().trajectory.base_accelerations}
    return with_axes(carried(), **{name: just_below(values[name], number)})


def weaker(number: int) -> SpacePlan:
    """Return a plan with an effort limit of one base axis that is slightly too low."""
    return with_axes(carried(), effort=just_below(carried().joints.base_forces, number))


def shorter(number: int) -> SpacePlan:
    """Return a plan whose range of one base axis is slightly exceeded, with the tip at its goal."""
    goal = TipGoal(carried().problem.arm.joint_positions_at(carried().trajectory.positions[-1])[-1])
    axes = list(AXES)
    axes[number] = replace(axes[number], high=carried().trajectory.base_positions[-1, number] - 0.01)
    return built(carried().asking(goal=goal), carrier=tuple(axes))


def stronger(number: int) -> SpacePlan:
    """Return a plan in which one effort of the base axes is reported too large."""
    share = np.where(np.arange(2) == number, 1.001, 1.0)
    return told(carried(), base_forces=share * carried().joints.base_forces)


def gaining(column: int) -> SpacePlan:
    """Return a motion whose accelerations of one coordinate are reported a fifth too small, as efforts presume."""
    plan = carried()
    shares = np.ones(len(plan.trajectory.coordinates))
    shares[column] = 0.8
    return plan.moving(accelerations=shares * plan.trajectory.accelerations)


def heavier(number: int) -> SpacePlan:
    """Return a plan for a base axis that moves more than the reported efforts do."""
    axes = list(AXES)
    axes[number] = replace(axes[number], inertia=axes[number].inertia + (1.0 if axes[number].revolute else 10.0))
    return built(carried(), carrier=tuple(axes))


def axes_at(sample: int, number: int, off: float) -> JointPose:
    """Return the pose in a sample of the motion on axes, with an offset of one axis [m, rad]."""
    plan = carried()
    pose = JointPose.from_configuration(plan.trajectory.positions[sample], plan.trajectory.coordinates)
    return JointPose(pose.bends, pose.feed + off * np.eye(2)[number])


@cache
def even(limit: float = 2.0) -> SpacePlan:
    """Return a motion of an arm of two sections that bend evenly, to a position of the tip.

    Args:
        limit: bound on the bends of a section from which the radii of its links follow [rad].
    """
    arm = arc_arm((3, 2), (0.3, 0.25), limit, joint_limit=1.0)
    assert arm.sections is not None
    plan = between(bends(0.0), arm.sections.coupling @ np.array([0.6, -0.4, -0.3, 0.5]), arm)
    return plan.asking(goal=TipGoal(arm.joint_positions_at(plan.trajectory.positions[-1])[-1]))


def uneven() -> SpacePlan:
    """Return a motion in which one joint of a section bends slightly more than the others."""
    plan = even()
    shares = 1.0 + 2e-5 * np.eye(2 * LINKS)[4]
    motion = plan.trajectory
    names = ("positions", "velocities", "accelerations")
    return plan.moving(**{name: shares * getattr(motion, name) for name in names})


def weak_section(number: int) -> SpacePlan:
    """Return a motion for a problem in which the torque limit of one section is slightly too low."""
    plan = even()
    arm = plan.problem.arm
    assert arm.sections is not None
    most = np.max(np.abs(of_drives(arm, plan.joints.torques)), axis=0).reshape(-1, 2).max(axis=1)
    limits = np.where(np.arange(2) == number, 0.999 * most, 2.0 * most)
    return plan.asking(limits=replace(plan.problem.limits, torque=np.repeat(arm.sections.at_joints(limits), 3)))


@cache
def coupled() -> SpacePlan:
    """Return a motion of an arm of which two drives turn two joints each, and the other joints are locked."""
    ratios = np.zeros((2 * LINKS, 2))
    ratios[[0, 2, 3, 5], [0, 0, 1, 1]] = [1.0, 0.6, 0.8, -0.5]
    names, limits = ("drive1", "drive2"), np.full(2 * LINKS, 0.8)
    arm = space_arm(LINKS, coupled=CoupledJoints(ratios, names, limits, np.full(LINKS, 0.1)))
    return between(bends(0.0), ratios @ np.array([0.3, -0.4]), arm)


def out_of_ratio() -> SpacePlan:
    """Return a motion in which one of two joints that share a drive turns slightly more."""
    plan = coupled()
    shares = 1.0 + 2e-5 * np.eye(2 * LINKS)[2]
    motion = plan.trajectory
    names = ("positions", "velocities", "accelerations")
    return plan.moving(**{name: shares * getattr(motion, name) for name in names})


def weak_drive() -> SpacePlan:
    """Return a motion for a problem in which the torque limit of one drive of several joints is slightly too low."""
    plan = coupled()
    drives = plan.problem.arm.coupled
    assert drives is not None
    most = np.max(np.abs(of_drives(plan.problem.arm, plan.joints.torques)), axis=0)
    torque = drives.at_joints(most * np.array([2.0, 0.999]), rates=False)
    return plan.asking(limits=replace(plan.problem.limits, torque=torque))


def with_tendons(**limits: float) -> SpacePlan:
    """Return a motion for a problem in which the second section has tendons with limits."""
    plan = even()
    assert plan.problem.arm.sections is not None
    tendons = (None, Tendons(0.008, 4, 0.3, **limits))
    return built(plan, sections=replace(plan.problem.arm.sections, tendons=tendons))


def tendon_rates(plan: SpacePlan, values: FloatArray) -> float:
    """Return the greatest change of the length of a tendon for bends of the joints or their rates, (T, 2 links)."""
    sections = plan.problem.arm.sections
    assert sections is not None
    return float(np.max(np.abs(sections.drives(values) @ sections.tendon_slopes.T)))


def displaced() -> SpacePlan:
    """Return a motion in which a tendon is displaced by slightly more than its travel."""
    plan = with_tendons()
    return with_tendons(travel=0.999 * tendon_rates(plan, plan.trajectory.positions))


def hauled() -> SpacePlan:
    """Return a motion in which a tendon is slightly faster than its limit."""
    plan = with_tendons()
    return with_tendons(speed=0.999 * tendon_rates(plan, plan.trajectory.velocities))


def tooled(tool: Tool = TOOL, first: float = 0.15) -> SpacePlan:
    """Return a motion of an arm with a tool, to position, direction and roll of the tool at its end.

    Args:
        tool: the tool.
        first: the first bend angle of all joints at the end [rad].
    """
    arm = space_arm(LINKS, tool=tool)
    plan = between(bends(0.0), bends(first, -0.1), arm)
    motion = plan.trajectory
    last = (motion_of(arm, motion.time, motion.positions), len(motion.time) - 1)
    return plan.asking(goal=TipGoal(points_with_tool(arm, motion.positions[-1])[-1], pointing(*last), up=upward(*last)))


def tool_with(*bodies: ToolBody) -> Tool:
    """Return the tool with given bodies in addition."""
    return replace(TOOL, bodies=(*TOOL.bodies, *bodies))


def retooled(plan: SpacePlan, **changes: object) -> SpacePlan:
    """Return a motion for a problem with another tool."""
    return built(plan, tool=replace(TOOL, **changes))  # type: ignore[arg-type]


def stopping_with(**changes: object) -> SpacePlan:
    """Return a motion and its reverse with the pose of a tool as goal in between, for a problem with another tool."""
    there = tooled()
    goal = there.problem.goal
    assert isinstance(goal, TipGoal)
    return retooled(stopping(there, goal), **changes)


def in_a_box() -> SpacePlan:
    """Return a motion in which a part of the tool, apart from the rest, stays inside an obstacle."""
    ball = ToolBody(np.array([0.3, 0.0, 0.0]), np.array([0.3, 0.0, 0.0]), 0.01)
    box = BoxBody(np.array([0.7, -0.3, -0.3]), np.array([1.2, 0.5, 0.5]))
    return with_body(tooled(tool_with(ball), 0.02), "box", box)


def behind(across: float) -> ToolBody:
    """Return a body of a tool behind its tip, at a distance from the straight arm [m]."""
    place = np.array([-0.3, across, 0.7 * across])
    return ToolBody(place, place, 0.012)


def near_the_tool() -> SphereBody:
    """Return a body that the tool touches at the end of its motion, and no link does."""
    plan = tooled()
    tip = points_with_tool(plan.problem.arm, plan.trajectory.positions[-1])
    last = tip[LINKS] - tip[LINKS - 1]
    return SphereBody(tip[LINKS] + 0.065 * last / np.linalg.norm(last), 0.01)


EQUIPPED_MUTATIONS: dict[str, tuple[Mutation, ...]] = {
    "axis_N range": (lambda: shorter(0), lambda: shorter(1)),
    "axis_N velocity": (lambda: slower("velocity", 0), lambda: slower("velocity", 1)),
    "axis_N acceleration": (lambda: slower("acceleration", 0), lambda: slower("acceleration", 1)),
    "axis_N force": (lambda: weaker(0),),
    "axis_N torque": (lambda: weaker(1),),
    "axis_N velocity against positions": (lambda: bumped(carried(), -2, 0.004), lambda: bumped(carried(), -1, 0.004)),
    "axis_N acceleration against velocity": (lambda: gaining(-2), lambda: gaining(-1)),
    "axis_N force against dynamics": (lambda: stronger(0), lambda: heavier(0)),
    "axis_N torque against dynamics": (lambda: stronger(1), lambda: heavier(1)),
    "axis_N at rest": (lambda: still_moving(carried(), -2, 1e-5), lambda: still_moving(carried(), -1, 1e-4)),
    "start axis_N": (
        lambda: carried().asking(start=axes_at(0, 0, 1e-3)),
        lambda: carried().asking(start=axes_at(0, 1, 1e-3)),
    ),
    "goal axis_N": (
        lambda: carried().asking(goal=axes_at(-1, 0, 2e-3)),
        lambda: carried().asking(goal=axes_at(-1, 1, 0.02)),
    ),
    "stop N axis_N": (lambda: stopping(carried(), axes_at(-1, 0, 0.01)),),
    "joint torque": (lambda: weak_section(0), lambda: weak_section(1), weak_drive),
    "torques against dynamics": (lambda: told(even(), torques=1.001 * even().joints.torques),),
    "tendon travel": (displaced,),
    "tendon speed": (hauled,),
    "even bends of sections": (uneven,),
    "coupled joints": (out_of_ratio,),
    "true arcs beyond links": (lambda: even(0.3),),
    "joint limit": (lambda: built(even(), joint_limit=0.15),),
    "goal position": (lambda: retooled(tooled(), tip=TOOL.tip + np.array([0.0, 1.1e-3, 0.0])),),
    "goal direction": (lambda: retooled(tooled(), direction=np.array([0.6, 0.0, 0.8])),),
    "goal roll": (lambda: retooled(tooled(), up=ROLLED),),
    "stop N roll": (lambda: stopping_with(up=ROLLED),),
    "stop N position": (lambda: stopping_with(tip=TOOL.tip + np.array([0.0, 1.1e-3, 0.0])),),
    "stop N direction": (lambda: stopping_with(direction=np.array([0.6, 0.0, 0.8])),),
    "free side": (in_a_box,),
    "wall clearance": (lambda: with_body(tooled(), "ball", near_the_tool()),),
    "self-collision": (lambda: tooled(tool_with(behind(0.07))),),
}
"""Motions by the name of the check that fails; N stands for the number of an intermediate goal or a base axis."""
EQUIPPED_UNHARMED: tuple[Mutation, ...] = (
    carried,
    lambda: stopping(carried(), axes_at(-1, 0, 0.0)),
    even,
    coupled,
    tooled,
    stopping_with,
    lambda: tooled(tool_with(behind(0.15))),
)
"""Motions that pass all checks."""
