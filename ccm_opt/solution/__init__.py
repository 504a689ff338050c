"""Frozen results of every stage, from the curve's keyframes to the simulated arm."""

from ccm_opt.solution.goal_pose_record import GoalPoseRecord, SpaceGoalPoseRecord
from ccm_opt.solution.pareto_plans import ParetoPlan, ParetoPlans
from ccm_opt.solution.reach_record import ReachMap
from ccm_opt.solution.room_record import NearPlace, PossibleGap, RoomRecord, ShortStretch
from ccm_opt.solution.simulation_verdict import SimulationOutcome, SimulationVerdict
from ccm_opt.solution.solution import Solution, SolutionOf
from ccm_opt.solution.stage_results import (
    Check,
    JointPath,
    JointStates,
    JointTrajectory,
    SimulatedMotion,
)
from ccm_opt.solution.static_pose import BindingSide, PoseOutcome, StaticPose
from ccm_opt.solution.survived_error import SurvivedError
from ccm_opt.solution.try_record import TryRecord

__all__ = [
    "BindingSide",
    "Check",
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
    "SolutionOf",
    "SpaceGoalPoseRecord",
    "StaticPose",
    "SurvivedError",
    "TryRecord",
]
