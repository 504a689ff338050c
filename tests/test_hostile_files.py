"""A few mutated files of each kind; ``python -m tests.soak`` reads tens of thousands."""

import random
from itertools import islice

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.soak.hostile_files import drawings, problem_files

COUNT = 40


def drawn(seed: int) -> random.Random:
    """What mutations are drawn by."""
    return random.Random(seed)  # noqa: S311 - no secret


@settings(max_examples=3)
@given(seed=st.integers(0, 2**32))
def test_mutated_problem_files_are_read_or_refused(seed: int) -> None:
    """No mutation gets anything but a problem or an error of ccm_opt, in seconds."""
    defects = [defect for defect in islice(problem_files(drawn(seed)), COUNT) if defect]
    assert not defects


@pytest.mark.parametrize("suffix", [".svg", ".dxf", ".wkt", ".geojson"])
@settings(max_examples=3)
@given(seed=st.integers(0, 2**32))
def test_mutated_drawings_are_read_or_refused(suffix: str, seed: int) -> None:
    """Likewise for drawings of each format."""
    defects = [defect for defect in islice(drawings(suffix, drawn(seed)), COUNT) if defect]
    assert not defects
