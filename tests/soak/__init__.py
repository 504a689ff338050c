"""What runs for hours and finds what a gate of minutes does not: ``python -m tests.soak --hours 1``."""
