"""What the arm must avoid: walls and free space, bodies as triangles, distances, and certificates of motions."""
