"""The room that a motion keeps, in words for people."""

from collections.abc import Iterator

from ccm_opt.solution import NearPlace, PossibleGap, RoomRecord, ShortStretch

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


def room_sentences(room: RoomRecord, most: int = 3) -> Iterator[str]:
    """What a person wants to know of a motion's room, the most important first.

    Args:
        room: the record.
        most: stretches with less than the wanted gap that are named, those that miss most.
    """
    yield least_gap(room)
    worst = sorted(room.short, key=lambda part: part.nearest.gap - part.nearest.wanted)[:most]
    for part in sorted(worst, key=lambda part: part.begin):
        yield short_stretch(part)
    left = len(room.short) - len(worst)
    if left:
        yield f"and {left} more stretch{'es' if left > 1 else ''} with less than the wanted gap"
    if room.short and room.possible is not None and room.possible.by != "wanted gap":
        yield bound(room.possible)
    if room.price is not None:
        yield _price(room.price)


def least_gap(room: RoomRecord) -> str:
    """The least gap of the motion and where it is."""
    near = room.nearest
    if not near.link:
        return f"least gap more than {millimetres(room.reach)}"
    wanted = f" of the wanted {millimetres(near.wanted)}" if near.wanted else ""
    return f"least gap {millimetres(near.gap)}{wanted}, at {near.time:.2f} s, {near.pair}"


def short_stretch(part: ShortStretch) -> str:
    """When there is less than the wanted gap, and why."""
    near = part.nearest
    times = f"{part.begin:.2f} to {part.end:.2f} s"
    return f"less than wanted from {times}: {_CAUSES[part.cause]} {_of_wanted(near)}, {near.pair}"


def bound(possible: PossibleGap) -> str:
    """What stands against more room."""
    if possible.walls:
        one, other = possible.walls
        return f"the way between '{one}' and '{other}' leaves no more than {millimetres(possible.value)} on either side"
    return f"no motion keeps more than {millimetres(possible.value)}: {_BOUNDS.get(possible.by, 'no more is wanted')}"


def millimetres(length: float) -> str:
    """A length of a few millimetres, with three figures."""
    return f"{1e3 * length:.3g} mm"


def _price(seconds: float) -> str:
    """What the wanted gap costs against the motion that wants none."""
    if seconds < 0.0:
        return f"with the wanted gap the motion is even {-seconds:.3g} s shorter than without one"
    return f"the wanted gap costs {seconds:.3g} s"


def _of_wanted(near: NearPlace) -> str:
    return f"{millimetres(near.gap)} of {millimetres(near.wanted)}"
