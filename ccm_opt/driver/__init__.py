"""The driver: from a problem to a verified, simulated solution, and to new goals while the arm moves."""
