"""Explanations of why a problem has no plan: necessary conditions, likely causes, and changes that would help."""
