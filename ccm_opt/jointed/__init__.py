"""The jointed arm: planar kinematics, mapping from curves, ball-joint frames, inverse kinematics (section 5)."""
