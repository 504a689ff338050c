"""Solve for curves and goal poses by nonlinear programs, with the user's constraints and costs compiled and checked."""
