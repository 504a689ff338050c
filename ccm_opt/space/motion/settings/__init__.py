"""Settings of every stage of the search in space, all frozen; ``SpaceMotionSettings`` holds the others."""
