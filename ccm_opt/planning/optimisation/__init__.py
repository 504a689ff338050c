"""Makes a certified motion in space shorter, smoother and roomier, all keyframes at once."""
