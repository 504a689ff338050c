"""Slow and plain twins of compiled C: what the tests hold it against."""
