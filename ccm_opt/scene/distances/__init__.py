"""Distances of segments from the surfaces of a scene in space, and free half-spaces around segments."""
