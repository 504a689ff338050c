"""A motion-planning problem as frozen data in SI units and radians; ``ccm_opt.load_problem`` reads one from TOML."""

from ccm_opt.core.length_words import LengthUnit
from ccm_opt.problem.definition import Problem
from ccm_opt.problem.field_types import ImportedArm, ImportedDrawing, ImportedJoint, LeftOut
from ccm_opt.problem.options import (
    ControllerName,
    Disturbances,
    MethodName,
    OptimiserName,
    OrderName,
    PlannerOptions,
    RetimingName,
    SimulationOptions,
    TourEnd,
    VerificationOptions,
    Weights,
)
from ccm_opt.problem.poses import Coverage, Goal, JointPose, LookAt, Stop, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import DriveLimits, Limits, PointLimit
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace, obstacles_of

__all__ = [
    "Arm",
    "ControllerName",
    "Coverage",
    "Disturbances",
    "DriveLimits",
    "Goal",
    "ImportedArm",
    "ImportedDrawing",
    "ImportedJoint",
    "JointPose",
    "LeftOut",
    "LengthUnit",
    "Limits",
    "LookAt",
    "MethodName",
    "Obstacle",
    "OptimiserName",
    "OrderName",
    "PlaneShape",
    "PlannerOptions",
    "PointLimit",
    "Problem",
    "RetimingName",
    "SimulationOptions",
    "Stop",
    "TipGoal",
    "Tolerances",
    "TourEnd",
    "VerificationOptions",
    "Weights",
    "Workspace",
    "obstacles_of",
]
