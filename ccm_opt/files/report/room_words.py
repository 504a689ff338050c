"""The room that a motion keeps, in words for people."""

from collections.abc import Iterator
from dataclasses import dataclass

from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.solution import PossibleGap, RoomRecord, ShortStretch

_BOUNDS = {
    "start": "the start pose has no more",
    "goal": "what the goal fixes has no more",
    "passage": "the widest way to the goal leaves no more",
}
_CAUSES = {
    "start": "the start pose has",
    "stop": "the pose at a stop has",
    "goal": "the goal pose has",
    "passage": "on the way there are",
}


def room_sentences(room: RoomRecord, units: PageUnits, most: int = 3) -> Iterator[str]:
    """What a person wants to know of a motion's room, the most important first.

    Args:
        room: the record.
        units: in which lengths are told.
        most: stretches with less than the wanted gap that are named, those that miss most.
    """
    words = _RoomWords(units)
    yield words.least_gap(room)
    worst = sorted(room.short, key=lambda part: part.nearest.gap - part.nearest.wanted)[:most]
    for part in sorted(worst, key=lambda part: part.begin):
        yield words.short_stretch(part)
    left = len(room.short) - len(worst)
    if left:
        yield f"and {left} more stretch{'es' if left > 1 else ''} with less than the wanted gap"
    if room.short and room.possible is not None and room.possible.by != "wanted gap":
        yield words.bound(room.possible)
    if room.price is not None:
        yield _price(room.price)


@dataclass(frozen=True)
class _RoomWords:
    """The sentences that name lengths.

    Attributes:
        units: of lengths.
    """

    units: PageUnits

    def least_gap(self, room: RoomRecord) -> str:
        """The least gap of the motion and where it is."""
        near = room.nearest
        if not near.link:
            return f"least gap more than {self._chosen(room.reach)}, the farthest that the room is measured"
        # Where there is no clearance, or another link is nearest, a gap is a distance and needs no more words.
        counted = room.clearance and not near.second_link
        beyond = f" beyond the clearance of {self._chosen(room.clearance)}" if counted else ""
        wanted = f" of the wanted {self._chosen(near.wanted)}" if near.wanted else ""
        return f"least gap {self.units.length(near.gap)}{wanted}{beyond}, at {near.time:.2f} s, {near.pair}"

    def short_stretch(self, part: ShortStretch) -> str:
        """When there is less than the wanted gap, and why."""
        near = part.nearest
        gap = f"{self.units.length(near.gap)} of {self._chosen(near.wanted)}"
        times = f"{part.begin:.2f} to {part.end:.2f} s"
        return f"less than wanted from {times}: {_CAUSES[part.cause]} {gap}, {near.pair}"

    def bound(self, possible: PossibleGap) -> str:
        """What stands against more room."""
        most = self.units.length(possible.value)
        if possible.walls:
            one, other = possible.walls
            return f"the way between '{one}' and '{other}' leaves no more than {most} on either side"
        return f"no motion keeps more than {most}: {_BOUNDS.get(possible.by, 'no more is wanted')}"

    def _chosen(self, length: float) -> str:
        return self.units.given(length, "m")


def _price(seconds: float) -> str:
    """What the wanted gap costs against the motion that wants none."""
    if seconds < 0.0:
        return f"with the wanted gap the motion is even {-seconds:.3g} s shorter than without one"
    return f"the wanted gap costs {seconds:.3g} s"
