"""The room that a motion keeps, as ``solution.json`` has it."""

from collections.abc import Mapping

from ccm_opt.solution import NearPlace, RoomRecord


def room_data(room: RoomRecord) -> Mapping[str, object]:
    """The record without its arrays, which are in ``solution.npz``; lengths [m], times [s]."""
    possible = room.possible
    return {
        "wanted_gap": room.wanted,
        "clearance": room.clearance,
        "reach": room.reach,
        "nearest": place_data(room.nearest),
        "start": place_data(room.at_start),
        "stops": [place_data(end) for end in room.ends[1:-1]],
        "goal": place_data(room.at_goal),
        "short": [
            {"from": part.begin, "to": part.end, "cause": part.cause, "nearest": place_data(part.nearest)}
            for part in room.short
        ],
        "possible_gap": None if possible is None else possible.value,
        "possible_by": None if possible is None else possible.by,
        "possible_between": [] if possible is None else list(possible.walls),
        "price": room.price,
    }


def place_data(place: NearPlace) -> Mapping[str, object]:
    """Where a link is near something."""
    other: dict[str, object] = {}
    if place.second_link:
        other = {"second_link": place.second_link}
    elif place.link:
        other = {"obstacle": place.obstacle}
    near = {"link": place.link, **other} if place.link else {}
    return {"gap": place.gap, "wanted": place.wanted, "time": place.time, **near}
