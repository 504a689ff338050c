"""Why there is no plan for an arm in space."""
