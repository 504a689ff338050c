"""What runs the generated functions: the C library along the arm, and its interpreted stand-in."""
