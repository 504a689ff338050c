"""Lengths in words: in the unit of the problem's file, whoever makes the words and in whatever units they count."""

import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.length_words import (
    METRES,
    LengthUnit,
    curvature,
    file_length,
    long_length,
    place,
    short_length,
    words_for_unit,
    words_in,
    words_in_plane,
)
from ccm_opt.core.progress import Progress, Stages

from .conftest import PROBLEMS

UNITS: tuple[LengthUnit, ...] = ("m", "mm", "in")
OTHER_UNITS = {"mm": r"\d (m|in)\b(?! of)", "in": r"\d m?m\b"}
"""Lengths in a unit that is not the file's; a torque is no length, and is in newton metres everywhere."""


@given(value=st.floats(1e-6, 1e6), unit=st.sampled_from(UNITS), metres=st.floats(1e-3, 1e3))
def test_words_say_the_length(value: float, unit: LengthUnit, metres: float) -> None:
    """Whatever planners count in, the number before the unit is the length to within a percent or its last digit."""
    with words_in(unit), words_for_unit(metres):
        for words, last in ((long_length(value), 5e-4), (short_length(value), 5e-5), (file_length(value), 0.0)):
            number, said = words.split()
            assert said in {unit, "mm"} if unit == "m" else said == unit
            told = float(number) * METRES[said]
            assert told == pytest.approx(value * metres, rel=0.051, abs=1.01 * last)


def test_every_kind_of_word_has_the_files_unit() -> None:
    """Ways to a millimetre, gaps to a tenth, places and curvatures; outside the block all is in metres as before."""
    with words_in("mm"):
        assert long_length(2.5714) == "2571 mm"
        assert short_length(0.15) == "150.0 mm"
        assert short_length(-0.0) == "0.0 mm"
        assert place((0.7, -0.25)) == "(700, -250) mm"
        assert curvature(4.0) == "0.004 1/mm"
    with words_in("in"):
        assert long_length(0.254) == "10.00 in"
        assert short_length(0.0254) == "1.000 in"
        assert place((0.0254, 0.0, 0.0508)) == "(1.00, 0.00, 2.00) in"
        with words_in_plane():
            assert place((0.0254, 0.0, 0.0508)) == place((0.0254, 0.0508)) == "(1.00, 2.00) in"
        assert file_length(0.0127, 6) == "0.5 in"
    assert (long_length(0.254), short_length(0.0254)) == ("0.254 m", "25.4 mm")


def test_news_from_a_search_keep_their_unit_in_other_threads() -> None:
    """Who prints news later, where nobody has said what the file counts in, still says it in the file's unit."""
    heard: list[Progress] = []
    with words_in("mm"), Stages(heard.append)("motion"):
        pass
    assert str(replace(heard[0], distance=0.0425)).endswith("closest so far 42.5 mm from the goal")
    assert str(Progress("motion", distance=0.0254, unit="in")).endswith("closest so far 1.000 in from the goal")


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize(("name", "unit"), [("wing-box-too-thick", "in"), ("hot-cell-out-of-reach", "mm")])
def test_failures_are_told_in_the_files_unit(name: str, unit: LengthUnit) -> None:
    """Reasons, advice and changes that help name no length in another unit than the file's."""
    problem = replace(ccm_opt.load_problem(PROBLEMS / "jobs" / f"{name}.toml"), length_unit=unit)
    with pytest.raises(NoPlanFound) as failure:
        ccm_opt.solve(replace(problem, planner=replace(problem.planner, time_limit=4.0)))
    said = str(failure.value)
    assert re.search(rf"\d {unit}\b", said)
    assert not re.search(OTHER_UNITS[unit], re.sub(r"\d N m\b", "", said)), said
