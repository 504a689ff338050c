"""The curve of an arm in space: its coordinates, its segments, and the arm that is laid along it."""
