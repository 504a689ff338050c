"""Tolerances with which the values of a problem file are held against each other, and how a folded arm lies."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ReadingSettings:
    """Tolerances with which the values of a problem file are held against each other.

    Attributes:
        length_tolerance: relative difference allowed between the total length of a pose's segments and the arm's
            length. Taste: lengths are written with six digits or more.
        angle_tolerance: by which bends may pass a limit [rad]. Derived: degrees are rounded when they become radians.
        depth_rounding: depths below this share of the room are rounding. Derived: a thousandth of the contact
            tolerance of the verifier.
        base_tolerance: by which a curve's base may be off the arm's, as a share of its length. Derived: likewise; a
            problem file has one base for both.
    """

    length_tolerance: float = 1e-6
    angle_tolerance: float = 1e-9
    depth_rounding: float = 1e-9
    base_tolerance: float = 1e-9


READING = ReadingSettings()
"""Used where no other settings are given."""


@dataclass(frozen=True)
class FoldSettings:
    """How tightly ``shape = "folded"`` folds an arm; all of them are taste.

    Attributes:
        limit_share: share of the joint limit that a folded arm uses, so that it can still move either way.
        gap_in_diameters: the axes of distant links keep at least this many link diameters (two radii) apart.
        least_gap_in_links: and at least this many link lengths, for arms of zero radius.
    """

    limit_share: float = 0.95
    gap_in_diameters: float = 1.1
    least_gap_in_links: float = 0.1


FOLD = FoldSettings()
"""Used where no other settings are given."""
