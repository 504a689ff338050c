"""Rules between keys of a problem file with ``space = 3``: exactly one of several, and keys that need others."""

from collections.abc import Mapping, Sequence

from ccm_opt.files.problem_file.issues import Issues
from ccm_opt.files.problem_file.keypath import KeyPath, lookup
from ccm_opt.files.problem_file.rules import (
    check_contact,
    check_feed_keys,
    check_masses,
    exactly_one,
    goal_paths,
    refuse_equal_names,
)

BODY_KINDS = ("mesh", "box", "sphere", "cylinder", "capsule")
"""Of which every obstacle has exactly one."""
SPACE_START_KINDS = ("shape", "joints_deg")
"""Of which the start has exactly one."""
SPACE_GOAL_KINDS = ("position", "joints_deg", "shape")
"""Of which every goal has exactly one."""


def check_space_alternatives(data: Mapping[str, object], issues: Issues) -> None:
    """Every table that offers alternatives takes exactly one, and keys that need others have them."""
    obstacles = lookup(data, ("workspace", "obstacles"))
    if isinstance(obstacles, list):
        for k in range(len(obstacles)):
            path: KeyPath = ("workspace", "obstacles", k)
            exactly_one(data, path, BODY_KINDS, issues)
            for key in ("scale", "up", "solid", "sha256"):
                _needs(data, path, key, ("mesh",), issues)
            _one_turn(data, path, issues)
        refuse_equal_names(obstacles, issues)
    exactly_one(data, ("start",), SPACE_START_KINDS, issues)
    for path in goal_paths(data):
        exactly_one(data, path, SPACE_GOAL_KINDS, issues)
        for key in ("direction", "via"):
            _needs(data, path, key, ("position",), issues)
    check_masses(data, issues)
    check_contact(data, issues)
    check_feed_keys(data, issues)
    _refuse_planar_planning(data, issues)


def _needs(data: Mapping[str, object], path: KeyPath, key: str, others: Sequence[str], issues: Issues) -> None:
    """A key is only allowed together with one of some others."""
    if lookup(data, (*path, key)) is not None and all(lookup(data, (*path, other)) is None for other in others):
        issues.add((*path, key), f"only allowed together with {' or '.join(others)}")


def _one_turn(data: Mapping[str, object], path: KeyPath, issues: Issues) -> None:
    """A body is turned in one way alone."""
    ways = ("rotation_deg", "quaternion")
    if all(lookup(data, (*path, "pose", way)) is not None for way in ways):
        issues.add((*path, "pose", ways[1]), f"expected only one of {', '.join(ways)}; got both")


def _refuse_planar_planning(data: Mapping[str, object], issues: Issues) -> None:
    """The paper's planner and its mapping know the plane alone."""
    for key, word in (("method", "hill-climbing"), ("mapping", "even-joints")):
        if lookup(data, ("planner", key)) == word:
            issues.add(("planner", key), f'"{word}" is the paper\'s and knows the plane alone; leave it out in space')
