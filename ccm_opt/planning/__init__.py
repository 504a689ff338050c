"""A certified motion in space: steps, guides, the certificate, the search and the optimisation."""
