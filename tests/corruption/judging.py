"""Whether ``ccm-opt check`` judges changed plans right."""

import contextlib
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ccm_opt
from ccm_opt.cli.outcome import SOLVED
from ccm_opt.cli.written_plans import check_folders

from . import of_arrays, of_files, of_motions, still_true
from .plans import KINDS, Folder, Kind

MODULES = (of_arrays, of_files, of_motions, still_true)
"""They enter their kinds where they are loaded."""


@dataclass(frozen=True)
class Judged:
    """A corrupted plan as it was judged.

    Attributes:
        kind: what was done to it.
        plan: name of the plan.
        number: of the draw.
        accepted: whether ``ccm-opt check`` found that every check holds.
        said: what it said.
    """

    kind: Kind
    plan: str
    number: int
    accepted: bool
    said: str

    @property
    def right(self) -> bool:
        """Whether true plans are accepted and all others refused, without a traceback."""
        return self.accepted == self.kind.true and "Traceback" not in self.said


def judged(plans: dict[str, Folder], place: Path, seed: int, count: int) -> Iterator[Judged]:
    """Corrupt plans drawn at random and judge them; every kind comes in turn, beginning with that of the seed."""
    number = 0
    attempt = 0
    while number < count:
        rng = np.random.default_rng((seed, attempt))
        chosen = KINDS[(seed + attempt) % len(KINDS)]
        attempt += 1
        plan = sorted(plans)[int(rng.integers(len(plans)))]
        folder = plans[plan].copy()
        try:
            applies = chosen.change(folder, rng)
        except ccm_opt.ProblemError:
            # A problem that cannot even be made is refused before anything is written.
            applies = False
        if not applies:
            continue
        target = place / f"{number:05d}"
        folder.write(target)
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            code = check_folders([target])
        yield Judged(chosen, plan, number, code == SOLVED, said.getvalue())
        number += 1
