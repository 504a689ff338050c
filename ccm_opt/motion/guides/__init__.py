"""Guides of the continuation: what draws the arm on, step by step."""
