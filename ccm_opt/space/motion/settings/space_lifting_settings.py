"""Numbers of motions that are found for nominal links.

Lengths are in nominal links u = L / 24 unless said otherwise.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class LiftingSettings:
    """Of arms of many links, whose motions are found for nominal ones.

    Attributes:
        most_links: arms of no more links are planned as they are.
        clearance: room that the coarse motion keeps beside the clearance [u].
        most_bend: bound on the bends of the coarse arm's joints [rad].
        time_share: of the time that is left, which the search for nominal links may take.
        offset: bends of the start that no curve shows, beyond which nothing is lifted [rad].
        fits: most steps by which an arm is laid on another.
        ridge: least damping of them, in the squares of nominal links by unknowns.
        raised_ridge: to which it is raised at once by a step that gains nothing.
        ridge_rise: its further rise by such steps, and its fall by others.
        near: how far its joints may be off for another beginning not to be tried [u].
        worth: share of the squared distances that a step gains, below which it is the last.
    """

    most_links: int = 36
    clearance: float = 0.04
    most_bend: float = 0.9
    time_share: float = 0.4
    offset: float = 0.02
    fits: int = 20
    ridge: float = 1e-4
    raised_ridge: float = 1e-2
    ridge_rise: float = 10.0
    near: float = 0.1
    worth: float = 0.01
