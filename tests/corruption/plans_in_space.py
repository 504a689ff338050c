"""Problems in space whose plans are corrupted: of an arm that stops at a goal, and of a fed arm that passes a mesh."""

from pathlib import Path

import numpy as np

ROOM = """\
schema = 1
space = 3
name = "{name}"

[workspace]
bounds = [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]
clearance = 0.004

[[workspace.obstacles]]
name = "post"
capsule = {{ from = [0.25, 0.32, -0.3], to = [0.25, 0.32, 0.3], radius = 0.06 }}

[[workspace.obstacles]]
name = "shelf"
box = [[0.3, -0.5, -0.2], [0.9, -0.3, 0.2]]
"""
PAUSING = (
    ROOM.format(name="pausing-in-space")
    + """
[arm]
links = 8
link_length = 0.08
radius = 0.015
joint_limit_deg = 70.0
base = { position = [0.0, 0.0, 0.0] }

[limits]
velocity = 2.0
acceleration = 8.0
torque = 9.0
tip_velocity = 1.5
points = [{ at = 0.3, velocity = 1.2, acceleration = 20.0 }]

[start]
shape = "straight"

[[goal]]
position = [0.5, 0.15, 0.1]
pause = 0.15

[[goal]]
position = [0.45, -0.1, 0.2]
direction = [0.5, -0.8, 0.2]

[planner]
effort_share = 0.95

[simulation.disturbances]
mass_error = 0.1
angle_noise_deg = 0.01
"""
)
FED = (
    ROOM.format(name="fed-in-space")
    + """
[[workspace.obstacles]]
name = "wedge"
mesh = "wedge.stl"
scale = 0.001

[arm]
links = 8
link_length = 0.06
radius = 0.015
joint_limit_deg = 60.0
base = { position = [-0.5, 0.0, 0.0] }
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
position = [0.26, 0.2, 0.1]
direction = [-0.3, 1.0, 0.3]
"""
)
PLANS_IN_SPACE = {"pausing in space": PAUSING, "fed in space": FED}
_WEDGE = np.array([[300.0, -100.0, -300.0], [300.0, 100.0, -300.0], [300.0, 0.0, -120.0], [400.0, 0.0, -300.0]])
_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3))


def write_problem(name: str, place: Path) -> Path:
    """Write a problem file with its mesh into a folder, and return its path."""
    place.mkdir(parents=True, exist_ok=True)
    facets = "".join(
        f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n"
        for face in _FACES
        for corners in ["".join(f"vertex {x} {y} {z}\n" for x, y, z in _WEDGE[list(face)])]
    )
    (place / "wedge.stl").write_text(f"solid wedge\n{facets}endsolid wedge\n", encoding="utf-8")
    file = place / f"{name.replace(' ', '-')}.toml"
    file.write_text(PLANS_IN_SPACE[name], encoding="utf-8")
    return file
