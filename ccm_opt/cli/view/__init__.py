"""The command ``view``: a motion in 3D in the browser, with a goal and obstacles that can be dragged to plan again."""
