"""Motions of a planar arm that pass all checks of the verifier, to be changed such that single checks fail."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Limits, PlannerOptions, Problem, SimulationOptions
from ccm_opt.problem.solution import JointStates, JointTrajectory, Tour
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.verifier import verify
from tests.arms import plain_arm

LINKS = 6
ROOM = shapely.box(-3.0, -3.0, 3.0, 3.0)
WEIGHTLESS = SimulationOptions(gravity=np.zeros(3))
FULL = PlannerOptions(effort_share=1.0)
"""Planner options with full use of the limits, so that no check of a fraction of a limit fails in addition."""


@dataclass(frozen=True)
class Case:
    """A problem and a motion; states of the drives are computed from the motion unless they are given."""

    problem: Problem
    trajectory: JointTrajectory
    joints: JointStates | None = None
    tour: Tour | None = None

    def asked(self, **changes: Any) -> "Case":
        """Return the case with given fields of the problem replaced."""
        return replace(self, problem=replace(self.problem, **changes))

    def limited(self, **changes: Any) -> "Case":
        """Return the case with given limits replaced; a number applies to all revolute joints."""
        count = 3 * self.problem.arm.links
        arrays = {"velocity", "acceleration", "torque", "jerk"}
        values = {name: np.full(count, value) if name in arrays else value for name, value in changes.items()}
        return self.asked(limits=replace(self.problem.limits, **values))

    def built(self, **changes: Any) -> "Case":
        """Return the case with given fields of the arm replaced."""
        return self.asked(arm=replace(self.problem.arm, **changes))

    def moved(self, **changes: Any) -> "Case":
        """Return the case with given fields of the trajectory replaced."""
        return replace(self, trajectory=replace(self.trajectory, **changes))

    def told(self, **changes: Any) -> "Case":
        """Return the case with given fields of the reported states of the drives replaced."""
        return replace(self, joints=replace(self.states, **changes))

    @property
    def states(self) -> JointStates:
        """States and efforts of the drives in the motion, as reported."""
        if self.joints is not None:
            return self.joints
        arm = self.problem.arm
        motion = self.trajectory
        planar = motion.bend_angles, motion.bend_velocities, motion.bend_accelerations
        everything = motion.positions, motion.velocities, motion.accelerations
        gravity = self.problem.simulation.gravity
        torques, force = drive_efforts(arm, gravity, *everything)
        return JointStates(joint_names(arm), *(revolute_angles(arm, part) for part in planar), torques, force)

    @property
    def failing(self) -> set[str]:
        """Names of the checks of the verifier that fail."""
        checks = verify(self.problem, self.trajectory, self.states, tour=self.tour)
        return {check.name for check in checks if not check.passed}


Mutation = Callable[[], Case]


def peak(values: FloatArray) -> float:
    """Return the maximum magnitude of an array."""
    return float(np.max(np.abs(values)))


def quintic(start: FloatArray, end: FloatArray, duration: float = 2.0) -> tuple[FloatArray, ...]:
    """Return times, positions, velocities and accelerations of a straight rest-to-rest motion by a quintic polynomial.

    Args:
        start: initial configuration, shape (c,) [rad, m].
        end: final configuration, shape (c,) [rad, m].
        duration: duration [s].
    """
    t = np.linspace(0.0, 1.0, round(duration / 0.004) + 1)
    s = 10 * t**3 - 15 * t**4 + 6 * t**5, 30 * t**2 - 60 * t**3 + 30 * t**4, 60 * t - 180 * t**2 + 120 * t**3
    parts = [value[:, None] * (end - start) for value in s]
    return duration * t, start + parts[0], parts[1] / duration, parts[2] / duration**2


def fixed(end: FloatArray | float = 0.2, arm: Arm | None = None, start: FloatArray | None = None) -> Case:
    """Return a case of an arm with a fixed base in an empty room.

    Args:
        end: final bend angles, one for all joints or of shape (links,) [rad].
        arm: the arm; a plain one if None.
        start: initial bend angles, shape (links,) [rad]; zero if None.
    """
    arm = arm or plain_arm(LINKS)
    ends = np.broadcast_to(np.asarray(end, dtype=np.float64), (arm.links,)).copy()
    begin = np.zeros(arm.links) if start is None else start
    one = np.ones(3 * arm.links)
    limits = Limits(2.0 * one, 10.0 * one, 20.0 * one)
    goal = JointPose(ends)
    problem = Problem("fixed", Workspace(ROOM), arm, limits, JointPose(begin), goal, planner=FULL)
    return Case(problem, JointTrajectory(*quintic(begin, ends)))


def fed(carried: float = 0.2, end: FloatArray | float = 0.2) -> Case:
    """Return a case of an arm on a feed axis at 30°, with the end of the guide tube at the lower limit of the base.

    Args:
        carried: final feed [m].
        end: final bend angles, one for all joints or of shape (links,) [rad].
    """
    arm = plain_arm(LINKS, base_heading=np.pi / 6, feed=Feed(0.0, 0.3, 0.0))
    ends = np.broadcast_to(np.asarray(end, dtype=np.float64), (arm.links,)).copy()
    one = np.ones(3 * LINKS)
    limits = Limits(2.0 * one, 10.0 * one, 20.0 * one, feed_velocity=0.25, feed_acceleration=0.5, feed_force=20.0)
    start = JointPose(np.zeros(LINKS))
    problem = Problem("fed", Workspace(ROOM), arm, limits, start, JointPose(ends, carried), planner=FULL)
    time, *parts = quintic(np.zeros(LINKS + 1), np.append(ends, carried))
    return Case(problem, JointTrajectory(time, *parts, arm.coordinates))


def pausing(rest: float = 0.1) -> Case:
    """Return a case of two consecutive motions with a rest in between [s]."""
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
