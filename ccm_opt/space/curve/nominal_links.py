"""The unit of length in which planning measures: a link of an arm of so many links, however many it has."""

NOMINAL_LINKS = 24
"""Nominal links to the length of an arm, the unit of length of all weights in planning."""
