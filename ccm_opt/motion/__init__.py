"""Motion of the whole arm: tip-led continuation on the links in the coordinates of the curve, certified."""
