"""``ccm-opt view``: a motion in 3D in the browser, with a goal and walls that can be dragged."""
