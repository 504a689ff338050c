"""Paired tests and confidence intervals for the comparison of two methods, exact where possible."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ccm_opt.cli.compare.runs import QUANTITIES, Quantity, Run
from ccm_opt.core.arrays import FloatArray

LEVEL = 0.95
"""Confidence level of all intervals."""


@dataclass(frozen=True)
class ConfidenceInterval:
    """The two ends of a confidence interval; infinite if the sample is too small for the level."""

    low: float
    high: float


@dataclass(frozen=True)
class SuccessPair:
    """Paired comparison of how many problems two methods solve.

    Attributes:
        both: number of problems that both solve.
        first_only: number of problems that only the first solves.
        second_only: number of problems that only the second solves.
        neither: number of problems that neither solves.
        p_value: p value of McNemar's exact test of the hypothesis that both solve equally many.
        difference: fraction solved by the first minus fraction solved by the second.
        interval: confidence interval of the difference.
    """

    both: int
    first_only: int
    second_only: int
    neither: int
    p_value: float
    difference: float
    interval: ConfidenceInterval


@dataclass(frozen=True)
class FigurePair:
    """Paired comparison of two methods in one figure, on the problems that both solve.

    Attributes:
        quantity: the figure.
        pairs: number of problems.
        first: median of the first method.
        second: median of the second method.
        effect: median over the problems of the ratio, or difference, between first and second method.
        interval: confidence interval of ``effect``.
        better: fraction of the problems on which the first method is better; ties count half.
        p_value: p value of Wilcoxon's signed-rank test; NaN if no values differ.
    """

    quantity: Quantity
    pairs: int
    first: float
    second: float
    effect: float
    interval: ConfidenceInterval
    better: float
    p_value: float


def success_interval(solved: int, count: int) -> ConfidenceInterval:
    """Return the confidence interval of a proportion by Clopper and Pearson's exact method (Biometrika 26, 1934).

    Args:
        solved: number of successes.
        count: number of trials.
    """
    if count == 0:
        return ConfidenceInterval(0.0, 1.0)
    found = stats.binomtest(solved, count).proportion_ci(LEVEL, method="exact")
    return ConfidenceInterval(float(found.low), float(found.high))


def compare_success(first: Sequence[Run], second: Sequence[Run]) -> SuccessPair:
    """Return the paired comparison of how many problems two methods solve, given their runs, problem by problem.

    The test is McNemar's in its exact form: if both methods are equally good, each problem that only one solves is
    solved by the first with probability ½.
    """
    one = np.array([run.solved for run in first], dtype=bool)
    other = np.array([run.solved for run in second], dtype=bool)
    both = int(np.sum(one & other))
    neither = int(np.sum(~one & ~other))
    first_only = int(np.sum(one & ~other))
    second_only = int(np.sum(~one & other))
    # Problems that both or neither solve say nothing about which method is better.
    apart = first_only + second_only
    p_value = float(stats.binomtest(first_only, apart).pvalue) if apart else 1.0
    difference = (first_only - second_only) / len(one) if len(one) else 0.0
    interval = paired_difference_interval(both, first_only, second_only, neither)
    return SuccessPair(both, first_only, second_only, neither, p_value, difference, interval)


def paired_difference_interval(both: int, first_only: int, second_only: int, neither: int) -> ConfidenceInterval:
    """Return the confidence interval of the difference of two paired proportions (Newcombe's method 10).

    The method combines the squared half widths of Wilson's intervals of both proportions with the correlation of the
    pairs, corrected for continuity if positive (Newcombe, Statistics in Medicine 17, 1998, 2635–2650).

    Args:
        both: number of problems that both methods solve.
        first_only: number of problems that only the first solves.
        second_only: number of problems that only the second solves.
        neither: number of problems that neither solves.
    """
    count = both + first_only + second_only + neither
    if count == 0:
        return ConfidenceInterval(-1.0, 1.0)
    first = both + first_only
    second = both + second_only
    share_1 = first / count
    share_2 = second / count
    low_1, high_1 = _wilson(first, count)
    low_2, high_2 = _wilson(second, count)
    phi = _correlation(both, first_only, second_only, neither)
    # The difference is least when the first share is low and the second high, and the other way round.
    below = _combined(share_1 - low_1, high_2 - share_2, phi)
    above = _combined(high_1 - share_1, share_2 - low_2, phi)
    difference = share_1 - share_2
    return ConfidenceInterval(difference - below, difference + above)


def _combined(first: float, second: float, phi: float) -> float:
    """Return the half width √(a² − 2 φ a b + b²) of the interval of a difference, with correlation φ."""
    return math.sqrt(max(0.0, first**2 - 2.0 * phi * first * second + second**2))


def _wilson(solved: int, count: int) -> tuple[float, float]:
    found = stats.binomtest(solved, count).proportion_ci(LEVEL, method="wilson")
    return float(found.low), float(found.high)


def _correlation(both: int, first_only: int, second_only: int, neither: int) -> float:
    """Return the correlation φ of the success of two methods, corrected for continuity if positive.

    The result is 0 if the correlation is undefined.
    """
    margins = (both + first_only) * (second_only + neither) * (both + second_only) * (first_only + neither)
    if margins == 0:
        return 0.0
    # φ = (ad − bc) / √(product of the four margins) of the table of both outcomes.
    product = float(both * neither - first_only * second_only)
    if product > 0.0:
        product = max(product - (both + first_only + second_only + neither) / 2.0, 0.0)
    return product / math.sqrt(margins)


def compare_figures(first: Sequence[Run], second: Sequence[Run]) -> tuple[FigurePair, ...]:
    """Return the paired comparison of two methods in every figure, on the problems that both solve."""
    pairs = [(one, other) for one, other in zip(first, second, strict=True) if one.solved and other.solved]
    return tuple(_figure_pair(quantity, pairs) for quantity in QUANTITIES)


def _figure_pair(quantity: Quantity, pairs: Sequence[tuple[Run, Run]]) -> FigurePair:
    first, second = _finite_values(quantity, pairs)
    if len(first) == 0:
        unbounded = ConfidenceInterval(-math.inf, math.inf)
        return FigurePair(quantity, 0, math.nan, math.nan, math.nan, unbounded, math.nan, math.nan)

    # Ratios are compared by their logarithms, so that twice and half differ equally from equal.
    by_ratio = quantity.scale == "ratio"
    gap = np.log(first / second) if by_ratio else first - second
    # Ties are set to exactly 0, since the test leaves out pairs that do not differ.
    gap = np.where(np.abs(first - second) <= quantity.tie, 0.0, gap)
    wins = gap > 0.0 if quantity.more_is_better else gap < 0.0
    ties = gap == 0.0

    effect = float(np.median(gap))
    bounds = median_interval(gap)
    if by_ratio:
        # The logarithm is monotonic, so this is the median of the ratios.
        effect = float(np.exp(effect))
        bounds = ConfidenceInterval(float(np.exp(bounds.low)), float(np.exp(bounds.high)))
    return FigurePair(
        quantity=quantity,
        pairs=len(first),
        first=float(np.median(first)),
        second=float(np.median(second)),
        effect=effect,
        interval=bounds,
        better=float(np.mean(wins + 0.5 * ties)),
        p_value=_wilcoxon(gap),
    )


def _finite_values(quantity: Quantity, pairs: Sequence[tuple[Run, Run]]) -> tuple[FloatArray, FloatArray]:
    """Return the values of a figure for two methods on the P problems for which both have a value, each of shape (P,).

    Values compared by ratio must also be positive.
    """
    first = np.array([one.figure(quantity.key) for one, _ in pairs], dtype=np.float64)
    second = np.array([other.figure(quantity.key) for _, other in pairs], dtype=np.float64)
    kept = np.isfinite(first) & np.isfinite(second)
    if quantity.scale == "ratio":
        kept &= (first > 0.0) & (second > 0.0)
    return first[kept], second[kept]


def median_interval(values: FloatArray) -> ConfidenceInterval:
    """Return a distribution-free confidence interval of a median from n samples, shape (n,), by order statistics.

    The number B of values below the median is binomial with probability ½, so the k-th values from both ends enclose
    the median with probability 1 − 2 P(B < k); the largest k that keeps the level is taken (Conover, Practical
    Nonparametric Statistics, section 3.2). Fewer than six values give an infinite interval.
    """
    count = len(values)
    # ppf gives the least k with P(B <= k) of at least the tail, so that P(B < k) stays below it.
    k = int(stats.binom.ppf((1.0 - LEVEL) / 2.0, count, 0.5)) if count else 0
    if k < 1:
        return ConfidenceInterval(-math.inf, math.inf)
    ordered = np.sort(values)
    return ConfidenceInterval(float(ordered[k - 1]), float(ordered[count - k]))


def _wilcoxon(gap: FloatArray) -> float:
    apart = gap[gap != 0.0]
    return float(stats.wilcoxon(apart).pvalue) if len(apart) else math.nan
