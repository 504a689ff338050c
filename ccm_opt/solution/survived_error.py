"""The largest error that a plan survives: of its joints, links, base and scene, or of what it carries."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SurvivedError:
    """The largest error of one kind with which a plan keeps clear of everything.

    Attributes:
        name: what is wrong: "joints", "link lengths", "base heading", "base position" or "walls", certified for errors
            of any sign that may change with time; "payload" or "friction", found by simulations.
        size: the largest error that is survived, in ``unit``.
        unit: "rad", "m", "kg" or "N m s/rad".
        where: link, obstacle or link, and time that limit it, or the verdict that does, in words.
        time: when [s]; None when nothing limits it.
        link: number of the link that limits it, from 1; None when none does.
        worst: errors of all joints, as shares of the largest, that lead there soonest, shape (links,), in space
            (2 links,): signs where errors are small, and 0 where they do not matter.
        place: where that is, shape (2,), in space (3,) [m]; empty when nothing limits it.
        limited: whether something limits it; if not, it is only that larger errors were not looked at.
    """

    name: str
    size: float
    unit: str
    where: str
    time: float | None = None
    link: int | None = None
    worst: tuple[float, ...] = ()
    place: tuple[float, ...] = ()
    limited: bool = True
