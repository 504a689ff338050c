"""Forward dynamics by the articulated-body algorithm, one ball joint at a time.

Featherstone's algorithm (Rigid Body Dynamics Algorithms, 2008, chapter 7): velocities outward, articulated bodies
inward (``aba_free``; ``aba_geared`` when drives have rotor inertia), accelerations outward.
"""

from typing import Any, NamedTuple

import casadi as ca

from ccm_opt.dynamics.algorithms import aba_free, aba_geared
from ccm_opt.dynamics.algorithms.ball_joint import BALL_JOINTS
from ccm_opt.dynamics.algorithms.model import Structure
from ccm_opt.dynamics.algorithms.sweep import Symbols, angles_of, cross, inward, outward, sines_and_cosines
from ccm_opt.jointed.arm import Axes


class AbaSteps(NamedTuple):
    """Functions of the three sweeps and of what is between them, in order."""

    velocity: Any
    tip: Any
    inertia: Any
    base: Any
    acceleration: Any


def build_aba(structure: Structure) -> Any:
    """CasADi function ``aba(q, qd, tau, thrust, bodies, drives, world) -> (qdd, feed)``, as ``build_rnea`` does.

    A base that does not slide has the acceleration 0, whatever the thrust.
    """
    s, steps = Symbols(structure.links, structure.folded), aba_steps(structure)
    q, qd, tau, thrust = s.column("q"), s.column("qd"), s.column("tau"), s.matrix("thrust", 1, 1)
    bodies, drives, world = s.matrix("bodies", 4, s.links), s.matrix("drives", 6, s.links), s.matrix("world", 5, 1)
    trig, rates = sines_and_cosines(s.per_ball(q)), s.per_ball(qd)
    _, (motion,) = outward(steps.velocity, ca.DM.zeros(3), [trig, rates])
    columns = [trig, motion, s.per_ball(tau), rates, bodies, drives]
    whole, (solved,) = inward(steps.inertia, steps.tip(world), columns)
    at_base, feed = steps.base(whole, thrust, world)
    _, (accelerations,) = outward(steps.acceleration, at_base, [trig, motion, solved, bodies])
    inputs = [q, qd, tau, thrust, bodies, drives, world]
    return ca.Function(
        "aba",
        inputs,
        [ca.vec(accelerations), feed],
        ["q", "qd", "tau", "thrust", "bodies", "drives", "world"],
        ["qdd", "feed"],
    )


def aba_steps(structure: Structure) -> AbaSteps:
    """The algorithm's functions for a structure."""
    variant = aba_geared if structure.geared else aba_free
    return AbaSteps(_velocity_step(structure.axes), *variant.steps(structure.axes))


def _velocity_step(axes: Axes) -> Any:
    """Angular velocity ω of the parent to that of the link, and (ω, velocity-product acceleration)."""
    joint = BALL_JOINTS[axes]
    state, trig, qd = ca.SX.sym("state", 3), ca.SX.sym("trig", 6), ca.SX.sym("qd", 3)
    angles = angles_of(trig)
    w, carried = joint.angular_velocity(angles, qd), joint.rotation(angles).T @ state
    bias = cross(carried, w) + joint.rate_bias(angles, qd)
    return ca.Function("aba_velocity", [state, trig, qd], [carried + w, ca.vertcat(carried + w, bias)])
