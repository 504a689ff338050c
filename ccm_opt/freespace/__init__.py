"""Free space: workspace, convex regions, triangulation, taut routes (section 4.1)."""
