"""The planner of arms on a feed axis."""

from ccm_opt.feed_planner.planner import FeedPlanner

__all__ = ["FeedPlanner"]
