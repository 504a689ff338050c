"""Corrupted plans are refused, and true ones are not; ``python -m tests.corruption`` draws as many as one likes."""

from pathlib import Path

import numpy as np

from .corruption.judging import judged
from .corruption.plans import KINDS, write_plans


def test_corruption_is_judged_right(tmp_path: Path) -> None:
    """Of plans corrupted in a fifth of the ways there are, drawn at random, each is refused, and true ones are not."""
    seed = int(np.random.default_rng().integers(2**31))
    wrong = [
        f"seed {seed}, {one.number}: {one.kind.name}, {one.plan}: accepted {one.accepted}\n{one.said}"
        for one in judged(write_plans(tmp_path / "plans"), tmp_path, seed, len(KINDS) // 5)
        if not one.right
    ]
    assert not wrong, "\n".join(wrong)
