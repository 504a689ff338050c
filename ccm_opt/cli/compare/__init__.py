"""Several planners on the same problems: suites, runs on workers, the journal, statistics by pairs."""
