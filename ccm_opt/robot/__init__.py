"""Describe the arm: curve segments and curves, coordinates, kinematics, and the mapping from curve to joints."""
