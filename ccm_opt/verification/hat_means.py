"""Means around samples, weighted by the hat that is highest at a sample and 0 at its neighbours."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.ground.arrays import FloatArray


@dataclass(frozen=True)
class HatMeans:
    """What values at samples say of the means around the inner ones, T − 2 of them; values have any further shape.

    Attributes:
        time: of the samples, shape (T,) [s].
    """

    time: FloatArray

    @property
    def steps(self) -> tuple[FloatArray, FloatArray]:
        """Steps before and after the inner samples, each of shape (T − 2,) [s]."""
        step = np.diff(self.time)
        return step[:-1], step[1:]

    def mean(self, values: FloatArray) -> FloatArray:
        """Means of what is linear between samples, shape (T − 2, …)."""
        before, after = self._beside(values)
        change = after * (values[2:] - values[1:-1]) + before * (values[:-2] - values[1:-1])
        return np.asarray(values[1:-1] + change / (3.0 * (before + after)))

    def first(self, values: FloatArray) -> FloatArray:
        """Mean rates over both steps, shape (T − 2, …)."""
        before, after = self._beside(values)
        return np.asarray((values[2:] - values[:-2]) / (before + after))

    def second(self, values: FloatArray) -> FloatArray:
        """Second difference quotients: exactly the means of second derivatives, shape (T − 2, …)."""
        before, after = self._beside(values)
        rates = np.diff(values, axis=0)
        return np.asarray(2.0 * (rates[1:] / after - rates[:-1] / before) / (before + after))

    def at(self, sample: int) -> "HatMeans":
        """Of one inner sample, counted from 0, alone."""
        return HatMeans(self.time[sample : sample + 3])

    def variance(self, values: FloatArray) -> FloatArray:
        """Bound on the mean square of how far vectors (3, …, d) at the samples of one are from their mean, (…)."""
        before, after = (float(step[0]) for step in self.steps)
        # A square is convex, so that between samples it is below what is linear.
        weights = np.array([before, 2.0 * (before + after), after]) / (3.0 * (before + after))
        away = np.sum((values - self.mean(values)) ** 2, axis=-1)
        return np.asarray(np.tensordot(weights, away, axes=1))

    def _beside(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        before, after = (step.reshape(-1, *[1] * (values.ndim - 1)) for step in self.steps)
        return before, after
