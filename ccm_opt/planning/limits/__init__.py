"""Limits on a motion behind one interface: contact, turns, joint limits, gates, guide tubes, user constraints."""
