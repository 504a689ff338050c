"""``ccm-opt view``: a motion in space, in the browser, with a goal and walls that can be dragged."""
