"""A motion-planning problem: frozen data, SI units, radians. ``problem_file`` makes one from TOML."""

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.continuum.configuration import Configuration
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.jointed.arm import Arm, MappingName

MethodName = Literal["nlp"]
OptimiserName = Literal["sequential-convex", "interior-point", "none"]
ControllerName = Literal["computed-torque", "pd"]


@dataclass(frozen=True)
class Limits:
    """Bounds on every revolute joint; each array has shape (3 * links,), the three revolutes of a ball in a row.

    Attributes:
        velocity: [rad/s].
        acceleration: [rad/s²].
        torque: [N m], or None when torque is not limited.
    """

    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray | None = None


@dataclass(frozen=True)
class JointPose:
    """A whole-arm pose given by joint bends, shape (links,) [rad]."""

    bends: FloatArray


@dataclass(frozen=True)
class CurvePose:
    """A whole-arm pose given as a curve; the arm takes its mapping."""

    configuration: Configuration


@dataclass(frozen=True)
class TipGoal:
    """A goal for the tip alone.

    Attributes:
        position: shape (2,) [m].
        heading: [rad], or None when any heading will do.
    """

    position: FloatArray
    heading: float | None = None


Start: TypeAlias = JointPose | CurvePose
Goal: TypeAlias = TipGoal | JointPose | CurvePose


@dataclass(frozen=True)
class Tolerances:
    """How near the goal the motion must end: position [m] and heading [rad]."""

    position: float = 1e-3
    heading: float = float(np.deg2rad(1.0))


@dataclass(frozen=True)
class PlannerOptions:
    """Which planner, how long, and with what.

    Attributes:
        method: planner's name.
        mapping: how a curve becomes joints.
        time_limit: wall time [s] after which the search stops.
        routes: corridors tried, shortest first.
        seed: of every random choice.
        optimiser: how the motion that is found is optimised over all its keyframes; by "none" it stays long.
    """

    method: MethodName = "nlp"
    mapping: MappingName = "least-squares"
    time_limit: float = 60.0
    routes: int = 5
    seed: int = 0
    optimiser: OptimiserName = "sequential-convex"


@dataclass(frozen=True)
class SimulationOptions:
    """How the timed motion is simulated.

    Attributes:
        gravity: shape (3,) [m/s²]; the plane of motion is x-z.
        step: integration step [s].
        controller: the tracking law.
        bandwidth: natural frequency ωn of the computed-torque error dynamics [1/s].
        proportional_gain: of the PD law [N m/rad].
        derivative_gain: of the PD law [N m s/rad].
    """

    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    step: float = 1e-3
    controller: ControllerName = "computed-torque"
    bandwidth: float = 50.0
    proportional_gain: float = 2.0
    derivative_gain: float = 0.002


@dataclass(frozen=True)
class Problem:
    """One planning problem.

    Attributes:
        name: also names the output folder.
        description: one line for people.
        workspace: room, obstacles, clearance.
        arm: the jointed arm.
        limits: bounds on joint speed, acceleration and torque.
        start: where the motion begins.
        goal: where it ends.
        tolerances: how near the goal counts.
        planner: planner options.
        simulation: simulation options.
        source: the text of the problem file, kept for the record; empty when built in Python.
    """

    name: str
    workspace: Workspace
    arm: Arm
    limits: Limits
    start: Start
    goal: Goal
    description: str = ""
    tolerances: Tolerances = field(default_factory=Tolerances)
    planner: PlannerOptions = field(default_factory=PlannerOptions)
    simulation: SimulationOptions = field(default_factory=SimulationOptions)
    source: str = ""
