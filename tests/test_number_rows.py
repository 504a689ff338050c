"""Long texts of numbers are read by C, which must never find more agreement than Python does."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ccm_opt.files.export.number_rows import rows_agree

SHARE = 5.1e-12
"""Twelve digits are written."""
NUMBERS = st.one_of(
    st.sampled_from([0.0, -0.0, 1.0, -1e22, 1e23, 1e-300, 5e-324, 1.7976931348623157e308, 123456789012.0]),
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(-10.0, 10.0),
)
WORDS = st.sampled_from(["{sec: ", ", ", "]\n  velocities: [", "x", "\n- "])
"""None begins like a number goes on, and there is one between any two."""


@st.composite
def tables(draw: st.DrawFn) -> tuple[str, list[str], list[np.ndarray]]:
    """Rows of numbers as a text, the words between them, and the numbers in parts."""
    rows = draw(st.integers(1, 3))
    widths = draw(st.lists(st.integers(0, 3), min_size=1, max_size=3))
    parts = [np.array(draw(st.lists(NUMBERS, min_size=rows * n, max_size=rows * n))).reshape(rows, n) for n in widths]
    words = draw(st.lists(WORDS, min_size=sum(widths) + 1, max_size=sum(widths) + 1))
    return text_of(words, parts), words, parts


def text_of(words: list[str], parts: list[np.ndarray]) -> str:
    """The rows as they are written."""
    written = []
    for row in np.concatenate(parts, axis=1).tolist():
        written += [f"{word}{number:.12g}" for word, number in zip(words[:-1], row, strict=True)]
        written.append(words[-1])
    return "".join(written)


def read_by_python(text: str, words: list[str], rows: int) -> list[float] | None:
    """The numbers of a text; None where other words stand between them."""
    numbers = []
    for _ in range(rows):
        for word, following in itertools.pairwise(words):
            if not text.startswith(word):
                return None
            number, _, text = text[len(word) :].partition(following)
            text = following + text
            try:
                numbers.append(float(number))
            except ValueError:
                return None
        if not text.startswith(words[-1]):
            return None
        text = text[len(words[-1]) :]
    return None if text else numbers


@settings(max_examples=40)
@given(table=tables())
def test_what_is_written_agrees(table: tuple[str, list[str], list[np.ndarray]]) -> None:
    """Numbers of all sizes, as they are written with twelve digits, are those of the arrays."""
    text, words, parts = table
    assert rows_agree(text, words, parts, SHARE)


@settings(max_examples=40)
@given(table=tables(), data=st.data())
def test_what_was_changed_agrees_only_where_python_says_so(
    table: tuple[str, list[str], list[np.ndarray]], data: st.DataObject
) -> None:
    """Letters lost, put in and changed at random: agreement is never found where reading the text denies it."""
    text, words, parts = table
    place = data.draw(st.integers(0, len(text)))
    lost = data.draw(st.integers(0, 2))
    changed = text[:place] + data.draw(st.text("0123456789.eE+-, \nx\0é", max_size=2)) + text[place + lost :]
    if rows_agree(changed, words, parts, SHARE):
        found = read_by_python(changed, words, len(parts[0]))
        assert found is not None
        np.testing.assert_allclose(found, np.concatenate(parts, axis=1).ravel(), rtol=1.01 * SHARE, atol=3e-308)


@settings(max_examples=40)
@given(table=tables(), data=st.data())
def test_a_number_that_is_another_does_not_agree(
    table: tuple[str, list[str], list[np.ndarray]], data: st.DataObject
) -> None:
    """One number off by more than is allowed is seen, wherever it stands."""
    text, words, parts = table
    numbers = np.concatenate(parts, axis=1)
    assume(numbers.size > 0)
    k = data.draw(st.integers(0, numbers.size - 1))
    # Towards zero, so that none becomes infinite; the least numbers are all alike.
    off = data.draw(st.sampled_from([1e-11, 0.5, 2.0]))
    assume(abs(numbers.flat[k]) > 1e-290)
    numbers.flat[k] *= 1.0 - off
    assert not rows_agree(text, words, [numbers], SHARE)


@pytest.mark.parametrize("number", ["", ".5", "5.", "1e", "1e+", "--1", "+1", "nan", "inf", "1,", "0x1", "1.0.0"])
def test_what_is_no_plain_number_is_left_to_others(number: str) -> None:
    """A reader that knows less refuses more."""
    one = np.ones((1, 1))
    assert rows_agree("1\n", ["", "\n"], [one], SHARE)
    assert not rows_agree(f"{number}\n", ["", "\n"], [one], SHARE)
