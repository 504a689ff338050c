"""The verifier of motions in the plane as it was before that of the plane and of space became one."""
