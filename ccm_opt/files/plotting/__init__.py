"""Pictures of plans, simulations and comparisons, and the film; nothing else in the package draws."""
