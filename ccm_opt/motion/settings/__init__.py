"""Settings of every stage of the search for a motion, all frozen; ``MotionSettings`` holds the others."""
