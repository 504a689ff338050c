"""Draw the pictures of the concept pages, from runs of the package itself.

Run it from the project's folder, with the folder for the pictures::

    python docs/draw_pictures.py docs/images

Nothing is drawn by hand: routes, corridors, the hairpin's moments and the certificate's verdicts are what the package
finds. It takes some seconds; a run gives the same pictures on every machine but for rounding.
"""

import sys
from pathlib import Path

import numpy as np
import shapely
from concept_pictures.corridor import CorridorScene, corridor_png
from concept_pictures.gap import gaps_png
from concept_pictures.hairpin import HairpinMoment, HairpinScene, hairpin_png
from concept_pictures.sag import SagScene, sag_png

import ccm_opt
from ccm_opt.core.deadline import Deadline
from ccm_opt.ik.configuration_task import ConfigurationTask
from ccm_opt.ik.find_configuration import find_configuration
from ccm_opt.io.reading import parse_problem
from ccm_opt.planning.continuation import follow
from ccm_opt.planning.curve_routes import find_routes, route_room, tip_paths_along
from ccm_opt.planning.ends import resolve_ends
from ccm_opt.planning.hairpin import Hairpin, pulled_over
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.pose import Pose, Term
from ccm_opt.planning.search_run import PlanarRun
from ccm_opt.scene.certificate import Certificate
from ccm_opt.scene.free_space import FreeSpace
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

BLOCKS = {
    "block": [(0.24, -0.13), (0.44, -0.07), (0.42, 0.17), (0.25, 0.12)],
    "pillar": [(0.60, -0.42), (0.74, -0.42), (0.72, -0.10), (0.63, -0.12)],
    "shelf": [(0.62, 0.11), (0.84, 0.06), (0.88, 0.27), (0.66, 0.30)],
}
LENGTH, RADIUS, MARGIN = 1.3, 0.02, 0.005
LINKS = 26


def corridor_scene() -> CorridorScene:
    """A room with three obstacles and three ways to a goal that is entered from below."""
    obstacles = tuple(Obstacle(name, PlaneShape(shapely.Polygon(corners))) for name, corners in BLOCKS.items())
    workspace = Workspace(shapely.box(-0.08, -0.42, 1.2, 0.45), obstacles, 0.0)
    room = FreeSpace(workspace, RADIUS + MARGIN)
    base, goal, heading = np.array([0.0, 0.0]), np.array([1.02, 0.24]), 0.5 * np.pi
    routes = room.routes(base, goal, 3, longest=0.985 * LENGTH, shrink=0.016 * LENGTH)
    corridor = room.corridor(routes[2])
    task = ConfigurationTask(
        base=base,
        base_heading_range=(-np.pi, np.pi),
        length=LENGTH,
        curvature_limit=12.0,
        goal=goal,
        goal_heading=heading,
        corridor=corridor,
        mount_length=RADIUS,
    )
    configuration = find_configuration(task, 4)
    points = configuration.positions_at(np.linspace(0.0, LENGTH, LINKS + 1))
    return CorridorScene(room, base, goal, heading, routes, corridor, configuration, points, RADIUS)


PROBLEMS = Path(__file__).parent.parent / "problems"
MOMENTS = (
    (0.10, "the tip turns back: a fold begins"),
    (0.36, "the fold travels towards the base"),
    (0.70, "the arm follows it out, as a rope does"),
    (1.00, "the fold has opened; settling comes next"),
)
"""Shares of the motion that are drawn, with what they show."""


FOLD_LENGTH = 5.0
"""Of the hairpin, in nominal links."""


class Recorder:
    """A hairpin as a guide that notes after every step where its fold and its target are."""

    def __init__(self, guide: Hairpin) -> None:
        self.guide = guide
        self.states = [(guide.fold_at, guide.target())]

    def terms(self, pose: Pose) -> list[Term]:
        """What draws the arm on from a pose."""
        return self.guide.terms(pose)

    def progress(self, pose: Pose) -> bool:
        """Let the fold travel if the tip keeps up."""
        moved = self.guide.progress(pose)
        self.states.append((self.guide.fold_at, self.guide.target()))
        return moved

    def finished(self, pose: Pose) -> bool:
        """Whether the fold has come to its end."""
        return self.guide.finished(pose)

    def describe(self, pose: Pose) -> str:
        """How far the fold has come."""
        return self.guide.describe(pose)


def hairpin_scene() -> HairpinScene:
    """The hairpin of the shared problem *horn-wide*, which begins inside a horn and ends outside."""
    problem = ccm_opt.load_problem(PROBLEMS / "horn-wide.toml")
    ends = resolve_ends(problem)
    room = route_room(problem, ends)
    tip_paths = tip_paths_along(problem, ends, find_routes(problem, ends, room), room)
    deadline = Deadline.after(60.0)
    task = MotionTask(
        arm=problem.arm,
        workspace=problem.workspace,
        start=ends.start,
        goal=ends.goal,
        tip_paths=tip_paths,
        deadline=deadline,
    )
    run = PlanarRun.from_task(task, MARGINS[0])
    guide = next(pulled_over(run.stepper, run.start, None, tip_paths[0], (FOLD_LENGTH,))).make_guide()
    recorder = Recorder(guide)
    poses = follow(run.stepper, recorder, run.start, deadline)
    moments = []
    for share, title in MOMENTS:
        k = round(share * (len(poses) - 1))
        fold_at, target = recorder.states[k]
        moments.append(HairpinMoment(title, poses[k].points, fold_at, guide.fold_length, target))
    return HairpinScene(problem.workspace, problem.arm.radius, guide.track.points, moments, (-1.06, -0.16, 0.52, 0.80))


ARM_BESIDE_A_WALL = """
schema = 1
name = "sag"
[workspace]
bounds = [-1.0, -1.0, 1.0, 1.0]
[[workspace.obstacles]]
name = "wall"
box = [0.416, -0.06, 0.46, 0.28]
[arm]
links = 4
link_length = 0.1
radius = 0.008
base = [0.0, 0.0]
joint_limit_deg = 60.0
[limits]
velocity = 1.0
acceleration = 1.0
[start]
shape = "straight"
[goal]
position = [0.2, 0.2]
"""


def sag_scene() -> SagScene:
    """Four links that turn by 40° in one interval, many times what a step does, beside a wall."""
    problem = parse_problem(ARM_BESIDE_A_WALL)
    start = np.deg2rad([-14.0, -6.0, 4.0, 16.0])
    end = start + np.deg2rad([34.0, 38.0, 40.0, 42.0])
    certificate = Certificate(problem.arm, problem.workspace, 0.002)
    return SagScene(certificate, start, end, 3, (-0.02, -0.08, 0.47, 0.29))


def main() -> None:
    """Draw all pictures into the folder named on the command line."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images")
    (folder / "route-and-corridor.png").write_bytes(corridor_png(corridor_scene()))
    (folder / "travelling-hairpin.png").write_bytes(hairpin_png(hairpin_scene()))
    (folder / "sag-and-certificate.png").write_bytes(sag_png(sag_scene()))
    (folder / "clearance-margin-spare.png").write_bytes(gaps_png())


if __name__ == "__main__":
    main()
