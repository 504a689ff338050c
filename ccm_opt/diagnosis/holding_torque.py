"""Whether every joint can hold the arm still at its start and at a goal that says where all links are."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.diagnosis.keyed_poses import WholePose, whole_poses
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.errors import Finding
from ccm_opt.problem import Problem
from ccm_opt.problem.space_problem import AnyProblem
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import joint_names, revolute_angles
from ccm_opt.robot.space_arm import SpaceArm


def strong_enough(problem: Problem) -> Iterator[Finding]:
    """Poses that some joint cannot hold; only for a base that stands still."""
    torque = problem.limits.torque
    if torque is None:
        return
    model = InverseDynamics(problem.arm, problem.simulation.gravity)
    for pose in whole_poses(problem):
        # At rest, inverse dynamics gives what gravity asks of every joint.
        angles = revolute_angles(problem.arm, problem.arm.bends(pose.headings))
        load = np.abs(model(angles, np.zeros_like(angles), np.zeros_like(angles)))
        number = int(np.argmax(load / torque))
        if load[number] > torque[number]:
            where = f"{pose.key}: at {pose.name} {joint_words(problem.arm, number)}"
            proved = bool(np.any(load - _lighter(problem, pose) > torque))
            yield replace(overloaded(problem, where, number, float(load[number])), proved=proved)


def _lighter(problem: Problem, pose: WholePose) -> FloatArray:
    """By how much the tolerances of a pose can lower each revolute's load, at most, shape (3 links,) [N m]."""
    return np.repeat(lighter_by_play(problem, pose.link_play(problem.arm)), 3)


def lighter_by_play(problem: AnyProblem, play: FloatArray) -> FloatArray:
    """By how much the load of each joint may be lower where joints are off their places, at most, shape (links,) [N m].

    Args:
        problem: with the arm and gravity.
        play: of each joint, shape (links,) [m].
    """
    # Every weight beyond a joint may come nearer by its own play and by the joint's.
    weights = _weights(problem)
    moved = np.append(play, play[-1])
    beyond = np.cumsum((weights * moved)[::-1])[::-1][: problem.arm.links]
    return np.asarray(beyond + carried_weights(problem) * play)


def carried_weights(problem: AnyProblem) -> FloatArray:
    """What hangs on each joint, the payload too, shape (links,) [N]."""
    return np.asarray(np.cumsum(_weights(problem)[::-1])[::-1][: problem.arm.links])


def _weights(problem: AnyProblem) -> FloatArray:
    """Of the links and of the payload, shape (links + 1,) [N]."""
    arm = problem.arm
    return float(np.linalg.norm(problem.simulation.gravity)) * np.append(arm.masses, arm.payload)


def overloaded(problem: AnyProblem, where: str, number: int, load: float) -> Finding:
    """A joint that cannot hold the arm in one pose, which by itself proves nothing: its torque against its limit.

    Args:
        problem: what was asked.
        where: the beginning of the reason, up to the joint.
        number: of the revolute.
        load: torque that it needs [N m].
    """
    limits = problem.limits.torque
    limit = np.inf if limits is None else float(limits[number])
    share = load / limit
    return Finding(
        "torque",
        f"{where} needs {load:.4g} N m to hold the arm still, its torque limit is {limit:.4g} N m",
        proved=False,
        key="limits.torque",
        measured=load,
        allowed=limit,
        unit="N m",
        bounds={"limits.torque": share, "arm.link_mass": 1.0 / share},
    )


def joint_words(arm: Arm | SpaceArm, number: int) -> str:
    """A revolute in words: its ball, counted from 1, and its name."""
    return f"joint {number // 3 + 1} ({joint_names(arm)[number]})"
