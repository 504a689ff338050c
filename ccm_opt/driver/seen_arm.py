"""What the simulated arm came near to, in the plane or in space."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Touch:
    """A link of the simulated arm in contact.

    Attributes:
        link: number of the link, counted from 1.
        obstacle: name of the wall, or "link 9".
        time: when [s].
    """

    link: int
    obstacle: str
    time: float

    def __str__(self) -> str:
        return f"link {self.link} touches {self.obstacle} at {self.time:.4g} s"


@dataclass(frozen=True)
class Seen:
    """What was seen of a simulated arm among its obstacles.

    Attributes:
        touch: where it first touches something; None where it touches nothing.
        walls: least distance from walls, inf where nothing is near [m]; of no matter beyond a contact.
        itself: least distance between links, inf where none are near; None where links may meet [m].
    """

    touch: Touch | None
    walls: float
    itself: float | None
