"""Optimise a certified motion: shorter, smoother and with more clearance, all keyframes at once."""
