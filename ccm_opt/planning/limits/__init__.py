"""Limits of a motion, behind one interface: contact, turns, joint limits, gates, guide tubes, users' constraints."""
