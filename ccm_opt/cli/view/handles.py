"""Handles that are dragged, and what is planned anew.

World x is x; of the plane, world z is y, and handles keep to it.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol, TypeAlias

import numpy as np
import viser

from ccm_opt.cli.view.frames import MotionFrames, SpaceFrames, in_space, turned, turned_to
from ccm_opt.cli.view.scene import Scene, SpaceScene
from ccm_opt.cli.view.settings import VIEW, ViewSettings
from ccm_opt.core.arrays import FloatArray
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.errors import CcmError
from ccm_opt.problem import Goal, TipGoal
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.solution import JointStates, JointTrajectory


@dataclass
class Replanner:
    """Takes changes from any thread, plans them in one of its own, and tells what came of it.

    Attributes:
        live: the plan that follows.
        told: called, in the planner's thread, with the plan's answer or what is wrong with what was asked.
        settings: when it is quiet enough to plan anew.
    """

    live: LivePlan
    told: Callable[[LiveAnswer | str], None]
    settings: ViewSettings = VIEW
    _wanted: Callable[[], LiveAnswer] | None = None
    _fresh: bool = False
    _ended: bool = False
    _changed: threading.Condition = field(default_factory=threading.Condition)

    def start(self) -> None:
        """Begin to plan."""
        threading.Thread(target=self._run, daemon=True, name="replanner").start()

    def ask(self, change: Callable[[], LiveAnswer]) -> None:
        """Ask for a change; one that was asked for and not begun is forgotten."""
        with self._changed:
            self._wanted = change
            self._changed.notify()

    def end(self) -> None:
        """Plan nothing more."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _run(self) -> None:
        while (change := self._next()) is not None:
            try:
                self.told(change())
            except CcmError as error:
                self.told(str(error))

    def _next(self) -> Callable[[], LiveAnswer] | None:
        """The next change; after some quiet a plan from nothing; None at the end."""
        with self._changed:
            while not self._ended:
                if self._wanted is not None:
                    change, self._wanted, self._fresh = self._wanted, None, True
                    return change
                heard = self._changed.wait(self.settings.quiet if self._fresh else None)
                if not heard and self._fresh:
                    self._fresh = False
                    return partial(self.live.plan_anew, self.settings.anew)
        return None


Turn = FloatArray | float
"""Where a tip points: a heading in the plane [rad], a direction in space, shape (3,)."""


class HandleFrame(Protocol):
    """Between what is planned and what is dragged."""

    axes: tuple[bool, bool, bool]
    """Along which axes of the world a handle moves."""

    def goal_of(self, goal: Goal) -> tuple[FloatArray, Turn | None] | None:
        """Place of a goal for the tip [m], and where it points if that is asked for; None for a whole arm."""
        ...

    def in_world(self, place: FloatArray) -> FloatArray:
        """A place in the scene, shape (3,)."""
        ...

    def place(self, position: FloatArray) -> FloatArray:
        """What place a position in the scene, shape (3,), stands for."""
        ...

    def quaternion(self, turn: Turn) -> FloatArray:
        """A turn as a quaternion (w, x, y, z)."""
        ...

    def turn(self, wxyz: FloatArray) -> Turn:
        """What a quaternion (w, x, y, z) stands for."""
        ...


class PlaneHandles:
    """Handles that keep to the plane."""

    axes = (True, False, True)

    def goal_of(self, goal: Goal) -> tuple[FloatArray, Turn | None] | None:
        """Place (x, y) and heading."""
        return (goal.position, goal.heading) if isinstance(goal, TipGoal) else None

    def in_world(self, place: FloatArray) -> FloatArray:
        """The place, in the plane of world x and z."""
        return in_space(place)

    def place(self, position: FloatArray) -> FloatArray:
        """Its coordinates in the plane, shape (2,)."""
        return np.array([position[0], position[2]])

    def quaternion(self, turn: Turn) -> FloatArray:
        """A turn about the plane's normal."""
        return turned(np.array(turn))

    def turn(self, wxyz: FloatArray) -> float:
        """The heading of what world x is turned to [rad]."""
        x, _, z = direction_of(wxyz)
        return float(np.arctan2(z, x))


class SpaceHandles:
    """Handles that go anywhere."""

    axes = (True, True, True)

    def goal_of(self, goal: Goal) -> tuple[FloatArray, Turn | None] | None:
        """Place (x, y, z) and direction."""
        return (goal.position, goal.direction) if isinstance(goal, TipGoal) else None

    def in_world(self, place: FloatArray) -> FloatArray:
        """The place itself."""
        return place

    def place(self, position: FloatArray) -> FloatArray:
        """The position itself, shape (3,)."""
        return position

    def quaternion(self, turn: Turn) -> FloatArray:
        """The shortest turn of world x to a direction."""
        return turned_to(np.asarray(turn))

    def turn(self, wxyz: FloatArray) -> FloatArray:
        """The direction that world x is turned to, shape (3,)."""
        return direction_of(wxyz)


def direction_of(wxyz: FloatArray) -> FloatArray:
    """Where a quaternion (w, x, y, z) turns world x to, shape (3,)."""
    w, x, y, z = wxyz
    return np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])


GOAL = "the goal"
"""What can be dragged besides the obstacles."""


class Handles:
    """One handle at a time, on what people choose.

    Args:
        scene: where it stands.
        live: the plan that follows.
        frame: how handles stand for places of the plane, or of space.
        told: called with the plan and what came of a change, or what was wrong with it.
    """

    def __init__(
        self,
        scene: Scene | SpaceScene,
        live: LivePlan,
        frame: HandleFrame,
        told: Callable[[Any, LiveAnswer | str], None],
    ) -> None:
        self._scene = scene
        # Either plan, whose methods take places and turns of its own kind.
        self._live: Any = live
        self._frame = frame
        self._replanner = Replanner(live, lambda answer: told(live, answer), scene.settings)
        self._replanner.start()
        names = [obstacle.name for obstacle in live.problem.workspace.obstacles]
        movable = names if frame.goal_of(live.problem.goal) is None else [GOAL, *names]
        if not movable:
            return
        with scene.server.gui.add_folder("Drag"):
            chosen = scene.server.gui.add_dropdown("what", movable, initial_value=movable[0])
        chosen.on_update(lambda event: self.put_on(event.target.value))
        self.put_on(movable[0])

    def end(self) -> None:
        """Plan nothing more."""
        self._replanner.end()

    def put_on(self, what: str) -> None:
        """Put the handle on the goal, or on an obstacle of a name."""
        goal = self._frame.goal_of(self._live.problem.goal)
        if what == GOAL and goal is not None:
            self._put_on_goal(*goal)
        else:
            self._put_on_obstacle(what)

    def _put_on_goal(self, place: FloatArray, turn: Turn | None) -> None:
        handle = self._handle(place, turn)

        def dragged(_: Any) -> None:
            moved = self._place(handle)
            turned = None if turn is None else self._frame.turn(np.asarray(handle.wxyz))
            self._replanner.ask(lambda: self._live.move_goal(moved, turned))

        handle.on_update(dragged)

    def _put_on_obstacle(self, name: str) -> None:
        handle = self._handle(self._live.problem.workspace.middle_of(name), None)

        def change(place: FloatArray) -> LiveAnswer:
            # Where it is now is known only when the change is made: others may have been made meanwhile.
            by = place - self._live.problem.workspace.middle_of(name)
            answer: LiveAnswer = self._live.move_obstacle(name, by)
            return answer

        def dragged(_: Any) -> None:
            place = self._place(handle)
            self._replanner.ask(lambda: change(place))

        handle.on_update(dragged)

    def _handle(self, place: FloatArray, turn: Turn | None) -> Any:
        """A handle that moves, and turns where it is asked where the tip points."""
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        return self._scene.server.scene.add_transform_controls(
            "/handle",
            scale=0.2,
            active_axes=self._frame.axes,
            disable_rotations=turn is None,
            depth_test=False,
            position=self._frame.in_world(place / self._scene.unit),
            wxyz=upright if turn is None else self._frame.quaternion(turn),
        )

    def _place(self, handle: Any) -> FloatArray:
        """The place where a handle is [m]."""
        return self._frame.place(np.asarray(handle.position, dtype=np.float64)) * self._scene.unit


AnyFrames: TypeAlias = MotionFrames | SpaceFrames
"""The poses of a motion."""


def frames_of(
    problem: AnyProblem, trajectory: JointTrajectory, joints: JointStates, settings: ViewSettings = VIEW
) -> AnyFrames:
    """The poses of a motion of a problem of either kind."""
    if isinstance(problem, SpaceProblem):
        return SpaceFrames(problem, trajectory, joints, settings)
    return MotionFrames(problem, trajectory, joints, settings)


def scene_of(server: viser.ViserServer, frames: AnyFrames, settings: ViewSettings) -> Scene | SpaceScene:
    """The scene that shows a motion."""
    if isinstance(frames, SpaceFrames):
        return SpaceScene(server, frames, settings)
    return Scene(server, frames, settings)


def handles_of(
    scene: Scene | SpaceScene, live: LivePlan | None, told: Callable[[Any, LiveAnswer | str], None]
) -> Handles | None:
    """Handles on what can be dragged; None where nothing can."""
    if live is None:
        return None
    return Handles(scene, live, SpaceHandles() if isinstance(scene, SpaceScene) else PlaneHandles(), told)
