"""What the page says about the room that a motion keeps: sentences beside the chart, a mark in the scene."""

import numpy as np
import shapely

from ccm_opt.files.report.markup import Markup, element
from ccm_opt.files.report.page_units import PageUnits
from ccm_opt.files.report.room_words import room_sentences
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import RoomRecord, Solution


def room_section(room: RoomRecord | None, units: PageUnits) -> Markup | None:
    """The section with its heading; nothing where nobody measured the room.

    Args:
        room: the record.
        units: of the page.
    """
    if room is None:
        return None
    first, *others = room_sentences(room, units)
    sentences = [element("li", f"{_capitalised(sentence)}.") for sentence in others]
    return element(
        "section",
        element("h2", "Room"),
        element("p", f"{_capitalised(first)}."),
        element("figure", id="gaps"),
        element("ul", *sentences) if sentences else None,
    )


def nearest_mark(solution: Solution, units: PageUnits) -> dict[str, object] | None:
    """Where the least gap is, with its words, for the scene; None where nothing is near."""
    room = solution.room
    if room is None or not room.nearest.link:
        return None
    place = _place_of_least_gap(solution, room)
    return {"place": [float(value) for value in place], "words": next(room_sentences(room, units))}


def _place_of_least_gap(solution: Solution, room: RoomRecord) -> FloatArray:
    """Half-way between the two bodies at the time of their least gap, shape (2,) [m]."""
    near = room.nearest
    trajectory = solution.trajectory
    at = [np.interp(near.time, trajectory.time, column) for column in trajectory.positions.T]
    points = solution.problem.arm.joint_positions_at(np.array(at))
    first = shapely.LineString(points[near.link - 1 : near.link + 1])
    if near.second_link:
        second: shapely.Geometry = shapely.LineString(points[near.second_link - 1 : near.second_link + 1])
    else:
        second = next(wall.core for wall in solution.problem.workspace.walls if wall.name == near.obstacle)
    middle: FloatArray = shapely.get_coordinates(shapely.shortest_line(first, second)).mean(axis=0)
    return middle


def _capitalised(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]
