"""Optimisation of a certified motion over all its keyframes at once: shorter, and certified again."""
