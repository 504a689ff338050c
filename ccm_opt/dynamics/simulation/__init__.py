"""Simulation of an arm under its controller: references, disturbances, and the control loop."""
