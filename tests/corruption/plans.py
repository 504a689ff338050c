"""Plans to be corrupted: planar problems, plan folders in memory, and the registry of kinds of changes."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.folder import write_solution
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem.solution import Solution

from .plans_in_space import PLANS_IN_SPACE, write_problem

Arrays = dict[str, FloatArray]
Generator = np.random.Generator

ROOM = """\
schema = 1
name = "{name}"

[workspace]
bounds = [-1.2, -1.2, 1.4, 1.2]
clearance = 0.004

[[workspace.obstacles]]
name = "post"
circle = {{ center = [0.25, 0.32], radius = 0.06 }}

[[workspace.obstacles]]
name = "shelf"
polygon = [[0.3, -0.5], [0.9, -0.5], [0.9, -0.3], [0.3, -0.3]]
"""
PAUSING = (
    ROOM.format(name="pausing")
    + """
[arm]
links = 8
link_length = 0.08
radius = 0.015
base = [0.0, 0.0]
joint_limit_deg = 70.0

[limits]
velocity = 2.0
acceleration = 8.0
torque = 9.0
tip_velocity = 1.5
points = [{ at = 0.3, velocity = 1.2, acceleration = 20.0 }]

[start]
shape = "straight"

[[goal]]
position = [0.5, 0.15]
pause = 0.15

[[goal]]
position = [0.45, -0.15]
heading_deg = -60.0

[planner]
effort_share = 0.95

[simulation.disturbances]
mass_error = 0.1
angle_noise_deg = 0.01
"""
)
SMOOTH = (
    ROOM.format(name="smooth")
    + """
[arm]
links = 6
link_length = 0.1
radius = 0.02
base = [0.0, 0.0]
joint_limit_deg = 80.0
payload = 0.05
rotor_inertia = 0.001
friction = 0.01

[limits]
velocity = 2.0
acceleration = 8.0
jerk = 200.0
torque = 12.0

[start]
shape = "straight"

[goal]
joints_deg = [20, 15, -10, 20, 10, -15]
"""
)
FED = (
    ROOM.format(name="fed")
    + """
[arm]
links = 8
link_length = 0.06
radius = 0.015
base = [-0.5, 0.0]
joint_limit_deg = 60.0
feed = { range = [0.0, 0.5], hole = 0.5 }

[limits]
velocity = 1.0
acceleration = 4.0
feed_velocity = 0.3
feed_acceleration = 0.8
feed_force = 3.0
torque = 6.0

[start]
shape = "straight"
feed = 0.02

[goal]
position = [0.36, 0.1]
"""
)
PLANS = {"pausing": PAUSING, "smooth": SMOOTH, "fed": FED}


@dataclass
class Folder:
    """Output folder of a plan, held in memory so that its content can be changed.

    Attributes:
        arrays: arrays of ``solution.npz``, by name.
        record: content of ``solution.json``.
        texts: texts of the other files, by file name.
        meshes: contents of mesh files, by path in the folder; empty for planar problems.
        solution: solution that was written to the folder.
    """

    arrays: Arrays
    record: dict[str, Any]
    texts: dict[str, str]
    meshes: dict[str, bytes]
    solution: Solution

    @classmethod
    def of(cls, place: Path, solution: Solution) -> "Folder":
        """Return the content of a folder to which a solution was written."""
        with np.load(place / "solution.npz", allow_pickle=False) as archive:
            arrays = {name: archive[name].copy() for name in archive.files}
        record = json.loads((place / "solution.json").read_text(encoding="utf-8"))
        texts = {
            path.name: path.read_text(encoding="utf-8")
            for path in sorted(place.iterdir())
            if path.suffix in {".csv", ".yaml", ".urdf", ".xml"}
        }
        meshes = {str(path.relative_to(place)): path.read_bytes() for path in sorted(place.rglob("*.stl"))}
        return cls(arrays, record, texts, meshes, solution)

    def copy(self) -> "Folder":
        """Return a copy that can be changed independently."""
        arrays = {name: values.copy() for name, values in self.arrays.items()}
        record = json.loads(json.dumps(self.record))
        return Folder(arrays, record, dict(self.texts), dict(self.meshes), self.solution)

    def write(self, place: Path) -> None:
        """Write all files into a new folder."""
        place.mkdir(parents=True)
        np.savez(place / "solution.npz", **self.arrays)  # type: ignore[arg-type]
        (place / "solution.json").write_text(json.dumps(self.record), encoding="utf-8")
        for name, text in self.texts.items():
            (place / name).write_text(text, encoding="utf-8")
        for name, content in self.meshes.items():
            (place / name).parent.mkdir(exist_ok=True)
            (place / name).write_bytes(content)


@dataclass(frozen=True)
class Kind:
    """One kind of change to the output folder of a plan.

    Attributes:
        name: description of the change.
        change: function that changes a folder in place; returns False if the change does not apply to the plan.
        true: whether the changed plan is still correct.
    """

    name: str
    change: Callable[[Folder, Generator], bool]
    true: bool = False


KINDS: list[Kind] = []


def kind(name: str, *, true: bool = False) -> Callable[[Callable[[Folder, Generator], bool]], None]:
    """Return a decorator that registers a function as a kind of change.

    Args:
        name: description of the change.
        true: whether the changed plan is still correct.
    """

    def entered(change: Callable[[Folder, Generator], bool]) -> None:
        KINDS.append(Kind(name, change, true))

    return entered


def write_plans(place: Path, names: Sequence[str] = (*PLANS, *PLANS_IN_SPACE)) -> dict[str, Folder]:
    """Solve problems by name, once per process, and return their output folders in memory.

    Args:
        place: folder for the files.
        names: names of the problems; all by default.
    """
    for name in names:
        if name in _WRITTEN:
            continue
        if name in PLANS_IN_SPACE:
            problem = ccm_opt.load_problem(write_problem(name, place / "problems"))
        else:
            problem = parse_problem(PLANS[name], f"{name}.toml")
        solution = ccm_opt.solve(problem)
        _WRITTEN[name] = Folder.of(write_solution(solution, place), solution)
    return {name: _WRITTEN[name].copy() for name in names}


_WRITTEN: dict[str, Folder] = {}
