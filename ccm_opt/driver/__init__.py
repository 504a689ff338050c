"""The driver: turns a problem into a verified, simulated solution, and replans to new goals while the arm moves."""
