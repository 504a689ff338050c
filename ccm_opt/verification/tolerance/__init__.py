"""What a verified motion survives: the largest errors of joints, links, base and scene with which it stays clear."""
