"""Optimisation of a certified motion over all keyframes at once: shorter, smoother and with more clearance."""
