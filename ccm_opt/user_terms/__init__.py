"""Constraints and costs that users write as functions of symbolic quantities of the arm."""
