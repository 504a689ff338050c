"""What the page plots over time: bends, and how much of every limit is used."""

import numpy as np

from ccm_opt.arrays import FloatArray, IntArray
from ccm_opt.solution import Solution

MOST_LINES = 24
"""Joints whose bends are drawn; of more, evenly spread ones."""

Chart = dict[str, object]


def charts(solution: Solution, frames: IntArray) -> list[Chart]:
    """The charts of a plan at given samples."""
    joints, limits, links = solution.joints, solution.problem.limits, solution.problem.arm.links
    shown = np.unique(np.linspace(0, links - 1, min(links, MOST_LINES)).astype(int))
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
    low, high = float(series.min(initial=0.0)), float(series.max(initial=0.0))
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
