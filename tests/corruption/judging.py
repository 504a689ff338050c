"""Check whether ``ccm-opt check`` rejects corrupted plans and accepts changed but correct ones."""

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
"""Modules that register kinds of changes when they are imported."""


@dataclass(frozen=True)
class Judged:
    """Verdict of ``ccm-opt check`` on a changed plan.

    Attributes:
        kind: kind of the change.
        plan: name of the plan.
        number: number of the random change, from 0.
        accepted: whether ``ccm-opt check`` accepted the plan.
        said: output of ``ccm-opt check``.
    """

    kind: Kind
    plan: str
    number: int
    accepted: bool
    said: str

    @property
    def right(self) -> bool:
        """Whether the verdict is correct and the output has no traceback."""
        return self.accepted == self.kind.true and "Traceback" not in self.said


def judged(plans: dict[str, Folder], place: Path, seed: int, count: int) -> Iterator[Judged]:
    """Change random plans, and yield the verdict of ``ccm-opt check`` on each; the kinds of changes are used in turn.

    Args:
        plans: folders of plans, by name.
        place: folder for the changed plans.
        seed: seed of the random changes, which also selects the first kind.
        count: number of verdicts.
    """
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
            # An invalid problem is refused before any file is written.
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
