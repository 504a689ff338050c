"""Foundations of all other packages: errors, array types, plane geometry, lengths in messages, executors, IPOPT."""
