"""The ground that all else stands on: array types, plane geometry, rounding, the stage clock, calls of IPOPT."""
