"""Foundations used by every other package: errors, array types, plane geometry, lengths in words, executors, IPOPT."""
