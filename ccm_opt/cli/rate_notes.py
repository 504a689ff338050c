"""A warning where the rates of a feed axis look as if they were in the unit of the file's lengths."""

from ccm_opt.cli.outcome import warn
from ccm_opt.space.problem import AnyProblem

FASTEST_FEED = 10.0
"""Feed velocity from which another unit was probably meant [m/s]. Taste: linear motors reach about 5 m/s."""
HARDEST_FEED = 200.0
"""Feed acceleration from which it was [m/s²]. Taste: linear motors reach about 100 m/s²."""


def tell_of_odd_rates(problem: AnyProblem) -> None:
    """Warn of a feed axis that is faster than any is built; rates are in SI units whatever the unit of lengths."""
    limits = problem.limits
    rates = (
        ("velocity", limits.feed_velocity, FASTEST_FEED, "m/s"),
        ("acceleration", limits.feed_acceleration, HARDEST_FEED, "m/s²"),
    )
    for name, rate, most, unit in rates:
        if rate is None or rate < most:
            continue
        meant = f"; if {rate:g} mm{unit[1:]} is meant, write {rate / 1000.0:g}"
        warn(
            f"{problem.name}: limits.feed_{name} is {rate:g} {unit}, faster than feed axes are: rates are in SI{meant}"
        )
