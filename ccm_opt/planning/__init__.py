"""Plan certified motions: routes, guides, steps, limits, search, optimisation and smooth path; and the baseline."""
