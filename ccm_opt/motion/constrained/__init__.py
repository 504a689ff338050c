"""Motions under constraints of the user's own: rows of the step, the certificate, the ends, the smooth path."""
