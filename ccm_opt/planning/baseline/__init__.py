"""The 1990 baseline as a planner: type selection, then the fold plan (section 4.3), then the region plan (4.1)."""
