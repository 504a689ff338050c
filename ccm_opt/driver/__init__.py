"""Top-level functions: solving a problem to a verified, simulated plan, and replanning while the arm moves."""
