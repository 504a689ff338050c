"""Scripts that print tables of ratios; run them by hand."""
