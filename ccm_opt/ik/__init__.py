"""Nonlinear programs for curves and goal poses, and users' constraints and costs, compiled and checked."""
