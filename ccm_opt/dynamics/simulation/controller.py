"""Gains of the tracking laws, and the numbers of the closed loop that they are part of.

The laws themselves, computed torque and PD, are stated in ``runtime/control_law.py``; ``stability.py`` says which gains
their sampled form can hold.

Gains of PD come from the arm. With M(0) the mass matrix of the straight arm and D = diag(Σⱼ |M(0)ᵢⱼ|), Kp = ωn² D and
Kd = 2 ωn D. No lever is longer than along the straight arm, so that in the plane |M(q)ᵢⱼ| ≤ M(0)ᵢⱼ in every pose, and
D − M(q) is diagonally dominant: xᵀ D x ≥ xᵀ M(q) x. So every mode of the errors, M ë + Kd ė + Kp e = M q̈_r, is damped
critically or more, and while the arm moves slowly against ωn no joint is off by more than max |q̈_r| / ωn², however many
links there are, and however light they are.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.dynamics.algorithms.mass_matrix import MassMatrix
from ccm_opt.dynamics.runtime.control_law import LoopParameters
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.driven_arm import DrivenArm
from ccm_opt.problem import Limits, SimulationOptions


@dataclass(frozen=True)
class Gains:
    """Gains on the errors of joints and of their speeds.

    Under computed torque they act on accelerations [1/s², 1/s], under PD on torques [N m/rad, N m s/rad].

    Attributes:
        proportional: shape (3 * links,).
        derivative: shape (3 * links,).
    """

    proportional: FloatArray
    derivative: FloatArray


@dataclass(frozen=True)
class FeedGains:
    """Gains on the error of the base along its feed axis and of its speed [1/s², 1/s] or [N/m, N s/m]."""

    proportional: float
    derivative: float


def gains(arm: DrivenArm, options: SimulationOptions) -> Gains:
    """Gains of the chosen law; computed torque is critically damped at ωn = bandwidth: Kp = ωn², Kd = 2 ωn."""
    joints = np.ones(3 * arm.links)
    bandwidth = options.bandwidth
    if options.controller == "computed-torque":
        return Gains(bandwidth**2 * joints, 2.0 * bandwidth * joints)
    proportional = options.proportional_gain
    derivative = options.derivative_gain
    # Of one that is given the other follows, as for gains that come from the arm.
    if proportional is None and derivative is None:
        inertia = inertia_at_most(arm)
        return Gains(bandwidth**2 * inertia, 2.0 * bandwidth * inertia)
    if proportional is None:
        proportional = 0.5 * bandwidth * (derivative or 0.0)
    if derivative is None:
        derivative = 2.0 * proportional / bandwidth
    return Gains(proportional * joints, derivative * joints)


def inertia_at_most(arm: DrivenArm) -> FloatArray:
    """What any joint can have to move when all bends move, shape (3 * links,) [kg m²].

    Row sums over the bends of the straight arm's mass matrix. Yaws and rolls have those of their bend: about no axis
    through a ball has the arm beyond it more inertia.
    """
    straight = MassMatrix(arm)(np.zeros(3 * arm.links))
    bends = np.sum(np.abs(straight[1::3, 1::3]), axis=1)
    return np.repeat(bends, 3)


def feed_gains(arm: DrivenArm, options: SimulationOptions) -> FeedGains:
    """Gains of the feed axis: critically damped at ωn = bandwidth, under PD for the mass of the arm [N/m, N s/m]."""
    mass = 1.0 if options.controller == "computed-torque" else float(np.sum(arm.masses)) + arm.payload
    return FeedGains(mass * options.bandwidth**2, 2.0 * mass * options.bandwidth)


def loop_parameters(arm: DrivenArm, options: SimulationOptions, limits: Limits) -> LoopParameters:
    """The numbers of the closed loop; efforts saturate at their limits when there are any."""
    joints = gains(arm, options)
    feed = feed_gains(arm, options)
    return LoopParameters(
        step=options.step,
        computed=options.controller == "computed-torque",
        proportional=joints.proportional,
        derivative=joints.derivative,
        feed_proportional=feed.proportional,
        feed_derivative=feed.derivative,
        limit=np.full(3 * arm.links, np.inf) if limits.torque is None else limits.torque,
        feed_limit=np.inf if limits.feed_force is None else limits.feed_force,
    )
