"""Warnings of speeds, accelerations and gravity that look as if they were given in another unit than the file's."""

from collections.abc import Iterator

import numpy as np

from ccm_opt.cli.outcome import warn
from ccm_opt.ground.length_units import in_unit
from ccm_opt.problem import Limits
from ccm_opt.space.problem import AnyProblem

FASTEST = {"/s": 10.0, "/s²": 200.0}
"""Arm lengths from which a speed or an acceleration was probably meant otherwise. Taste: linear motors of a metre
reach about 5 m/s and 100 m/s²."""
SLOWEST = 5e-4
"""Arm lengths a second, or a second squared, below which it was: half an hour for the length of an arm. Taste."""
STRONGEST_GRAVITY = 50.0
"""Twice that of Jupiter [m/s²]; on Earth in millimetres it is 9810."""


def tell_of_odd_rates(problem: AnyProblem) -> None:
    """Warn of rates that are out of all proportion to the arm, and of a gravity that no planet has."""
    unit = problem.length_unit
    for key, rate, per in _rates(problem.limits):
        share = rate / problem.arm.length
        if SLOWEST <= share <= FASTEST[per]:
            continue
        warn(
            f"{problem.name}: limits.{key} is {in_unit(rate, unit):.6g} {unit}{per}, {share:.2g} arm lengths{per}: "
            "it is given in the file's unit of length; is that meant?"
        )
    strength = float(np.linalg.norm(problem.simulation.gravity))
    if strength > STRONGEST_GRAVITY:
        warn(f"{problem.name}: simulation.gravity is {strength:.6g} m/s²: it is given in m/s² whatever the file's unit")


def _rates(limits: Limits) -> Iterator[tuple[str, float, str]]:
    """Yield key, value [m/s, m/s²] and what it is per, of every limit that is given on feed axis, tip and points."""
    given = [("feed_velocity", limits.feed_velocity, "/s"), ("feed_acceleration", limits.feed_acceleration, "/s²")]
    for point in limits.points:
        name = "tip_" if point.at is None else f"points at {point.at:g} m, "
        given += [(f"{name}velocity", point.velocity, "/s"), (f"{name}acceleration", point.acceleration, "/s²")]
    return ((key, float(rate), per) for key, rate, per in given if rate is not None and np.isfinite(rate))
