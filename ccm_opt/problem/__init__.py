"""A motion-planning problem: frozen data, SI units, radians. ``problem_file`` makes one from TOML."""

from ccm_opt.jointed.drive_limits import DriveLimits, Limits, PointLimit
from ccm_opt.problem.definition import LengthUnit, Problem
from ccm_opt.problem.options import (
    ControllerName,
    Disturbances,
    MethodName,
    OptimiserName,
    PlannerOptions,
    RetimingName,
    SimulationOptions,
    VerificationOptions,
    Weights,
)
from ccm_opt.problem.poses import CurvePose, Goal, JointPose, Start, Stop, TipGoal, Tolerances

__all__ = [
    "ControllerName",
    "CurvePose",
    "Disturbances",
    "DriveLimits",
    "Goal",
    "JointPose",
    "LengthUnit",
    "Limits",
    "MethodName",
    "OptimiserName",
    "PlannerOptions",
    "PointLimit",
    "Problem",
    "RetimingName",
    "SimulationOptions",
    "Start",
    "Stop",
    "TipGoal",
    "Tolerances",
    "VerificationOptions",
    "Weights",
]
