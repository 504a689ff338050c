"""Make a certified motion shorter, smoother and roomier, all keyframes at once."""
