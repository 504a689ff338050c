"""Arms that leave the plane: the scene of bodies and meshes, and what plans and proves motions among them."""
