"""Which plans show the trade-off between time and room, and which of them is recommended."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ParetoSettings:
    """Numbers of the trade-off; all of them are taste.

    Attributes:
        shares: wanted gaps of the plans after the first, as shares of the way from the gap that the first keeps
            unasked to the largest; the last must be 1. The largest is ``most`` times the default, or the upper bound of
            what the scene has where that is less.
        most: the largest wanted gap, in default ones.
        least_top: share of the default wanted gap below which a bound does not shrink the wanted gaps: where an end has
            next to nothing, the motion can still keep room elsewhere.
        enough_of_top: share of the largest wanted gap that its plan must keep; where the scene proves narrower, the gap
            that it kept takes its place, so that the five plans differ.
        narrowings: times that this may happen; wanting what another motion kept need not lead to that motion.
        most_time: share of the fastest plan's duration by which the recommended one may be slower.
        same_gap: gaps that differ by less than this share of the arm's length count as equal.
        same_time: durations that differ by less than this share count as equal.
    """

    shares: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0)
    most: float = 4.0
    least_top: float = 0.5
    enough_of_top: float = 0.9
    narrowings: int = 2
    most_time: float = 0.15
    same_gap: float = 1e-4
    same_time: float = 1e-3


DEFAULT_PARETO = ParetoSettings()
"""Used where no other settings are given."""
