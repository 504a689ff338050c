"""Scene of an arm: walls and free space, bodies as triangles, distances, and collision-free certificates."""
