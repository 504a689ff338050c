"""Error tolerance of a verified motion: the largest errors of joints, links, base and scene that cause no contact."""
