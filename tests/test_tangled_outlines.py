"""Outlines that cross themselves all over are refused at once, and messages say what stands in a file as it is."""

import time

import numpy as np
import pytest
import shapely

from ccm_opt.cli.outcome import complain
from ccm_opt.core.errors import ProblemError
from ccm_opt.io.outlines import repaired


@pytest.mark.planning
@pytest.mark.parametrize("count", [200, 400, 20_000])
def test_random_outlines_are_refused_at_once(count: int) -> None:
    """A repair of four hundred random corners took a minute."""
    begun = time.process_time()
    with pytest.raises(ProblemError, match="too often to be repaired"):
        repaired(shapely.Polygon(np.random.default_rng(count).random((count, 2))))
    assert time.process_time() - begun < 5.0


@pytest.mark.planning
def test_so_are_holes_upon_each_other() -> None:
    """Of which each edge meets all the others."""
    holes = [[(1, 1), (2, 1), (2, 2)]] * 2000
    with pytest.raises(ProblemError, match="too often to be repaired"):
        repaired(shapely.Polygon([(0, 0), (5, 0), (5, 5), (0, 5)], holes))


def test_messages_have_no_pictures_for_words(capsys: pytest.CaptureFixture[str]) -> None:
    """What stands between colons is a user's text."""
    complain("root:x:0")
    assert "root:x:0" in capsys.readouterr().err
