"""Tests: laws, algorithms against independent oracles, promises of the package's commands and files."""

import os
import sys

# Dozens of processes that the tests start load the package, and compiling it takes each two seconds: what one has
# compiled is kept for the others, also where the environment asks Python to keep nothing.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
