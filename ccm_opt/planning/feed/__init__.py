"""The planner of arms on a feed axis."""
