"""Comparison of planners on the same problems: problem suites, runs in worker processes, journal, paired statistics."""
