"""Plane geometry in NumPy: the ground that everything else stands on."""
