"""Distances of the arm to walls and to itself, and the certificate that a motion touches nothing between its poses."""
