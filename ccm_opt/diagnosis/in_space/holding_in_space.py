"""Whether every joint in space can hold the arm still at its start and at a goal that says where all links are."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.diagnosis.holding_torque import carried_weights, joint_words, lighter_by_play, overloaded
from ccm_opt.diagnosis.in_space.keyed_space_poses import WholeSpacePose, whole_space_poses
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.errors import Finding
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.frames import revolute_angles
from ccm_opt.space.problem import SpaceProblem


def strong_enough_in_space(problem: SpaceProblem) -> Iterator[Finding]:
    """Poses that some joint cannot hold."""
    torque = problem.limits.torque
    if torque is None:
        return
    arm = problem.arm
    model = InverseDynamics(arm, problem.simulation.gravity)
    for pose in whole_space_poses(problem):
        # At rest, inverse dynamics gives what gravity asks of every joint.
        angles = revolute_angles(arm, pose.q[: 2 * arm.links])
        load = np.abs(model(angles, np.zeros_like(angles), np.zeros_like(angles)))
        number = int(np.argmax(load / torque))
        if load[number] > torque[number]:
            where = f"{pose.key}: at {pose.name} {joint_words(arm, number)}"
            proved = bool(np.any(load - _lighter(problem, pose) > torque))
            yield replace(overloaded(problem, where, number, float(load[number])), proved=proved)


def _lighter(problem: SpaceProblem, pose: WholeSpacePose) -> FloatArray:
    """By how much the tolerances of a pose can lower each revolute's load, at most, shape (3 links,) [N m]."""
    arm = problem.arm
    play = pose.link_play(arm)
    if not play.any():
        return np.zeros(3 * arm.links)
    # Beside the play the joint's axes turn: of a moment M they feel another share, by M times the angle at most.
    lever = arm.link_length * (arm.links - np.arange(arm.links))
    turned = carried_weights(problem) * lever * pose.turn_play(arm)
    return np.repeat(lighter_by_play(problem, play) + turned, 3)
