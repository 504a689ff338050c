"""What evaluates the dynamics: compiled recursions, for one arm, one state or many, and in a closed loop."""
