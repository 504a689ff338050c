"""Trees of poses that are joined by certified motions: the fall-back when no candidate arrives."""
