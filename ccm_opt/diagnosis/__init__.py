"""Why there is no plan: necessary checks, what is tight, and the least change with which the problem is solved."""
