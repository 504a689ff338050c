"""Describe what an arm keeps away from: walls and free space, bodies as triangles, distances, certificates."""
