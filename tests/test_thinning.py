"""Curves are thinned by C, which keeps the very samples that Python keeps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.files.report.thinning import keep_by_c, keep_by_python, kept_samples
from ccm_opt.ground.c_compiler import has_compiler

seeds = st.integers(0, 2**32 - 1)


def curves(rng: np.random.Generator, samples: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Times, and curves among which there are rough ones, straight ones, steps, and ones that rest."""
    time = np.cumsum(rng.uniform(1e-3, 1.0, samples))
    kinds = (rng.normal(size=samples), 3.0 * time, np.round(rng.normal(size=samples)), np.zeros(samples), np.sin(time))
    scales = 10.0 ** rng.integers(-6, 7, width)
    columns = np.array([kinds[k] for k in rng.integers(0, len(kinds), width)]).reshape(width, samples).T
    return time, columns * scales


@pytest.mark.skipif(not has_compiler(), reason="needs a C compiler")
@settings(max_examples=200)
@given(
    seed=seeds,
    samples=st.integers(1, 200),
    width=st.integers(1, 9),
    tolerance=st.sampled_from([0.0, 1e-3, 0.3]),
    most=st.integers(0, 250),
)
def test_c_keeps_what_python_keeps(seed: int, samples: int, width: int, tolerance: float, most: int) -> None:
    """Whatever the curves are and however many samples may be kept, to the last one."""
    rng = np.random.default_rng(seed)
    time, columns = curves(rng, samples, width)
    marked = rng.uniform(size=samples) < 0.05
    marked[[0, -1]] = True
    by_c = marked.copy()
    assert keep_by_c(by_c, time, columns, tolerance, most)
    keep_by_python(marked, time, columns, tolerance, most)
    np.testing.assert_array_equal(by_c, marked)


@given(seed=seeds, samples=st.integers(2, 100))
def test_no_more_samples_are_kept_than_are_asked_for(seed: int, samples: int) -> None:
    """Beside the ends, the extremes of each curve, and those that are asked for in any case."""
    time, columns = curves(np.random.default_rng(seed), samples, 3)
    kept = kept_samples(time, columns, 0.0, 5, np.array([samples // 2], dtype=np.intp))
    assert len(kept) <= 5 + 2 + 2 * 3 + 1
    assert {0, samples // 2, samples - 1} <= set(kept.tolist())


def test_numbers_that_are_none_are_left_to_python() -> None:
    """A curve with a gap in it has its other samples thinned as ever."""
    time = np.arange(9.0)
    columns = np.stack((time**2, np.where(time == 4.0, np.inf, time)), axis=1)
    with np.errstate(invalid="ignore"):
        assert {0, 4, 8} <= set(kept_samples(time, columns, 0.1, 9, np.zeros(0, dtype=np.intp)).tolist())
