"""RRT-Connect of OMPL, the Open Motion Planning Library (extra ``ompl``), under our own certificate: a peer."""

from ccm_opt.planners.ompl_peer.ompl_planner import OmplPlanner

__all__ = ["OmplPlanner"]
