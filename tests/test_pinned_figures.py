"""No figure of proofs and verifier changes unnoticed, be it one that only costs time or is a little too strict."""

import sys

import pytest

from tests.pinned import read_figures
from tests.pinned.recording import changed, figures_of
from tests.pinned.scenes import SCENES

FIGURES = read_figures()


@pytest.mark.drawn(10)
@pytest.mark.planning
@pytest.mark.parametrize("name", sorted(SCENES))
def test_what_functions_return_in_made_up_scenes_is_as_it_was(name: str) -> None:
    """Where a change is meant: ``python -m tests.pinned`` tells what changed, and writes the figures anew."""
    found = figures_of(SCENES[name])
    others = changed(FIGURES[name], found)
    assert not others, "if they are meant to change: python -m tests.pinned"
    if sys.gettrace() is None:  # under coverage nothing is left out either, but names may be
        assert len(set(FIGURES[name]) & set(found)) > len(FIGURES[name]) // 2
