"""Drawings of problems and plans."""
