"""Motions of an arm that a feed axis carries through a guide tube: follow-the-leader, gating at the hole, deviation."""
