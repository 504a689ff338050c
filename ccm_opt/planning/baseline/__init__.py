"""The 1990 baseline, planning by hill climbing: type selection, fold plan (section 4.3) and region plan (4.1)."""
