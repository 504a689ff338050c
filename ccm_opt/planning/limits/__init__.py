"""Limits of a motion: contact, turns, joint limits, the user's constraints; one file each, behind one interface."""
