"""The suites of random problems in space by their names: clutter, work places and disturbed jobs, of any links."""

import re
from collections.abc import Callable
from pathlib import Path

from ccm_opt.comparison.space_arms import USUAL_LINKS
from ccm_opt.comparison.space_clutter import space_clutter
from ccm_opt.comparison.space_jobs import JOBS, disturbed_job
from ccm_opt.comparison.space_sites import SITES, site_problem
from ccm_opt.errors import ProblemError
from ccm_opt.space.problem import SpaceProblem

SPACE = "space-"
"""How the names of these suites begin."""
SPACE_SUITES = (
    *(f"{SPACE}clutter-{count}" for count in (20, 40, 80, 160, 320)),
    *(f"{SPACE}{job}" for job in JOBS),
    *(f"{SPACE}{site}" for site in SITES),
)
"""The suites with as many links as usual; any other even number follows as ``-8-links``."""
_NAME = re.compile(
    rf"{SPACE}(clutter-(?P<count>\d{{1,4}})|(?P<job>{'|'.join(JOBS)})|(?P<site>{'|'.join(SITES)}))"
    r"(-(?P<links>\d{1,3})-links)?"
)


def space_maker(suite: str, folder: Path) -> Callable[[int, str], SpaceProblem]:
    """What makes the problems of a suite in space from seeds and names.

    Args:
        suite: its name.
        folder: of the shipped problems in space.

    Raises:
        ProblemError: there is no such suite.
    """
    found = _NAME.fullmatch(suite)
    links = int(found["links"] or USUAL_LINKS) if found else 0
    if found is None or links < 2 or links % 2:
        names = ", ".join(SPACE_SUITES)
        raise ProblemError(
            f"there is no suite '{suite}'; expected one of {names}, or {SPACE}clutter-N with a number of bodies; "
            "each may end in -L-links, with an even number of links"
        )
    if found["job"]:
        return lambda seed, name: disturbed_job(seed, found["job"], links, folder, name)
    if found["site"]:
        return lambda seed, name: site_problem(found["site"], seed, links, name)
    return lambda seed, name: space_clutter(seed, int(found["count"]), links, name)
