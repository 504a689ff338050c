"""One mutation for every check of a plan that this check alone catches."""
