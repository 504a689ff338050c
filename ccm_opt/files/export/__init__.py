"""The output folder: what a solved problem, or a failed one, leaves on disk (``folder``), and how it is read again."""
