"""Evaluation of the dynamics by compiled recursions, for single states, many states, and in closed loop."""
