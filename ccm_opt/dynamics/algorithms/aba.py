"""Forward dynamics by the articulated-body algorithm, one ball joint at a time.

Featherstone's algorithm (Rigid Body Dynamics Algorithms, 2008, chapter 7): velocities outward, articulated bodies
inward (``aba_free``; ``aba_geared`` when drives have rotor inertia), accelerations outward.
"""

from typing import Any, NamedTuple

import casadi as ca

from ccm_opt.dynamics.algorithms import aba_free, aba_geared
from ccm_opt.dynamics.algorithms.arm_model import Structure
from ccm_opt.dynamics.algorithms.in_plane import AT_REST, OF_BALL, TRIG, WORLD, free, in_plane, swept_in_plane
from ccm_opt.dynamics.algorithms.link_algebra import BALL_JOINTS, angles_of
from ccm_opt.robot.arm import Axes


class AbaSteps(NamedTuple):
    """Functions of the three sweeps and of what is between them, in order."""

    velocity: Any
    tip: Any
    inertia: Any
    base: Any
    acceleration: Any


def aba_steps(structure: Structure) -> AbaSteps:
    """The algorithm's functions for a structure."""
    # Rotors cost half the speed (moments are passed on beside forces), so arms without them have a form of their own.
    variant = aba_geared if structure.geared else aba_free
    steps = AbaSteps(_velocity_step(structure.axes), *variant.steps(structure.axes))
    return _in_plane(steps) if structure.planar else steps


def _in_plane(steps: AbaSteps) -> AbaSteps:
    """The functions for an arm that stays in its plane."""
    velocity, (_, motion) = swept_in_plane(steps.velocity, AT_REST, [TRIG, OF_BALL])
    tip, (at_tip,) = in_plane(steps.tip, [WORLD])
    columns = [TRIG, motion, OF_BALL, OF_BALL, free(4), free(6)]
    inertia, (whole_arm, solved) = swept_in_plane(steps.inertia, at_tip, columns)
    base, (at_base, _) = in_plane(steps.base, [whole_arm, free(1), WORLD])
    acceleration, _ = swept_in_plane(steps.acceleration, at_base, [TRIG, motion, solved, free(4)])
    return AbaSteps(velocity, tip, inertia, base, acceleration)


def _velocity_step(axes: Axes) -> Any:
    """Angular velocity ω of the parent to that of the link, and (ω, velocity-product acceleration)."""
    state = ca.SX.sym("state", 3)
    trig = ca.SX.sym("trig", 6)
    qd = ca.SX.sym("qd", 3)

    joint = BALL_JOINTS[axes]
    angles = angles_of(trig)
    w = joint.angular_velocity(angles, qd)
    carried = joint.rotation(angles).T @ state  # Rᵀ ω_p
    omega = carried + w
    bias = ca.cross(carried, w) + joint.rate_bias(angles, qd)
    return ca.Function("aba_velocity", [state, trig, qd], [omega, ca.vertcat(omega, bias)])
