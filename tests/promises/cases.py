"""Motions that keep every promise, on a fixed arm and on a fed one, to be mutated."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Limits, PlannerOptions, Problem, SimulationOptions
from ccm_opt.problem.solution import JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.verifier import verify
from tests.arms import plain_arm

LINKS = 6
ROOM = shapely.box(-3.0, -3.0, 3.0, 3.0)
WEIGHTLESS = SimulationOptions(gravity=np.zeros(3))
FULL = PlannerOptions(effort_share=1.0)
"""Plans may use their limits in full, so that a limit is not caught by the share of it as well."""


@dataclass(frozen=True)
class Case:
    """A motion for a problem; torques and forces are those of its own figures unless they are given."""

    problem: Problem
    trajectory: JointTrajectory
    joints: JointStates | None = None

    def asked(self, **changes: Any) -> "Case":
        """With another problem."""
        return replace(self, problem=replace(self.problem, **changes))

    def limited(self, **changes: Any) -> "Case":
        """With other limits; a number stands for all revolutes."""
        count = 3 * self.problem.arm.links
        arrays = {"velocity", "acceleration", "torque", "jerk"}
        values = {name: np.full(count, value) if name in arrays else value for name, value in changes.items()}
        return self.asked(limits=replace(self.problem.limits, **values))

    def built(self, **changes: Any) -> "Case":
        """With another arm."""
        return self.asked(arm=replace(self.problem.arm, **changes))

    def moved(self, **changes: Any) -> "Case":
        """With another motion."""
        return replace(self, trajectory=replace(self.trajectory, **changes))

    def told(self, **changes: Any) -> "Case":
        """With another report of the drives."""
        return replace(self, joints=replace(self.states, **changes))

    @property
    def states(self) -> JointStates:
        """What the drives do."""
        if self.joints is not None:
            return self.joints
        arm = self.problem.arm
        motion = self.trajectory
        planar = motion.bend_angles, motion.bend_velocities, motion.bend_accelerations
        everything = motion.positions, motion.velocities, motion.accelerations
        gravity = self.problem.simulation.gravity
        torques, force = drive_efforts(arm, gravity, *everything)
        forces = np.repeat(force[:, None], len(arm.base_axes), axis=1)
        return JointStates(joint_names(arm), *(revolute_angles(arm, part) for part in planar), torques, forces)

    @property
    def failing(self) -> set[str]:
        """Names of the checks that do not hold."""
        checks = verify(self.problem, self.trajectory, self.states)
        return {check.name for check in checks if not check.passed}


Mutation = Callable[[], Case]


def peak(values: FloatArray) -> float:
    """The greatest size."""
    return float(np.max(np.abs(values)))


def quintic(start: FloatArray, end: FloatArray, duration: float = 2.0) -> tuple[FloatArray, ...]:
    """Time, values, rates and accelerations of a rest-to-rest motion on a straight line in joint space."""
    t = np.linspace(0.0, 1.0, round(duration / 0.004) + 1)
    s = 10 * t**3 - 15 * t**4 + 6 * t**5, 30 * t**2 - 60 * t**3 + 30 * t**4, 60 * t - 180 * t**2 + 120 * t**3
    parts = [value[:, None] * (end - start) for value in s]
    return duration * t, start + parts[0], parts[1] / duration, parts[2] / duration**2


def fixed(end: FloatArray | float = 0.2, arm: Arm | None = None, start: FloatArray | None = None) -> Case:
    """An arm on a fixed base in an empty room."""
    arm = arm or plain_arm(LINKS)
    ends = np.broadcast_to(np.asarray(end, dtype=np.float64), (arm.links,)).copy()
    begin = np.zeros(arm.links) if start is None else start
    one = np.ones(3 * arm.links)
    limits = Limits(2.0 * one, 10.0 * one, 20.0 * one)
    goal = JointPose(ends)
    problem = Problem("fixed", Workspace(ROOM), arm, limits, JointPose(begin), goal, planner=FULL)
    return Case(problem, JointTrajectory(*quintic(begin, ends)))


def fed(carried: float = 0.2, end: FloatArray | float = 0.2) -> Case:
    """An arm that is carried along an axis at 30°, its guide tube ending where the base begins."""
    arm = plain_arm(LINKS, base_heading=np.pi / 6, feed=Feed(0.0, 0.3, 0.0))
    ends = np.broadcast_to(np.asarray(end, dtype=np.float64), (arm.links,)).copy()
    one = np.ones(3 * LINKS)
    limits = Limits(2.0 * one, 10.0 * one, 20.0 * one, feed_velocity=0.25, feed_acceleration=0.5, feed_force=20.0)
    start = JointPose(np.zeros(LINKS))
    problem = Problem("fed", Workspace(ROOM), arm, limits, start, JointPose(ends, carried), planner=FULL)
    time, *parts = quintic(np.zeros(LINKS + 1), np.append(ends, carried))
    return Case(problem, JointTrajectory(time, *parts, arm.coordinates))


def pausing(rest: float = 0.1) -> Case:
    """Two motions with a pause between them that their problem asks for."""
    first = fixed()
    there = first.trajectory
    time, *parts = quintic(np.full(LINKS, 0.2), np.full(LINKS, -0.1))
    samples = max(round(rest / 0.004), 1)
    held = np.repeat(there.positions[-1:], samples, axis=0)
    still = np.zeros_like(held)
    pause = there.time[-1] + 0.004 * np.arange(1, samples + 1)
    trajectory = JointTrajectory(
        np.concatenate((there.time, pause, pause[-1] + time[1:])),
        np.concatenate((there.positions, held, parts[0][1:])),
        np.concatenate((there.velocities, still, parts[1][1:])),
        np.concatenate((there.accelerations, still, parts[2][1:])),
        stops=(len(there.time) - 1,),
    )
    return Case(replace(first.problem, goal=JointPose(np.full(LINKS, -0.1))), trajectory)
