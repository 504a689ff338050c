"""Figures of a comparison as people read them, on the terminal and on the page: millimetres, three digits, no 1e-12."""

import math
from dataclasses import dataclass

from ccm_opt.comparison.runs import Quantity
from ccm_opt.comparison.statistics import ConfidenceInterval, FigurePair
from ccm_opt.files.report.page_units import NONE, three_digits

DECIMALS = 3
"""At most; less than half of the last one is nothing."""
TIMES = "\N{MULTIPLICATION SIGN} "
LEAST_P = 1e-3
"""Smaller probabilities are as good as none."""


@dataclass(frozen=True)
class ShownQuantity:
    """A figure in the unit in which it is shown.

    Attributes:
        quantity: the figure.
        unit: in which it is shown.
        factor: from its own unit.
    """

    quantity: Quantity
    unit: str
    factor: float

    @classmethod
    def of(cls, quantity: Quantity) -> "ShownQuantity":
        """Lengths are shown in millimetres, all else as it is."""
        return cls(quantity, "mm", 1e3) if quantity.unit == "m" else cls(quantity, quantity.unit, 1.0)

    @property
    def title(self) -> str:
        """With the unit."""
        return f"{self.quantity.title} [{self.unit}]"

    def value(self, figure: float) -> str:
        """A value of the figure."""
        return three_digits(self.factor * figure, DECIMALS)

    def effect(self, item: FigurePair) -> str:
        """By how much two methods differ: ``× 0.95`` or ``+1.2``."""
        return self._compared(item.effect)

    def interval(self, interval: ConfidenceInterval) -> str:
        """What that may be; a dash where the problems are too few to say."""
        if not (math.isfinite(interval.low) and math.isfinite(interval.high)):
            return NONE
        return f"{self._compared(interval.low, bare=True)} to {self._compared(interval.high, bare=True)}"

    def _compared(self, value: float, *, bare: bool = False) -> str:
        if not math.isfinite(value):
            return NONE
        # Ratios have no unit; differences have that of the figure.
        if self.quantity.scale == "ratio":
            return f"{'' if bare else TIMES}{three_digits(value, DECIMALS)}"
        text = three_digits(self.factor * value, DECIMALS)
        return f"+{text}" if value > 0.0 and float(text) else text


def probability(value: float) -> str:
    """A p value."""
    if not math.isfinite(value):
        return NONE
    return f"< {LEAST_P:g}" if value < LEAST_P else f"{value:.2g}"


def percents(share: float) -> str:
    """A share."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else NONE
