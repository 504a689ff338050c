"""Comparison of planners on the same problems: suites, runs on workers, the journal, paired statistics."""
