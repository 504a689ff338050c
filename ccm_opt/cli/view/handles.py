"""Handles that are dragged, and what is planned anew."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from ccm_opt.cli.view.frames import turned_to
from ccm_opt.cli.view.scene import Scene
from ccm_opt.cli.view.settings import VIEW, ViewSettings
from ccm_opt.core.arrays import FloatArray
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.errors import CcmError
from ccm_opt.problem import TipGoal


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


def direction_of(wxyz: FloatArray) -> FloatArray:
    """Where a quaternion (w, x, y, z) turns world x to, shape (3,)."""
    w, x, y, z = wxyz
    return np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])


GOAL = "the goal"
"""What can be dragged besides the obstacles."""


class Handles:
    """One handle at a time, on what people choose; of the plane it keeps to the plane.

    Args:
        scene: where it stands.
        live: the plan that follows.
        told: called with the plan and what came of a change, or what was wrong with it.
    """

    def __init__(self, scene: Scene, live: LivePlan, told: Callable[[LivePlan, LiveAnswer | str], None]) -> None:
        self._scene = scene
        self._live = live
        self._replanner = Replanner(live, lambda answer: told(live, answer), scene.settings)
        self._replanner.start()
        names = [obstacle.name for obstacle in live.problem.workspace.obstacles]
        movable = [GOAL, *names] if isinstance(live.problem.goal, TipGoal) else names
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
        goal = self._live.problem.goal
        if what == GOAL and isinstance(goal, TipGoal):
            self._put_on_goal(goal.position, goal.direction)
        else:
            self._put_on_obstacle(what)

    def _put_on_goal(self, place: FloatArray, direction: FloatArray | None) -> None:
        handle = self._handle(place, direction)

        def dragged(_: Any) -> None:
            moved = self._place(handle)
            turned = None if direction is None else self._from_world(direction_of(np.asarray(handle.wxyz)))
            self._replanner.ask(lambda: self._live.move_goal(moved, turned))

        handle.on_update(dragged)

    def _put_on_obstacle(self, name: str) -> None:
        handle = self._handle(self._live.problem.workspace.middle_of(name), None)

        def change(place: FloatArray) -> LiveAnswer:
            # Where it is now is known only when the change is made: others may have been made meanwhile.
            return self._live.move_obstacle(name, place - self._live.problem.workspace.middle_of(name))

        def dragged(_: Any) -> None:
            place = self._place(handle)
            self._replanner.ask(lambda: change(place))

        handle.on_update(dragged)

    def _handle(self, place: FloatArray, direction: FloatArray | None) -> Any:
        """A handle that moves, and turns where it is asked where the tip points."""
        arm = self._live.problem.arm
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        return self._scene.server.scene.add_transform_controls(
            "/handle",
            scale=0.2,
            active_axes=(True, arm.dimension == 3, True),
            disable_rotations=direction is None,
            depth_test=False,
            position=self._scene.world(place),
            wxyz=upright if direction is None else turned_to(arm.embedded(direction)),
        )

    def _place(self, handle: Any) -> FloatArray:
        """The place where a handle is, shape (d,) [m]."""
        return self._from_world(np.asarray(handle.position, dtype=np.float64)) * self._scene.unit

    def _from_world(self, vector: FloatArray) -> FloatArray:
        """What of a vector in the world, shape (3,), is in the plane of the arm, shape (d,)."""
        return self._live.problem.arm.embedded(np.eye(self._live.problem.dimension)) @ vector
