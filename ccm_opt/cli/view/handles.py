"""Handles on the goal and the obstacles: what is dragged with them is planned again."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ccm_opt.cli.view.meshes import in_space, turned
from ccm_opt.cli.view.replanner import Replanner
from ccm_opt.cli.view.scene import Scene
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import TipGoal

GOAL = "the goal"
"""What can be dragged besides the obstacles."""


class Handles:
    """One handle at a time, on what people choose.

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
        problem = self._live.problem
        if what == GOAL and isinstance(problem.goal, TipGoal):
            self._put_on_goal(problem.goal)
        else:
            self._put_on_obstacle(what)

    def _put_on_goal(self, goal: TipGoal) -> None:
        handle = self._handle(goal.position, goal.heading)

        def dragged(_: Any) -> None:
            place = self._place(handle)
            heading = None if goal.heading is None else heading_of(np.asarray(handle.wxyz))
            self._replanner.ask(lambda: self._live.move_goal(place, heading))

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

    def _handle(self, place: FloatArray, heading: float | None) -> Any:
        """A handle that moves in the plane, and turns where there is a heading."""
        return self._scene.server.scene.add_transform_controls(
            "/handle",
            scale=0.2,
            active_axes=(True, False, True),
            disable_rotations=heading is None,
            depth_test=False,
            position=in_space(place / self._scene.unit),
            wxyz=turned(np.array(0.0 if heading is None else heading)),
        )

    def _place(self, handle: Any) -> FloatArray:
        """Where a handle is in the plane, shape (2,) [m]."""
        x, _, z = handle.position
        return np.array([x, z]) * self._scene.unit


def heading_of(wxyz: FloatArray) -> float:
    """The heading in the plane of what a quaternion (w, x, y, z) turns world x to [rad]."""
    w, x, y, z = wxyz
    return float(np.arctan2(2.0 * (x * z - w * y), 1.0 - 2.0 * (y * y + z * z)))
