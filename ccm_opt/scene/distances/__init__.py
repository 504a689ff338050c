"""Distances of segments from the surfaces of a scene in space, and half-spaces about them that are free."""
