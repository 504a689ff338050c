"""The arm: curve segments and curves, joint coordinates, kinematics, and the mapping from curve to joints."""
