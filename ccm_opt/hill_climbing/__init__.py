"""The 1990 baseline: curvature operators, hill climbing, schemas SCM-0 to SCM-8 and the plans made of them."""
