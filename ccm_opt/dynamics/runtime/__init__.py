"""Evaluation of an arm's dynamics by compiled recursions, for single states, many states, and in closed loop."""
