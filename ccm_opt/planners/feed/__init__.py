"""The planner of arms on a feed axis."""

from ccm_opt.planners.feed.feed_planner import FeedPlanner

__all__ = ["FeedPlanner"]
