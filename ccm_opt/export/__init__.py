"""The output folder: solution.json, solution.npz, trajectory.csv."""
