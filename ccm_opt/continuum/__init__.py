"""The continuous curvature manipulator: segments, configurations, forward kinematics, segment types (section 2)."""
