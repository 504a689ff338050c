"""Handles on the goal and the obstacles: what is dragged with them is planned again."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ccm_opt.cli.view.handle_frame import HandleFrame, Turn
from ccm_opt.cli.view.replanner import Replanner
from ccm_opt.cli.view.scene import Scene
from ccm_opt.cli.view.space_scene import SpaceScene
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.driver.live_plan_in_space import LivePlanInSpace
from ccm_opt.ground.arrays import FloatArray

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
        live: LivePlan | LivePlanInSpace,
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
