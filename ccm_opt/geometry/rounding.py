"""What counts as rounding, in one place; the verifier has figures of its own, to share none with what it checks."""

ROUNDING = 1e-9
"""Lengths [m] and angles [rad] below this are rounding: a thousandth of what any check of a motion would notice."""
