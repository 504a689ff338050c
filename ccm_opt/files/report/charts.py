"""The charts of the page ``report.html``: bends over time, and how much of every limit is used."""

import numpy as np

from ccm_opt.files.report.report_settings import REPORT, ReportSettings
from ccm_opt.ground.arrays import FloatArray, IntArray
from ccm_opt.solution import Solution

Chart = dict[str, object]
"""Title, lines and range of a chart, as the page's script reads them."""


def charts(solution: Solution, frames: IntArray, settings: ReportSettings = REPORT) -> list[Chart]:
    """The charts of a plan.

    Args:
        solution: the plan.
        frames: numbers of the samples that are shown.
        settings: number of lines.
    """
    joints = solution.joints
    limits = solution.problem.limits
    links = solution.problem.arm.links
    shown = np.unique(np.linspace(0, links - 1, min(links, settings.most_lines)).astype(int))
    found = [_chart("joint bends [deg], base to tip", np.rad2deg(solution.trajectory.bend_angles[frames][:, shown]).T)]
    shares = {
        "greatest share of the velocity limits": np.abs(joints.velocities) / limits.velocity,
        "greatest share of the acceleration limits": np.abs(joints.accelerations) / limits.acceleration,
    }
    if limits.torque is not None:
        shares["greatest share of the torque limits"] = np.abs(joints.torques) / limits.torque
    found += [_share(title, values[frames]) for title, values in shares.items()]
    if limits.torque is None:
        peak = np.max(np.abs(joints.torques[frames]), axis=1)
        found.append(_chart(f"greatest joint torque [N m], at most {peak.max():.3g}", peak[None]))
    trajectory = solution.trajectory
    for name, places in zip(trajectory.coordinates.base_names, trajectory.base_positions[frames].T, strict=True):
        found.append(_chart(f"{name} [m]", places[None]))
    return found


def _chart(title: str, series: FloatArray) -> Chart:
    low = float(series.min(initial=0.0))
    high = float(series.max(initial=0.0))
    text = f"{title}: {low:.3g} to {high:.3g}"
    return {
        "title": text,
        "series": np.round(series, 5).tolist(),
        "low": low,
        "high": max(high, low + 1e-9),
        "mark": None,
    }


def _share(title: str, values: FloatArray) -> Chart:
    """The joint that uses most of its limit at each time; the limit itself is marked."""
    return {"title": title, "series": [np.round(values.max(axis=1), 5).tolist()], "low": 0.0, "high": 1.05, "mark": 1.0}
