"""Changes to the files of a plan's folder, each of which contradicts the motion in one way."""

import re
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import ccm_opt
from ccm_opt.io.controller_points import points_at, slowed, trajectory_texts
from ccm_opt.io.folder import write_solution
from tests.corruption.plans import Folder

Change = Callable[[Folder], None]


def _keyframes(folder: Folder) -> None:
    """Replace the keyframes by those of another motion, and the curves accordingly."""
    middle = len(folder.arrays["keyframes"]) // 2
    away = 0.3 * np.sin(np.pi * np.arange(len(folder.arrays["keyframes"])) / (2 * middle))[:, None]
    keyframes = folder.arrays["keyframes"] + away
    keyframes[[0, -1]] = folder.arrays["keyframes"][[0, -1]]
    folder.arrays["keyframes"] = keyframes
    folder.arrays.update(curves_of(folder))


def curves_of(folder: Folder) -> dict[str, np.ndarray]:
    """Return the arrays of the curves nearest to the keyframes of a folder."""
    from ccm_opt.io.records import curve_arrays
    from ccm_opt.planning.link_space import nearest_curves

    return dict(curve_arrays(nearest_curves(folder.solution.problem.arm, folder.arrays["keyframes"])))


def _scaled(name: str) -> Change:
    def change(folder: Folder) -> None:
        folder.arrays[name] = 1.001 * folder.arrays[name]

    return change


def _figure(folder: Folder) -> None:
    folder.record["metrics"]["peak_torque_Nm"] *= 0.9


def _recorded_check(folder: Folder) -> None:
    next(check for check in folder.record["checks"] if check["name"] == "joint velocity")["worst"] *= 0.5


def _recorded(*path: str | int, value: object) -> Change:
    """Return a change that replaces one value in the record, given by its path of keys."""

    def change(folder: Folder) -> None:
        place = folder.record
        for key in path[:-1]:
            place = place[key]  # type: ignore[index]
        assert place[path[-1]] != value  # type: ignore[index]
        place[path[-1]] = value  # type: ignore[index]

    return change


def _another_check(**changed: object) -> Change:
    """Return a change that adds a copy of the last check to the record, with given entries replaced."""

    def change(folder: Folder) -> None:
        folder.record["checks"].append(folder.record["checks"][-1] | changed)

    return change


def _another_figure(folder: Folder) -> None:
    folder.record["metrics"]["least_gap_to_blades_m"] = 0.05


def _survives_more(folder: Folder) -> None:
    for error in folder.record["tolerance"]:
        error["size"] *= 1.01
        error["size_deg"] *= 1.01


def _survives_something_else(folder: Folder) -> None:
    folder.record["tolerance"][0]["name"] = "payload"


def _text(name: str, found: str, put: str) -> Change:
    def change(folder: Folder) -> None:
        assert found in folder.texts[name]
        folder.texts[name] = folder.texts[name].replace(found, put, 1)

    return change


def _row(name: str, mark: str) -> Change:
    """Return a change that replaces a line of numbers in the second half of a text by the previous such line."""

    def change(folder: Folder) -> None:
        lines = folder.texts[name].split("\n")
        marked = [k for k, line in enumerate(lines) if mark in line and k > len(lines) // 2]
        lines[marked[1]] = lines[marked[0]]
        folder.texts[name] = "\n".join(lines)

    return change


def _without_accelerations(folder: Folder) -> None:
    """Remove the accelerations from a trajectory of limited jerk, so that a controller interpolates by cubics."""
    folder.texts["trajectory.yaml"] = re.sub(r"  accelerations: .*\n", "", folder.texts["trajectory.yaml"])


def _two_points(folder: Folder) -> None:
    """Replace a folder by that of the swan's neck, with only the end points in its trajectory message."""
    problem = ccm_opt.load_problem(Path(__file__).parents[2] / "problems" / "swan-neck.toml")
    solution = ccm_opt.solve(problem)
    with TemporaryDirectory() as place:
        vars(folder).update(vars(Folder.of(write_solution(solution, Path(place)), solution)))
    ends = np.array([0, len(solution.trajectory.time) - 1])
    slow = points_at(*slowed(problem, solution.trajectory, solution.joints, 3.0), ends, 3.0, smooth=False)
    folder.texts["trajectory.yaml"] = trajectory_texts(slow)[1]


FOLDER_MUTATIONS: dict[str, tuple[Change, ...]] = {
    "keyframes against motion": (_keyframes,),
    "curves against keyframes": tuple(
        _scaled(name) for name in ("segment_curvatures", "segment_knots", "segment_lengths", "base_headings")
    ),
    "simulated arm against its plan": (
        _scaled("simulated_angles"),
        _scaled("simulated_torques"),
        _recorded("simulation", "step", value=1e-5),
        _recorded("simulation", "reason", value="with steps of 1 s"),
        _recorded("simulation", "link", value=3),
    ),
    "figures against arrays": (_figure, _another_figure),
    "record against checks": (
        _recorded_check,
        _recorded("checks", 3, "unit", value="mm"),
        _recorded("checks", 3, "passed", value=False),
        _another_check(),
        _another_check(name="gap to blades"),
        _another_check(name="constraint of mine", passed=False),
    ),
    "record against motion": (
        _recorded("method", value="hill-climbing"),
        _recorded("seed", value=7),
        _recorded("not_checked", value=["nothing"]),
        _recorded("room", "nearest", "gap", value=0.5),
        _recorded("room", "goal", "gap", value=True),
        _recorded("room", "clearance", value=None),
        _recorded("room", "short", value=[{"from": 0.0, "to": 1.0}]),
        _recorded("room", "stops", value=None),
        _recorded("room", value=[]),
    ),
    "survived errors against motion": (_survives_more, _survives_something_else),
    "gaps over time against motion": tuple(_scaled(name) for name in ("room_time", "wall_gaps", "self_gaps")),
    "table against arrays": (_row("trajectory.csv", ","),),
    "ROS message against arrays": (_row("trajectory.yaml", "positions"), _row("trajectory.yaml", "velocities")),
    "message limits": (_without_accelerations,),
    "message deviation": (_two_points,),
    "URDF against problem": (_text("arm.urdf", 'upper="', 'upper="1'), _text("arm.urdf", "ball03_roll", "ball03")),
    "MJCF against problem": (_text("arm.mjcf.xml", 'mass="', 'mass="1'), _text("arm.mjcf.xml", "link03", "link3")),
}
"""Changes by the name of the check that fails."""
