"""What the page ``report.html`` says about the room that a motion keeps: a chart, sentences, a mark in the scene."""

from html import escape

import numpy as np
import shapely

from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.files.report.room_chart import room_chart
from ccm_opt.files.report.room_words import room_sentences
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.solution import RoomRecord, Solution


def room_section(room: RoomRecord | None, settings: ReportSettings = REPORT) -> str:
    """The section with its heading; empty where nobody measured the room.

    Args:
        room: the record.
        settings: size of the chart.
    """
    if room is None:
        return ""
    first, *others = room_sentences(room)
    sentences = "".join(f"<li>{escape(_capitalised(sentence))}.</li>" for sentence in others)
    listed = f"<ul>{sentences}</ul>" if sentences else ""
    return f"<h2>Room</h2><p>{escape(_capitalised(first))}.</p>{room_chart(room, settings)}{listed}"


def nearest_mark(solution: Solution, size: float, thin: float) -> str:
    """A ring in the scene at the place of the least gap, which the mouse explains; empty where nothing is near.

    Args:
        solution: the plan.
        size: radius of the ring [m].
        thin: width of its line [m].
    """
    room = solution.room
    if room is None or not room.nearest.link:
        return ""
    x, y = _place_of_least_gap(solution, room)
    title = escape(next(iter(room_sentences(room))))
    return (
        f'<circle cx="{x:.6g}" cy="{y:.6g}" r="{size:.5g}" fill="none" stroke="var(--bad)" '
        f'stroke-width="{thin:.5g}" pointer-events="all"><title>{title}</title></circle>'
    )


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
