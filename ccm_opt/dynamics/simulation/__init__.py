"""Simulation of the arm under its controller: references, disturbances, and the closed loop."""
