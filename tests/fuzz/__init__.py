"""Drawings that an engine makes which watches what lines of the readers they run: needs the package ``atheris``."""
