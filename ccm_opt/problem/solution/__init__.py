"""Immutable results: paths, trajectories, simulated motions, checks, poses, reachability maps and Pareto plans."""

from ccm_opt.problem.solution.records import (
    ClearanceLimit,
    ClearanceRecord,
    GoalPoseRecord,
    NearPlace,
    PossibleGap,
    ShortStretch,
    SimulationOutcome,
    SimulationVerdict,
    ToleratedError,
    TryRecord,
)
from ccm_opt.problem.solution.sizes import ArmSize, SizeFront, SizeName, SizeTrial, TrialOutcome
from ccm_opt.problem.solution.solution import (
    BindingSide,
    GoalErrors,
    ParetoPlan,
    ParetoPlans,
    PoseOutcome,
    ReachMap,
    Solution,
    StaticPose,
    goal_errors,
)
from ccm_opt.problem.solution.stage_results import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion
from ccm_opt.problem.solution.tour import Tour, UnvisitedGoal

__all__ = [
    "ArmSize",
    "BindingSide",
    "Check",
    "ClearanceLimit",
    "ClearanceRecord",
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
    "ShortStretch",
    "SimulatedMotion",
    "SimulationOutcome",
    "SimulationVerdict",
    "SizeFront",
    "SizeName",
    "SizeTrial",
    "Solution",
    "StaticPose",
    "ToleratedError",
    "Tour",
    "TrialOutcome",
    "TryRecord",
    "UnvisitedGoal",
    "goal_errors",
]
