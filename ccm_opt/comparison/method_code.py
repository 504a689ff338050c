"""Which code a method runs: a digest of its sources, so that a changed planner is another planner."""

import hashlib
import sys
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from ccm_opt.comparison.methods import METHODS

DIGITS = 16
"""Of the digest that is kept."""
OURS = "ccm_opt"
"""The package whose planners, timing and verifier every run meets."""
NOT_MET = ("cli", "comparison", "files/export", "files/plotting", "files/report")
"""Parts of the package that no run meets; suites of random problems count their own changes."""
SOURCES = frozenset((".py", ".c", ".h", ".so", ".pyd"))
"""Endings of what is code."""


@cache
def code_of(method: str) -> str:
    """Digest of the code that a method runs on this machine, hexadecimal; that of a planner from elsewhere included.

    Args:
        method: of the table, or ``module:attribute``.
    """
    digest = hashlib.sha256(_digest_of_package(OURS, NOT_MET).encode())
    if method == "ompl":
        digest.update(_version("ompl").encode())
    if method not in METHODS:
        # All of the top-level package: a planner may well be changed in a module that its own imports.
        digest.update(_digest_of_package(method.partition(":")[0].partition(".")[0], ()).encode())
    return digest.hexdigest()[:DIGITS]


@cache
def _digest_of_package(name: str, left_out: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for place, file in _sources(name):
        if place.startswith(left_out):
            continue
        digest.update(f"{place}\n".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _sources(name: str) -> Iterator[tuple[str, Path]]:
    """Every source file of a module or package, in order, with its place in it; none where it has no files."""
    spec = find_spec(name) if name not in sys.modules else sys.modules[name].__spec__
    if spec is None:
        return
    folders = list(spec.submodule_search_locations or ())
    if not folders and spec.origin is not None and Path(spec.origin).is_file():
        yield name, Path(spec.origin)
    for folder in map(Path, folders):
        files = (file for file in folder.rglob("*") if file.suffix in SOURCES and file.is_file())
        yield from sorted((file.relative_to(folder).as_posix(), file) for file in files)


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return ""
