"""Curves of the page are thinned to no more samples than are asked for."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.viz.time_series import select_samples

seeds = st.integers(0, 2**32 - 1)


def curves(rng: np.random.Generator, samples: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Times, and curves among which there are rough ones, straight ones, steps, and ones that rest."""
    time = np.cumsum(rng.uniform(1e-3, 1.0, samples))
    kinds = (rng.normal(size=samples), 3.0 * time, np.round(rng.normal(size=samples)), np.zeros(samples), np.sin(time))
    scales = 10.0 ** rng.integers(-6, 7, width)
    columns = np.array([kinds[k] for k in rng.integers(0, len(kinds), width)]).reshape(width, samples).T
    return time, columns * scales


@given(seed=seeds, samples=st.integers(2, 100))
def test_no_more_samples_are_kept_than_are_asked_for(seed: int, samples: int) -> None:
    """Beside the ends, the extremes of each curve, and those that are asked for in any case."""
    time, columns = curves(np.random.default_rng(seed), samples, 3)
    kept = select_samples(time, columns, 0.0, 5, np.array([samples // 2], dtype=np.intp))
    assert len(kept) <= 5 + 2 + 2 * 3 + 1
    assert {0, samples // 2, samples - 1} <= set(kept.tolist())


def test_curves_with_gaps_are_thinned() -> None:
    """A curve with a gap in it has its other samples thinned as ever."""
    time = np.arange(9.0)
    columns = np.stack((time**2, np.where(time == 4.0, np.inf, time)), axis=1)
    with np.errstate(invalid="ignore"):
        assert {0, 4, 8} <= set(select_samples(time, columns, 0.1, 9, np.zeros(0, dtype=np.intp)).tolist())
