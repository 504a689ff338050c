"""Tables of numbers are written by C, letter for letter as Python writes them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.files.export.number_writing import number_rows, rows_by_c, rows_by_python
from ccm_opt.ground.c_compiler import has_compiler

pytestmark = pytest.mark.skipif(not has_compiler(), reason="needs a C compiler")
BITS = st.integers(0, 2**64 - 1).map(lambda bits: float(np.uint64(bits).view(np.float64)))
TIES = st.builds(lambda whole, power: whole * 2.0**-power, st.integers(-(10**7), 10**7), st.integers(0, 80))
"""Among them many numbers of thirteen digits whose last is a five: halves of the last one written."""
ROUND = st.builds(lambda whole, power: whole * 10.0**power, st.integers(-1000, 1000), st.integers(-320, 8))
NEAR_POWERS = st.builds(
    lambda power, up: float(np.nextafter(10.0**power, up)), st.integers(-320, 12), st.sampled_from([-1e300, 1e300])
)
SMALL = st.one_of(BITS, TIES, ROUND, NEAR_POWERS).filter(lambda number: abs(number) < 1e12)
EDGES = [0.0, -0.0, 5e-324, -2.2250738585072014e-308, 9.9999999999995e-5, 0.1, 123456789012.0, 999999999999.5]


@st.composite
def tables(draw: st.DrawFn) -> np.ndarray:
    """Tables of which some columns are zeros alone."""
    rows = draw(st.integers(1, 4))
    width = draw(st.integers(0, 4))
    numbers = st.one_of(SMALL, st.sampled_from(EDGES))
    table = np.array(draw(st.lists(numbers, min_size=rows * width, max_size=rows * width))).reshape(rows, width)
    table[:, draw(st.lists(st.booleans(), min_size=width, max_size=width))] *= 0.0
    return table


@settings(max_examples=300)
@given(table=tables())
def test_c_writes_what_python_writes(table: np.ndarray) -> None:
    """Any finite number below 10¹², ties and numbers just beside powers of ten among them."""
    assert rows_by_c(table) == rows_by_python(table)


def test_many_numbers_of_all_sizes_are_written_alike() -> None:
    """Hundreds of thousands of bit patterns, and numbers in the middle between two of twelve digits."""
    rng = np.random.default_rng(4)
    any_bits = rng.integers(0, 2**64, size=(4000, 20), dtype=np.uint64).view(np.float64)
    any_bits[~(np.abs(any_bits) < 1e12)] = 1.5
    middle = (rng.integers(10**11, 10**12, size=(4000, 20)) + 0.5) * 10.0 ** -rng.integers(0, 25, size=(4000, 20))
    for table in (any_bits, middle, np.nextafter(middle, 0.0), np.nextafter(middle, 1e300)):
        assert rows_by_c(table) == rows_by_python(table)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e12, -1e300])
def test_what_c_does_not_write_is_written_by_python(number: float) -> None:
    """A number of more than twelve digits, or none, is no reason to write no file."""
    table = np.array([[1.0, number], [2.5, 0.0]])
    assert rows_by_c(table) is None
    assert number_rows(table) == rows_by_python(table)
    assert number_rows(table)[1] == "2.5,0.0"
