"""Draw the moving arm of the front page: one SVG file in which a planned motion plays, made from a run of the package.

Run it from the project's folder::

    python docs/draw_front_page.py

The drawing follows the reader's colours, dark or light, and stands still where less motion is asked for. It runs no
script: the joints' places at even times are values of one SVG animation, between which the browser draws straight on.
"""

from pathlib import Path

import numpy as np
import shapely

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem.solution import Solution

DOCS = Path(__file__).parent
PROBLEM = DOCS.parent / "problems" / "swan-neck.toml"
FILE = DOCS / "images" / "moving-arm.svg"
SCALE = 1000.0
"""Units of the drawing a metre, so that whole numbers are millimetres."""
AIR = 0.13
"""About all that the arm comes to [m]."""
FRAMES = 48
"""Places of the arm that are written down; between two of them no joint moves farther than a hand's breadth."""
REST = 0.7
"""How long the arm rests at either end [s]."""
SLOWER = 1.6
"""Times as long as the motion takes, so that the eye can follow."""
STILL = (0.0, 0.3, 0.45, 0.62, 1.0)
"""Shares of the motion that are shown where nothing shall move."""

STYLE = (DOCS / "moving-arm.css").read_text()


def drawing(solution: Solution) -> str:
    """The whole file."""
    problem = solution.problem
    places = solution.joint_positions
    corner, width, height = _window(places, problem.workspace.boundary)
    walls = "".join(_outline(obstacle.outline(), corner) for obstacle in problem.workspace.obstacles)
    time = solution.trajectory.time
    frames = np.linspace(0.0, time[-1], FRAMES)
    moving = [_points(_at(places, time, moment), corner) for moment in frames]
    ends = "".join(f'<polyline class="ghost" stroke-width="{_size(problem)}" points="{moving[k]}"/>' for k in (0, -1))
    tips = _points(np.array([_at(places, time, moment)[-1] for moment in frames]), corner)
    still = "".join(_arm([_points(_at(places, time, share * time[-1]), corner)], 0.0, problem) for share in STILL)
    return (
        f'<svg class="ccm-motion" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        'aria-label="An arm of twelve links passes under a hanging wall and reaches up behind it">\n'
        f"<style>{STYLE}</style>\n"
        '<defs><marker id="ccm-joint" viewBox="-4 -4 8 8" markerWidth="8" markerHeight="8" '
        'markerUnits="userSpaceOnUse"><circle class="joint" r="3.6"/></marker></defs>\n'
        f"{walls}\n{ends}\n{_goal(solution, corner)}\n"
        f'<polyline class="trace" points="{tips}"/>\n'
        f'<g class="moving">{_arm(moving, float(time[-1]), problem)}</g>\n<g class="still">{still}</g>\n</svg>\n'
    )


def _window(places: FloatArray, boundary: shapely.Polygon) -> tuple[FloatArray, int, int]:
    """Upper left corner [m] and size of what is shown: all that the arm comes to, with some air, within the room."""
    points = places.reshape(-1, 2)
    least = points.min(axis=0) - AIR
    most = points.max(axis=0) + AIR
    xmin, ymin, xmax, ymax = boundary.bounds
    low, high = np.maximum(least, [xmin, ymin]), np.minimum(most, [xmax, ymax])
    width, height = (SCALE * (high - low)).round().astype(int)
    return np.array([low[0], high[1]]), int(width), int(height)


def _at(places: FloatArray, time: FloatArray, moment: float) -> FloatArray:
    """Places of the joints at a time, shape (n + 1, 2) [m]."""
    return places[min(int(np.searchsorted(time, moment)), len(time) - 1)]


def _points(points: FloatArray, corner: FloatArray) -> str:
    """Points as an SVG list, in millimetres, y down."""
    moved = SCALE * (points - corner) * [1.0, -1.0]
    return " ".join(f"{x:.0f},{y:.0f}" for x, y in moved)


def _outline(polygon: shapely.Polygon, corner: FloatArray) -> str:
    return f'<polygon class="wall" points="{_points(np.array(polygon.exterior.coords)[:-1], corner)}"/>'


def _size(problem: ccm_opt.Problem) -> str:
    return f"{2.0 * SCALE * problem.arm.radius:.0f}"


def _arm(frames: list[str], duration: float, problem: ccm_opt.Problem) -> str:
    """Body, axis and joints of the arm; there and back, with a rest at either end, where there are several frames."""
    animate = ""
    if len(frames) > 1:
        going = SLOWER * duration
        steps = np.linspace(0.0, going, len(frames))
        moments = np.array([0.0, *(REST + steps), *(2.0 * REST + going + steps)])
        times = ";".join(f"{moment:.4f}" for moment in moments / moments[-1])
        animate = (
            f'<animate attributeName="points" dur="{moments[-1]:.2f}s" repeatCount="indefinite" keyTimes="{times}" '
            f'values="{";".join([frames[0], *frames, *reversed(frames)])}"/>'
        )
    body = f'<polyline class="body" stroke-width="{_size(problem)}" points="{frames[0]}">{animate}</polyline>'
    joints = 'marker-start="url(#ccm-joint)" marker-mid="url(#ccm-joint)"'
    return body + f'<polyline class="axis" {joints} points="{frames[0]}">{animate}</polyline>'


def _goal(solution: Solution, corner: FloatArray) -> str:
    """A ring at the tip's goal, with a stroke in its heading."""
    place = solution.joint_positions[-1][-1]
    along = place - solution.joint_positions[-1][-2]
    ahead = place + 0.07 * along / np.linalg.norm(along)
    x, y = _points(place[None], corner).split(",")
    return (
        f'<circle class="goal" cx="{x}" cy="{y}" r="36"/>'
        f'<polyline class="goal" points="{_points(np.array([place, ahead]), corner)}"/>'
    )


if __name__ == "__main__":
    FILE.write_text(drawing(ccm_opt.solve(ccm_opt.load_problem(PROBLEM))))
