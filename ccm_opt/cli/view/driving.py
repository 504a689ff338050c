"""Driving of the tip by hand in the viewer: keyboard, gamepad or a handle, and the thread that makes the ticks."""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ccm_opt.cli.view.hand import PATIENCE, Asked, Hands
from ccm_opt.cli.view.scene import Scene, rotation_matrix
from ccm_opt.cli.view.settings import VIEW
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import CcmError
from ccm_opt.driver.servo import Servo, ServoStep, Twist
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.solution import Solution
from ccm_opt.scene.tool_links import points_with_tool
from ccm_opt.viz.document import PageUnits

_SHOWN = 1.0 / 30.0
"""Wall time between poses that are sent to the browser [s]."""
_TOLD = 0.2
"""Wall time between updates of the text [s]."""
_TURN = 0.5
"""Greatest angular velocity of the tip [rad/s]. Heuristic."""
_SPEED = 0.1
"""Speed of the tip at the beginning [arm lengths / s]. Heuristic."""
_HANDLE = "/hand"
_HELP = (
    "Arrow keys move the tip as the camera sees it, W and S (or page up and down) away and back; with shift they turn "
    "it. Gamepad: the sticks; the shoulders turn. Or drag the handle at the tip."
)


class Driver:
    """A servo that is stepped at its rate in a thread of its own, until it is told to end.

    Without a command for some time, as when messages of the page are lost, the arm goes on with its certified braking.

    Args:
        servo: the servo.
        command: function that returns the command of a tick; None if there is none.
        shown: function called in the thread with each step, the number of ticks made in the last second, and whether a
            command was there.
        ended: function called in the thread with the servo when the arm rests after ``end``.
    """

    def __init__(
        self,
        servo: Servo,
        command: Callable[[], Twist | TipGoal | None],
        shown: Callable[[ServoStep, float, bool], None],
        ended: Callable[[Servo], None],
    ) -> None:
        self.servo = servo
        self._command, self._shown, self._ended = command, shown, ended
        self._ending = threading.Event()
        self._still = Twist(np.zeros(servo.problem.dimension))

    def start(self) -> None:
        """Start the thread."""
        threading.Thread(target=self._run, daemon=True, name="driver").start()

    def end(self) -> None:
        """Brake the arm, and end the thread when it rests."""
        self._ending.set()

    def _run(self) -> None:
        due = time.monotonic()
        made = [due]
        while self.servo.moving or not self._ending.is_set():
            command = None if self._ending.is_set() else self._command()
            now = time.monotonic()
            if command is not None or self.servo.moving:
                # A tick without velocity goes on with the braking that is held.
                step = self.servo.step(self._still if command is None else command)
                made = [at for at in made if now - at < 1.0] + [now]
                self._shown(step, len(made) / max(now - made[0], self.servo.period), command is not None)
            due = max(due + self.servo.period, now)
            time.sleep(max(due - time.monotonic(), 0.0))
        self._ended(self.servo)


class DriveControls:
    """Controls of the viewer with which the tip is driven.

    Args:
        scene: scene that shows the arm.
        hands: hands at the pages.
        begin: function that returns the problem whose start is the pose shown, called when driving begins.
        moved: function called a few times a second with the configuration of the arm, while it is driven.
        ended: function called with the driven motion when the arm rests again; None if it was not moved.
    """

    def __init__(
        self,
        scene: Scene,
        hands: Hands,
        begin: Callable[[], Problem],
        moved: Callable[[FloatArray], None],
        ended: Callable[[Solution | None], None],
    ) -> None:
        self._scene, self._hands, self._begin, self._moved, self._ended = scene, hands, begin, moved, ended
        self._driver: Driver | None = None
        self._driven: Solution | None = None
        self._target: FloatArray | None = None
        self._handle: Any = None
        self._last = self._said = 0.0
        self._tip = np.zeros(3)
        problem = scene.frames.problem
        gui = scene.server.gui
        self._units = PageUnits.of_page(problem)
        with gui.add_folder("Drive", expand_by_default=False):
            self._switch: Any = gui.add_checkbox("drive by hand", initial_value=False)
            most = round(5.0 * _SPEED * scene.unit / self._units.metres, 4)
            self._speed: Any = gui.add_slider(
                f"speed [{self._units.name}/s]", most / 100.0, most, most / 100.0, 0.2 * most
            )
            self._folder: Any = gui.add_text("folder", f"runs/{problem.name}-driven")
            self._save: Any = gui.add_button("save", disabled=True)
            self._words: Any = gui.add_markdown(_HELP)
        self._switch.on_update(lambda event: self._switched(on=event.target.value))
        self._save.on_click(lambda _: self._saved())

    @property
    def driving(self) -> bool:
        """Whether the arm is driven, or brakes."""
        return self._driver is not None

    def end(self) -> None:
        """Stop driving."""
        if self._driver is not None:
            self._driver.end()

    # ------------------------------------------------------------ begin and end
    def _switched(self, *, on: bool) -> None:
        if not on:
            self.end()
            return
        if self._driver is not None:
            return  # it still brakes
        self._words.content = "*preparing …*"
        try:
            servo = Servo(self._begin())
        except CcmError as error:
            self._words.content = f"**Not driven.** {error}"
            self._switch.value = False
            return
        self._target = None
        arm = servo.problem.arm
        self._tip = points_with_tool(arm, servo.problem.start.configuration(arm))[-1]
        self._put_handle()
        self._words.content = _HELP
        self._save.disabled = True
        self._hands.driving = True
        self._driver = Driver(servo, self._command, self._shown, self._rests)
        self._driver.start()

    def _rests(self, servo: Servo) -> None:
        """Show the motion that a servo has driven, now that the arm rests."""
        self._driver = None
        self._hands.driving = False
        self._scene.server.scene.remove_by_name(_HANDLE)
        self._handle = None
        self._switch.value = False
        if servo.ticks == 0:
            self._ended(None)
            return
        self._words.content = "*verifying the driven motion …*"
        try:
            driven = servo.solution()
        except CcmError as error:
            self._words.content = f"**The driven motion is refused.** {error}"
            self._ended(None)
            return
        self._driven = driven
        passed = sum(check.passed for check in driven.checks)
        self._words.content = f"driven for {driven.trajectory.duration:.2f} s; all {passed} checks passed"
        self._save.disabled = False
        self._ended(driven)

    def _saved(self) -> None:
        if self._driven is None:
            return
        try:
            folder = self._driven.save(Path(self._folder.value))
        except CcmError as error:
            self._words.content = f"**Not saved.** {error}"
        else:
            self._words.content = f"saved to `{folder}`"

    # ------------------------------------------------------------ commands
    def _command(self) -> Twist | TipGoal | None:
        """Return the command of a tick: that of the hand or, while it rests, the way to the handle; None without."""
        asked = self._hands.asked()
        if asked is None:
            self._target = None
            return None
        if np.any(asked.hand):
            self._target = None
            return self._twist(asked)
        if self._target is None:
            return None
        off = float(np.linalg.norm(self._target - self._tip))
        return TipGoal.at(self._target) if off > 1e-3 * self._scene.unit else None

    def _twist(self, asked: Asked) -> Twist | None:
        """Return the velocity that a hand asks for, as seen by the camera; None without a camera."""
        cameras = [client.camera for client in self._scene.server.get_clients().values()]
        if not cameras:
            return None
        right, down, away = rotation_matrix(np.asarray(cameras[-1].wxyz)).T
        x, y, z = asked.hand
        arm = self._scene.frames.problem.arm
        axes = arm.embedded(np.eye(arm.dimension))
        if not asked.turns:
            velocity = axes @ (x * right - y * down + z * away)
            return Twist(float(self._speed.value) * self._units.metres * velocity)
        # Right turns about the upward axis of the picture, up about the axis to the right.
        if arm.dimension == 2:
            return Twist(np.zeros(2), -_TURN * x)
        return Twist(np.zeros(3), _TURN * (axes @ (x * down + y * right + z * away)))

    def _put_handle(self) -> None:
        """Draw the handle at the tip."""
        arm = self._scene.frames.problem.arm
        self._handle = self._scene.server.scene.add_transform_controls(
            _HANDLE,
            scale=VIEW.handle,
            fixed=True,
            active_axes=(True, arm.dimension == 3, True),
            disable_rotations=True,
            depth_test=False,
            position=self._scene.world(self._tip),
        )
        axes = arm.embedded(np.eye(arm.dimension))

        def dragged(event: Any) -> None:
            if event.client is not None:
                self._target = axes @ np.asarray(event.target.position, dtype=np.float64) * self._scene.unit

        self._handle.on_update(dragged)

    # ------------------------------------------------------------ what is shown
    def _shown(self, step: ServoStep, rate: float, commanded: bool) -> None:
        """Show the arm after a tick, and a few times a second what it loses and why."""
        now = time.monotonic()
        if now - self._last < _SHOWN:
            return
        self._last = now
        arm = self._scene.frames.problem.arm
        points = points_with_tool(arm, step.positions)
        self._tip = points[-1]
        with suppress(AttributeError):  # the scene may be drawn anew meanwhile
            self._scene.place(points)
        if self._target is None and self._handle is not None:
            self._handle.position = self._scene.world(self._tip)
        if now - self._said < _TOLD:
            return
        self._said = now
        self._moved(step.positions)
        lines = [f"{step.time:.1f} s driven, {rate:.0f} ticks a second"]
        if self._hands.asked() is None:
            lines.append(f"**stopped**: no message from the page for {PATIENCE} s")
        elif commanded and step.reasons:
            lost = f"{100.0 * min(step.lost, 1.0):.0f} % of the velocity"
            if step.lost_turn > step.lost:
                lost = f"{100.0 * min(step.lost_turn, 1.0):.0f} % of the turn"
            lines += [f"**{lost} is lost**", *(f"- {reason}" for reason in step.reasons)]
        self._words.content = "\n\n".join(lines)
