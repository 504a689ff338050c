"""Statistics by pairs: against closed forms and counting, and by their coverage on random samples."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.cli.compare.runs import QUANTITIES, Run
from ccm_opt.cli.compare.statistics import (
    compare_figures,
    compare_success,
    median_interval,
    paired_difference_interval,
    success_interval,
)


def run(*, solved: bool = True, **figures: float) -> Run:
    """A run with given figures."""
    return Run("key", "problem", "method", "solved" if solved else "no plan", "", figures)


def success_runs(both: int, first_only: int, second_only: int, neither: int) -> tuple[list[Run], list[Run]]:
    """Runs of two methods with a given table of successes."""
    table = [(True, True)] * both + [(True, False)] * first_only
    table += [(False, True)] * second_only + [(False, False)] * neither
    return [run(solved=one) for one, _ in table], [run(solved=other) for _, other in table]


@given(st.integers(0, 30), st.integers(0, 12), st.integers(0, 12), st.integers(0, 30))
@settings(max_examples=60, deadline=None)
def test_mcnemars_test_counts_the_problems_that_one_method_solves(both: int, b: int, c: int, neither: int) -> None:
    """The exact p is twice the smaller binomial tail at ½, by counting outcomes; agreeing problems do not matter."""
    found = compare_success(*success_runs(both, b, c, neither))
    tail = sum(math.comb(b + c, k) for k in range(min(b, c) + 1)) / 2 ** (b + c)
    assert found.p_value == pytest.approx(min(1.0, 2.0 * tail))
    assert (found.both, found.first_only, found.second_only, found.neither) == (both, b, c, neither)


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 40), st.integers(0, 40))
@settings(max_examples=80, deadline=None)
def test_the_interval_of_a_difference_is_fair_to_both(a: int, b: int, c: int, d: int) -> None:
    """It holds the difference, stays within ±1, and changes sign when the methods change places."""
    if a + b + c + d == 0:
        return
    interval, swapped = paired_difference_interval(a, b, c, d), paired_difference_interval(a, c, b, d)
    difference = (b - c) / (a + b + c + d)
    assert -1.0 - 1e-12 <= interval.low <= difference + 1e-12
    assert difference - 1e-12 <= interval.high <= 1.0 + 1e-12
    assert (interval.low, interval.high) == pytest.approx((-swapped.high, -swapped.low))


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_the_interval_of_a_difference_covers_it() -> None:
    """Over 1500 random tables of 40 problems it covers the true difference in 93 to 98 of a hundred."""
    rng = np.random.default_rng(1)
    chances = np.array([0.6, 0.2, 0.1, 0.1])
    tables = rng.multinomial(40, chances, 1500)
    intervals = [paired_difference_interval(*(int(x) for x in table)) for table in tables]
    covered = np.mean([interval.low <= 0.1 <= interval.high for interval in intervals])
    assert 0.93 <= covered <= 0.98


@pytest.mark.parametrize("share", [0.03, 0.5, 0.9])
def test_the_interval_of_a_share_covers_it(share: float) -> None:
    """The exact interval of 30 trials covers the share with at least 95 %, summed over all outcomes."""
    chance = [math.comb(30, k) * share**k * (1.0 - share) ** (30 - k) for k in range(31)]
    held = [success_interval(k, 30).low <= share <= success_interval(k, 30).high for k in range(31)]
    assert sum(np.array(chance)[held]) >= 0.95


@pytest.mark.parametrize("count", [6, 9, 20, 101])
def test_the_interval_of_a_median_covers_it(count: int) -> None:
    """Whatever the distribution, at least 95 % of the intervals hold the median; here a skew one with median 1."""
    rng = np.random.default_rng(count)
    samples = np.exp(rng.standard_normal((2000, count)) * 3.0)
    bounds = [median_interval(sample) for sample in samples]
    assert np.mean([bound.low <= 1.0 <= bound.high for bound in bounds]) >= 0.94


def test_few_values_bound_no_median() -> None:
    """Five values cannot bound a median at 95 %: all five lie on one side of it in 1 of 16 samples."""
    assert median_interval(np.arange(5.0)).low == -np.inf
    assert median_interval(np.arange(6.0)).low == 0.0
    assert median_interval(np.zeros(0)).high == np.inf


def test_figures_are_compared_where_both_methods_solve() -> None:
    """Ratios are medians by pairs; a problem that one method fails is left out; small differences are ties."""
    first = [run(duration_s=x, tip_error_m=1e-9) for x in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)] + [run(duration_s=9.0)]
    second = [run(duration_s=2.0 * x, tip_error_m=1e-10) for x in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)] + [run(solved=False)]
    found = {item.quantity.key: item for item in compare_figures(first, second)}
    duration, tip, torque = found["duration_s"], found["tip_error_m"], found["peak_torque_Nm"]
    assert (duration.pairs, duration.first, duration.second) == (6, 3.5, 7.0)
    assert (duration.effect, duration.better) == (pytest.approx(0.5), 1.0)
    assert (duration.interval.low, duration.interval.high) == pytest.approx((0.5, 0.5))
    assert (tip.effect, tip.better) == (0.0, 0.5)
    assert math.isnan(tip.p_value)
    assert torque.pairs == 0
    assert math.isnan(torque.effect)


def test_more_clearance_is_better() -> None:
    """Of clearance the greater value wins; of everything else the smaller."""
    better = {
        item.quantity.key: item.better
        for item in compare_figures(
            [run(**{quantity.key: 2.0 for quantity in QUANTITIES})],
            [run(**{quantity.key: 1.0 for quantity in QUANTITIES})],
        )
    }
    assert [key for key, share in better.items() if share == 1.0] == ["least_wall_clearance_m"]


def test_wilcoxons_test_counts_signs_and_ranks() -> None:
    """Eight problems all in favour of one method have p = 2 / 2⁸, by counting the 2⁸ equally likely signs."""
    first = [run(duration_s=1.0) for _ in range(8)]
    second = [run(duration_s=1.5 + 0.1 * k) for k in range(8)]
    found = next(item for item in compare_figures(first, second) if item.quantity.key == "duration_s")
    signs = np.array(list(product((0, 1), repeat=8)))
    extreme = np.isin(signs @ np.arange(1, 9), (0, 36)).mean()
    assert found.p_value == pytest.approx(extreme)
