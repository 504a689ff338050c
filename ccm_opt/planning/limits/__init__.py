"""Limits on a motion with a common interface: contact, turns, joint limits, gates, guide tubes, user constraints."""
