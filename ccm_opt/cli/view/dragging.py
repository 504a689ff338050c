"""Dragging of goals and obstacles in the viewer, and the thread that plans again."""

import threading
from collections.abc import Callable
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from ccm_opt.cli.view.frames import rotation_to_axis
from ccm_opt.cli.view.scene import Scene, rotation_matrix
from ccm_opt.cli.view.settings import VIEW, ViewSettings
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import CcmError
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.problem.poses import name_suffix


class Replanner:
    """Planner in a separate thread that accepts changes of a plan from any thread and reports the results.

    Args:
        live: plan that is changed.
        on_answer: function called in the planning thread with the result of a change, or the reason why it is invalid.
        settings: viewer settings, which say when and for how long to plan from scratch.
        on_begin: function called in the planning thread when planning begins.
    """

    def __init__(
        self,
        live: LivePlan,
        on_answer: Callable[[LiveAnswer | str], None],
        settings: ViewSettings = VIEW,
        on_begin: Callable[[], None] = lambda: None,
    ) -> None:
        self._live, self._on_answer, self._settings, self._on_begin = live, on_answer, settings, on_begin
        self._requested: SimpleQueue[Callable[[], LiveAnswer] | threading.Event | None] = SimpleQueue()

    def start(self) -> None:
        """Start the planning thread."""
        threading.Thread(target=self._run, daemon=True, name="replanner").start()

    def ask(self, change: Callable[[], LiveAnswer]) -> None:
        """Request a change of the plan; an earlier request that is still waiting is dropped.

        Args:
            change: function that makes the change and returns the result.
        """
        self._requested.put(change)

    def rest(self) -> None:
        """Drop all requests, and wait until nothing is planned; another request ends that."""
        rests = threading.Event()
        self._requested.put(rests)
        rests.wait()

    def end(self) -> None:
        """Stop the planning thread after the current change."""
        self._requested.put(None)

    def _run(self) -> None:
        """Loop until ``end``: make the change requested last, and after a period without requests plan from scratch."""
        quiet = None
        while True:
            try:
                change = self._requested.get(timeout=quiet)
                while not self._requested.empty() and not isinstance(change, threading.Event):
                    change = self._requested.get()
                quiet = self._settings.quiet
            except Empty:
                change, quiet = partial(self._live.plan_anew, self._settings.anew), None
            if change is None:
                return
            if isinstance(change, threading.Event):
                change.set()
                quiet = None
                continue
            self._on_begin()
            try:
                self._on_answer(change())
            except CcmError as error:
                self._on_answer(str(error))


HANDLE = "/handle"
"""Path of the handle in the scene."""
GOAL = "the goal"
"""Name of the only goal in the list of objects that the user can drag; of several goals each has its number."""


class Handles:
    """The handle with which the user drags a goal or an obstacle, one at a time; planar for planar arms.

    Args:
        scene: scene that contains the handle.
        live: plan that is changed.
        on_answer: function called with the plan and the result of a change, or the reason why it is invalid.
        on_begin: function called when planning begins.
    """

    def __init__(
        self,
        scene: Scene,
        live: LivePlan,
        on_answer: Callable[[LivePlan, LiveAnswer | str], None],
        on_begin: Callable[[], None],
    ) -> None:
        self._scene = scene
        self._live = live
        self._replanner = Replanner(live, lambda answer: on_answer(live, answer), on_begin=on_begin)
        self._replanner.start()
        goals = live.problem.goals
        self._goals = {
            (GOAL if len(goals) == 1 else f"goal {number}") + name_suffix(stop.goal): number
            for number, stop in enumerate(goals, start=1)
            if stop.goal.whole(live.problem.arm) is None
        }
        self._chosen = ""
        movable = [*self._goals, *(obstacle.name for obstacle in live.problem.workspace.obstacles)]
        if not movable:
            return
        with scene.server.gui.add_folder("Drag"):
            chosen = scene.server.gui.add_dropdown("what", movable, initial_value=movable[0])
        chosen.on_update(lambda event: self.attach_handle(event.target.value))
        self.attach_handle(movable[0])

    def end(self) -> None:
        """Stop the planning thread."""
        self._replanner.end()

    def hide(self) -> None:
        """Remove the handle until ``show``, and wait until nothing is planned."""
        self._scene.server.scene.remove_by_name(HANDLE)
        self._replanner.rest()

    def show(self) -> None:
        """Put the handle back where it was."""
        if self._chosen:
            self.attach_handle(self._chosen)

    def attach_handle(self, what: str) -> None:
        """Put the handle on the goal, or on the obstacle, of the given name."""
        self._chosen = what
        if what in self._goals:
            self._put_on_goal(self._goals[what])
        else:
            self._put_on_obstacle(what)

    def _put_on_goal(self, number: int) -> None:
        goal = self._live.problem.goals[number - 1].goal
        direction = goal.direction
        handle = self._handle(goal.tip(self._live.problem.arm), direction)

        def dragged(_: Any) -> None:
            moved = self._place(handle)
            turned = None if direction is None else self._from_world(rotation_matrix(np.asarray(handle.wxyz))[:, 0])
            self._replanner.ask(lambda: self._live.move_goal(moved, turned, number))

        handle.on_update(dragged)

    def _put_on_obstacle(self, name: str) -> None:
        handle = self._handle(self._live.problem.workspace.obstacle_centre(name), None)

        def change(place: FloatArray) -> LiveAnswer:
            # The obstacle's position is read when the change is made, since other changes may come first.
            return self._live.move_obstacle(name, place - self._live.problem.workspace.obstacle_centre(name))

        def dragged(_: Any) -> None:
            place = self._place(handle)
            self._replanner.ask(lambda: change(place))

        handle.on_update(dragged)

    def _handle(self, place: FloatArray, direction: FloatArray | None) -> Any:
        """Return a new handle that can be moved, and also rotated if the goal has a direction.

        Args:
            place: position of the handle, shape (2,) or (3,) [m].
            direction: direction of the goal, a unit vector; None for a handle without rotation.
        """
        arm = self._live.problem.arm
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        return self._scene.server.scene.add_transform_controls(
            HANDLE,
            scale=VIEW.handle,
            fixed=True,
            active_axes=(True, arm.dimension == 3, True),
            disable_rotations=direction is None,
            depth_test=False,
            position=self._scene.world(place),
            wxyz=upright if direction is None else rotation_to_axis(arm.embedded(direction)),
        )

    def _place(self, handle: Any) -> FloatArray:
        """Return the position of a handle in the arm's coordinates, shape (2,) or (3,) [m]."""
        return self._from_world(np.asarray(handle.position, dtype=np.float64)) * self._scene.unit

    def _from_world(self, vector: FloatArray) -> FloatArray:
        """Return a vector given in scene coordinates, shape (3,), in the arm's coordinates, shape (2,) or (3,)."""
        return self._live.problem.arm.embedded(np.eye(self._live.problem.dimension)) @ vector
