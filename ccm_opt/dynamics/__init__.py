"""Rigid-body dynamics of an arm in space, the timing of its motions, and their simulation (paper, section 5.4)."""
