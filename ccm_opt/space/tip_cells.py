"""Poses with the tip in one cell of a grid in space, led there from poses with the tip near by; in any process."""

import pickle
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from ccm_opt.ground.arrays import BoolArray, FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.ground.threads import on_one_thread
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.space.asked_task import space_task
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.motion.curve_map import CurveMap
from ccm_opt.space.motion.settings.space_motion_settings import SpaceMotionSettings
from ccm_opt.space.motion.space_goal import SpaceTipPose, onto_goal
from ccm_opt.space.motion.space_pose import SpacePose
from ccm_opt.space.motion.task import SpaceTask
from ccm_opt.space.problem import SpaceProblem, SpaceTipGoal
from ccm_opt.space.space_reach_settings import SpaceReachSettings

Cell: TypeAlias = tuple[int, int, int]
"""Numbers of a cell along x, y and z."""
_ROUND = 4
"""Steps after which it is looked whether they help."""


@dataclass(frozen=True, eq=False)
class SpaceReachQuestion:
    """What all cells of one map have in common; cheap to pickle.

    Attributes:
        pickled: the problem.
        width: of a cell [m].
        directions: that are tried in every cell, shape (K, 3).
        settings: how hard is tried.
    """

    pickled: bytes
    width: float
    directions: FloatArray
    settings: SpaceReachSettings

    @classmethod
    def about(
        cls, problem: SpaceProblem, width: float, directions: FloatArray, settings: SpaceReachSettings
    ) -> "SpaceReachQuestion":
        """The question for a problem, whose last goal, if it is one for the tip, is where a motion may lead."""
        arm = problem.arm
        tip = joint_positions(arm, problem.start.configuration(arm))[-1]
        goal = problem.goal if isinstance(problem.goal, SpaceTipGoal) else SpaceTipGoal(tip)
        return cls(pickle.dumps(replace(problem, goal=goal, stops=())), width, directions, settings)

    @property
    def looker(self) -> "TipLooker":
        """Who looks at cells in this process, made once."""
        return _looker(self.pickled, self.settings)


@dataclass(frozen=True, eq=False)
class EnterTask:
    """A cell to be entered.

    Attributes:
        cell: its numbers.
        middle: of it, shape (3,) [m].
        seeds: unknowns of poses with the tip in it or beside it, each of shape (p,), in the order of trying.
    """

    cell: Cell
    middle: FloatArray
    seeds: tuple[FloatArray, ...]


@dataclass(frozen=True, eq=False)
class TurnTask:
    """A cell that is reached, in which directions and room are looked at.

    Attributes:
        cell: its numbers.
        middle: of it, shape (3,) [m].
        seed: unknowns of the pose with the tip in its middle, shape (p,).
    """

    cell: Cell
    middle: FloatArray
    seed: FloatArray


ReachTask: TypeAlias = EnterTask | TurnTask


@dataclass(frozen=True, eq=False)
class CellFound:
    """What was found in a cell.

    Attributes:
        arrived: unknowns of a free pose with the tip in its middle, shape (p,); None where there is none.
        stone: of one that only came into the cell; None where there is none.
        tried: seeds that were tried.
        taken: directions that it can have, shape (K,).
        gap: room of the pose, as far as is looked [m].
        cpu: that it took [s].
    """

    arrived: FloatArray | None = None
    stone: FloatArray | None = None
    tried: int = 0
    taken: BoolArray | None = None
    gap: float = np.nan
    cpu: float = 0.0


@on_one_thread
def look_at_cell(question: SpaceReachQuestion, task: ReachTask) -> CellFound:
    """Do one task of a map."""
    begun = time.process_time()
    looker = question.looker
    if isinstance(task, EnterTask):
        found = looker.entered(task, question.width)
    else:
        found = looker.turned(task, question.directions)
    return replace(found, cpu=time.process_time() - begun)


@lru_cache(maxsize=2)  # a worker makes it once for all cells of a map
def _looker(pickled: bytes, settings: SpaceReachSettings) -> "TipLooker":
    problem: SpaceProblem = pickle.loads(pickled)  # noqa: S301 - made by this very program
    tree = SurfaceTree.of(problem.workspace.soup)
    return TipLooker(space_task(problem, tree, Deadline.never(), SpaceMotionSettings()), settings)


class TipLooker:
    """Leads poses of one arm among fixed surfaces from place to place.

    Args:
        task: of the arm, with any goal.
        settings: how hard is tried.
    """

    def __init__(self, task: SpaceTask, settings: SpaceReachSettings) -> None:
        curve, start = CurveMap.through(task.arm, task.start)
        self.task = task
        self.settings = settings
        self.stepper = task.stepper(curve)
        self.start = start

    def entered(self, task: EnterTask, width: float) -> CellFound:
        """A pose in a cell, or one that comes into it, from poses near by.

        In a duct the middles of cells may lie in its walls. So a pose that only comes into the cell is a stepping
        stone, though the cell does not count as reached by it.
        """
        stone: FloatArray | None = None
        for number, seed in enumerate(task.seeds, start=1):
            near = self.stepper.pose(seed)
            # Straight across the side that the cells share, as a duct may go, and then to the middle.
            across = _into(task.middle, width, near.tip)
            if float(np.linalg.norm(across - task.middle)) > self.stepper.unit:
                _, near = self._led(near, SpaceTipPose(across))
            arrived, pose = self._led(near, SpaceTipPose(task.middle))
            if arrived is not None:
                return CellFound(arrived=arrived.v, stone=stone, tried=number)
            if not self.free(pose):
                pose = near
            inside = bool(np.all(np.abs(pose.tip - task.middle) <= 0.5 * width))
            if stone is None and inside and self.free(pose):
                stone = pose.v
        return CellFound(stone=stone, tried=len(task.seeds))

    def turned(self, task: TurnTask, directions: FloatArray) -> CellFound:
        """Directions that a cell can have, each tried from the pose that points most nearly there."""
        pose = self.stepper.pose(task.seed)
        found = [pose]
        taken = np.zeros(len(directions), dtype=bool)
        for number in np.argsort(-directions @ pose.tip_direction):
            direction = directions[number]
            nearest = max(found, key=lambda each: float(each.tip_direction @ direction))
            turned, _ = self._led(nearest, SpaceTipPose(task.middle, direction))
            if turned is not None:
                found.append(turned)
                taken[number] = True
        return CellFound(taken=taken, gap=self._gap(pose))

    def free(self, pose: SpacePose) -> bool:
        """Whether a pose touches nothing and keeps all limits."""
        return self.stepper.within_limits(pose.q) and self.stepper.certificate.safe(pose.q, pose.q)

    def _gap(self, pose: SpacePose) -> float:
        """Room of a pose to the scene beyond radius and clearance, at most as far as is looked [m]."""
        arm = self.task.arm
        reach = self.settings.seen * arm.length
        segments = pose.segments_beyond(arm.mount_end)
        kept = arm.radius + self.task.clearance
        least = float(np.min(self.task.tree.distances(segments, reach + kept), initial=reach + kept))
        return least - kept

    def _led(self, pose: SpacePose, goal: SpaceTipPose) -> tuple[SpacePose | None, SpacePose]:
        """A free pose at a goal, from a pose near by, or None where it does not arrive; and how far it comes."""
        stepper = self.stepper
        before = np.inf
        for number in range(self.settings.steps):
            distance, turn = goal.errors(pose)
            left = distance / stepper.unit + turn
            if distance < 0.3 * stepper.unit and turn < 0.1:
                break
            if number % _ROUND == 0:
                if left > self.settings.progress * before:
                    return None, pose
                before = left
            pose = stepper.step(pose, [goal.term(pose, stepper.unit, 1.0 + number)], certified=False)
        onto = onto_goal(stepper, goal, pose, self.task.settings.goal_poses.polish_turn)
        return (onto if onto is not None and self.free(onto) else None), pose


def _into(middle: FloatArray, width: float, place: FloatArray) -> FloatArray:
    """A place moved into a cell along the axes on which it is not within it, as far as its middle there."""
    return np.where(np.abs(place - middle) > 0.5 * width, middle, place)
