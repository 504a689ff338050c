"""The arm under its controller: references, disturbances, the closed loop, and braking to rest."""
