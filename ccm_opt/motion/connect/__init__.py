"""RRT-Connect in the coordinates of the curve: what finds the plain motions that need no guide."""
