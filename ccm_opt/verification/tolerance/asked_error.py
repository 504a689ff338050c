"""The error of the joints that a problem asks for, against the one that a motion survives, in the plane or in space."""

from ccm_opt.solution import Check, SurvivedError

NAME = "survived joint error"
"""Of the check."""


def check_of(asked: float, survived: SurvivedError) -> Check:
    """The check of an error that is known already, against the one asked for [rad]."""
    # What lies beyond is not looked at, so a problem that asks for more is refused.
    passed = survived.size >= asked
    return Check(NAME, survived.size, asked, "rad", survived.where, passed=passed)
