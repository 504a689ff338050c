"""The 1990 baseline as a planner: type selection, then the fold plan (section 4.3), then the region plan (4.1)."""

from ccm_opt.planners.baseline.follower import Follower
from ccm_opt.planners.baseline.hill_climbing_planner import HillClimbingPlanner

__all__ = ["Follower", "HillClimbingPlanner"]
