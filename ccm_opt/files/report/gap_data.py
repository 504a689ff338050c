"""The gaps of a motion over time, with the wanted gap, the clearance, and where they are least, for the script."""

import numpy as np

from ccm_opt.files.report.delta_coding import coded, step_for
from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.solution import RoomRecord


def gap_data(room: RoomRecord, settings: ReportSettings = REPORT) -> dict[str, object]:
    """The record of a motion's room as the page's script reads it; lengths [m], times [s].

    Args:
        room: the record.
        settings: how exact, and how high the chart is.
    """
    gaps = np.concatenate((room.wall_gaps, room.self_gaps))
    step = step_for(gaps, settings.number_step)
    near = room.nearest
    return {
        "time": coded(room.time, 1e-5),
        "walls": coded(room.wall_gaps, step),
        "itself": coded(room.self_gaps, step),
        "wanted": room.wanted,
        "clearance": room.clearance,
        "reach": room.reach,
        "highest": highest_shown(room, settings),
        "nearest": {"gap": near.gap, "time": near.time, "pair": near.pair, "itself": bool(near.second_link)}
        if near.link
        else None,
    }


def highest_shown(room: RoomRecord, settings: ReportSettings = REPORT) -> float:
    """Gap at the upper edge of the chart [m]: some times the wanted one, or the largest there is if that is less."""
    # What is beyond the record's reach stands there as the reach, and is not shown as if it were a gap.
    largest = 1.1 * float(room.gaps.max())
    shown = settings.wanted_gaps_shown * room.wanted if room.wanted else room.reach
    return max(min(shown, largest, 0.98 * room.reach), 1.5 * room.wanted, 1e-3 * room.reach)
