"""Keys of the simulation."""

import math
from typing import Annotated

from pydantic import AfterValidator, Field

from ccm_opt.files.problem_file.schema.table import Table
from ccm_opt.files.problem_file.typed_quantities import NonNegative, Positive, Vector
from ccm_opt.problem import ControllerName, Disturbances, SimulationOptions


class GainsTable(Table):
    """Gains of the PD law for every joint: proportional [N m/rad], derivative [N m s/rad]; else they suit the arm."""

    proportional: Positive | None = None
    """[N m/rad]. Default: what suits the arm, or the other gain."""
    derivative: Positive | None = None
    """[N m s/rad]. Default: what suits the arm, or the other gain."""


class DisturbancesTable(Table):
    """What the simulated arm does otherwise than its controller believes."""

    mass_error: Annotated[float, Field(gt=-1.0)] = Disturbances.mass_error
    """Share by which links are heavier."""
    payload: NonNegative = Disturbances.payload
    """Further mass at the tip [kg]."""
    friction: NonNegative = Disturbances.friction
    """Further viscous friction of every revolute [N m s/rad]."""
    angle_noise_deg: Annotated[float, Field(ge=0.0), AfterValidator(math.radians)] = Disturbances.angle_noise
    """Standard deviation of measured angles [deg]; of the bends alone while the arm moves in its plane."""
    velocity_noise: NonNegative = Disturbances.velocity_noise
    """Standard deviation of measured speeds [rad/s], likewise."""
    start_delay: NonNegative = Disturbances.start_delay
    """Time for which brakes still hold the arm when the motion begins [s]."""
    seed: Annotated[int, Field(ge=0)] = Disturbances.seed
    """Of the noise."""


class SimulationTable(Table):
    """How the timed motion is simulated."""

    gravity: Vector = Field(default_factory=SimulationOptions().gravity.tolist)
    """In 3-D [m/s²]; in the plane that is (x, z)."""
    step: Positive = SimulationOptions.step
    """Of the integration [s]."""
    controller: ControllerName = SimulationOptions.controller
    """Control law."""
    bandwidth: Positive = SimulationOptions.bandwidth
    """Natural frequency that both laws are tuned for, on joints and on the feed axis [1/s]."""
    gains: GainsTable = GainsTable()
    """Of the PD law, for every joint: `{ proportional = …, derivative = … }` [N m/rad, N m s/rad]. Default: what [suits
    the arm](dynamics.md#the-closed-loop) at this bandwidth."""
    disturbances: DisturbancesTable = DisturbancesTable()
    """In what the simulated arm differs ([below](#simulation-disturbances))."""
