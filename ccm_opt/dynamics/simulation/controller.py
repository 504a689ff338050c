"""Gains of the tracking laws, and the numbers of the closed loop that they are part of.

The laws themselves, computed torque and PD, are stated in ``runtime/control_law.py``; ``stability.py`` says which gains
their sampled form can hold.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.dynamics.runtime.control_law import LoopParameters
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import Limits, SimulationOptions


@dataclass(frozen=True)
class Gains:
    """Gains on joint error and joint speed error.

    Under computed torque they act on accelerations [1/s², 1/s], under PD on torques [N m/rad, N m s/rad].
    """

    proportional: float
    derivative: float


def gains(options: SimulationOptions) -> Gains:
    """Gains of the chosen law; computed torque is critically damped at ωn = bandwidth: Kp = ωn², Kd = 2 ωn."""
    if options.controller == "computed-torque":
        return Gains(options.bandwidth**2, 2.0 * options.bandwidth)
    return Gains(options.proportional_gain, options.derivative_gain)


def feed_gains(arm: Arm, options: SimulationOptions) -> Gains:
    """Gains of the feed axis: critically damped at ωn = bandwidth, under PD for the mass of the arm [N/m, N s/m]."""
    mass = 1.0 if options.controller == "computed-torque" else float(np.sum(arm.masses)) + arm.payload
    return Gains(mass * options.bandwidth**2, 2.0 * mass * options.bandwidth)


def loop_parameters(arm: Arm, options: SimulationOptions, limits: Limits) -> LoopParameters:
    """The numbers of the closed loop; efforts saturate at their limits when there are any."""
    joints = gains(options)
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
