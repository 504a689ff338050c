"""Which cases of dear tests are run: some that are drawn anew in each run.

Of a test marked ``drawn(count)`` that many cases are run, of all tests marked ``drawn(count, of="name")``, in whichever
files, as many together. Over a few runs all cases have been run. Of files that the command line names all cases are
run, and with ``--all-cases`` of all files.
"""

from collections.abc import Sequence
from random import Random

import pytest


def left_out_cases(items: Sequence[pytest.Item], seed: str) -> set[pytest.Item]:
    """Return the items that are not run: of those that are marked, the ones that a seed does not draw."""
    groups: dict[str, list[pytest.Item]] = {}
    counts: dict[str, int] = {}
    for item in items:
        if (mark := item.get_closest_marker("drawn")) is not None:
            group = mark.kwargs.get("of", item.nodeid.split("[")[0])
            groups.setdefault(group, []).append(item)
            counts[group] = max(counts.get(group, 0), *mark.args)
    left_out = set()
    for group, cases in groups.items():
        random = Random(f"{group} {seed}")  # noqa: S311 - not for secrets
        left_out |= {*cases} - {*random.sample(cases, min(counts[group], len(cases)))}
    return left_out
