"""The planners: problem to joint path, for a fixed base, for a feed axis, and the baseline of hill climbing."""
