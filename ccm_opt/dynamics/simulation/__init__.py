"""The arm under its controller: references, disturbances, and the closed loop."""
