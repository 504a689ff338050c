"""Frozen results of every stage, from the curve's keyframes to the simulated arm."""

from ccm_opt.solution.pareto_plans import ParetoPlan, ParetoPlans
from ccm_opt.solution.records import (
    EndRecord,
    GoalPoseRecord,
    NearPlace,
    PossibleGap,
    RoomRecord,
    ShortStretch,
    SimulationOutcome,
    SimulationVerdict,
    SpaceGoalPoseRecord,
    SurvivedError,
    TryRecord,
)
from ccm_opt.solution.solution import GoalErrors, Solution, goal_errors
from ccm_opt.solution.stage_results import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.solution.static_pose import BindingSide, PoseOutcome, ReachMap, StaticPose

__all__ = [
    "BindingSide",
    "Check",
    "EndRecord",
    "GoalErrors",
    "GoalPoseRecord",
    "JointPath",
    "JointStates",
    "JointTrajectory",
    "NearPlace",
    "ParetoPlan",
    "ParetoPlans",
    "PoseOutcome",
    "PossibleGap",
    "ReachMap",
    "RoomRecord",
    "ShortStretch",
    "SimulatedMotion",
    "SimulationOutcome",
    "SimulationVerdict",
    "Solution",
    "SpaceGoalPoseRecord",
    "StaticPose",
    "SurvivedError",
    "TryRecord",
    "goal_errors",
]
