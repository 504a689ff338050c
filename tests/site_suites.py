"""Suites of random sites in space for ``compare``: ``--suite tests.site_suites:tank``, or ``tank_48`` of 48 links."""

import re
from collections.abc import Callable
from functools import partial

from ccm_opt.problem import Problem

from .space_sites import SITES, site_problem


def __getattr__(name: str) -> Callable[[int, str], Problem]:
    """Return the function that makes problems of a family from a seed and a name."""
    family, links = re.fullmatch(r"(\w+?)_?(\d*)", name).groups()  # type: ignore[union-attr]
    if family.replace("_", "-") not in SITES:
        raise AttributeError(name)
    return partial(_made, family.replace("_", "-"), int(links or 24))


def _made(family: str, links: int, seed: int, name: str) -> Problem:
    return site_problem(family, seed, links, name)
