"""A motion-planning problem: frozen data, SI units, radians. ``problem_file`` makes one from TOML."""

from ccm_opt.freespace.obstacle import Obstacle
from ccm_opt.freespace.shaped_obstacles import obstacles_of
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.ground.length_units import LengthUnit
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.drive_limits import DriveLimits, Limits, PointLimit
from ccm_opt.problem.definition import Problem
from ccm_opt.problem.imported_drawing import ImportedDrawing, LeftOut
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
    "Arm",
    "ControllerName",
    "CurvePose",
    "Disturbances",
    "DriveLimits",
    "Goal",
    "ImportedDrawing",
    "JointPose",
    "LeftOut",
    "LengthUnit",
    "Limits",
    "MethodName",
    "Obstacle",
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
    "Workspace",
    "obstacles_of",
]
