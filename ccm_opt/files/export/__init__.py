"""The output folder: what a solved problem, or a failed one, leaves on disk, and how it is read again."""
