"""Web server and controls of the viewer, and the handles with which goals and obstacles are dragged."""

import dataclasses
import http
import io
import logging
import os
import re
import secrets
import socket
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from math import floor
from queue import Empty, SimpleQueue
from typing import Any
from unittest import mock

import numpy as np
import viser
import websockets.asyncio.server
from websockets import Headers
from websockets.http11 import Request, Response

from ccm_opt.cli.view.frames import MotionFrames, rotation_to_axis
from ccm_opt.cli.view.scene import Scene
from ccm_opt.cli.view.settings import VIEW, ViewSettings
from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.errors import CcmError, ProblemError
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.problem.solution import Check
from ccm_opt.viz.document import PageUnits


class Replanner:
    """Planner in a separate thread that accepts changes of a plan from any thread and reports the results.

    Args:
        live: plan that is changed.
        on_answer: function called in the planning thread with the result of a change, or the reason why it is invalid.
        settings: viewer settings, which say when and for how long to plan from scratch.
    """

    def __init__(
        self, live: LivePlan, on_answer: Callable[[LiveAnswer | str], None], settings: ViewSettings = VIEW
    ) -> None:
        self._live, self._on_answer, self._settings = live, on_answer, settings
        self._requested: SimpleQueue[Callable[[], LiveAnswer] | None] = SimpleQueue()

    def start(self) -> None:
        """Start the planning thread."""
        threading.Thread(target=self._run, daemon=True, name="replanner").start()

    def ask(self, change: Callable[[], LiveAnswer]) -> None:
        """Request a change of the plan; an earlier request that is still waiting is dropped.

        Args:
            change: function that makes the change and returns the result.
        """
        self._requested.put(change)

    def end(self) -> None:
        """Stop the planning thread after the current change."""
        self._requested.put(None)

    def _run(self) -> None:
        """Loop until ``end``: make the change requested last, and after a period without requests plan from scratch."""
        quiet = None
        while True:
            try:
                change = self._requested.get(timeout=quiet)
                while not self._requested.empty():
                    change = self._requested.get()
                quiet = self._settings.quiet
            except Empty:
                change, quiet = partial(self._live.plan_anew, self._settings.anew), None
            if change is None:
                return
            try:
                self._on_answer(change())
            except CcmError as error:
                self._on_answer(str(error))


def direction_of(wxyz: FloatArray) -> FloatArray:
    """Return the world x axis rotated by a quaternion (w, x, y, z), shape (3,)."""
    w, x, y, z = wxyz
    return np.array([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])


GOAL = "the goal"
"""Name of the goal in the list of objects that the user can drag."""


class Handles:
    """The handle with which the user drags the goal or an obstacle, one at a time; planar for planar arms.

    Args:
        scene: scene that contains the handle.
        live: plan that is changed.
        on_answer: function called with the plan and the result of a change, or the reason why it is invalid.
    """

    def __init__(self, scene: Scene, live: LivePlan, on_answer: Callable[[LivePlan, LiveAnswer | str], None]) -> None:
        self._scene = scene
        self._live = live
        self._replanner = Replanner(live, lambda answer: on_answer(live, answer))
        self._replanner.start()
        names = [obstacle.name for obstacle in live.problem.workspace.obstacles]
        movable = [GOAL, *names] if live.problem.goal.whole(live.problem.arm) is None else names
        if not movable:
            return
        with scene.server.gui.add_folder("Drag"):
            chosen = scene.server.gui.add_dropdown("what", movable, initial_value=movable[0])
        chosen.on_update(lambda event: self.attach_handle(event.target.value))
        self.attach_handle(movable[0])

    def end(self) -> None:
        """Stop the planning thread."""
        self._replanner.end()

    def attach_handle(self, what: str) -> None:
        """Put the handle on the goal, or on the obstacle of the given name."""
        problem = self._live.problem
        if what == GOAL and problem.goal.whole(problem.arm) is None:
            self._put_on_goal(problem.goal.tip(problem.arm), problem.goal.direction)
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
            "/handle",
            scale=0.2,
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


_FRAME_RATE = 30.0
"""Rate at which poses are sent to the browser during playback [1/s]."""
_SLIDER_RATE = 10.0
"""Rate at which the time slider is updated during playback [1/s]."""

LOOPBACK = "127.0.0.1"
"""Address on which the page is served: to this machine only, since anyone who loads the page can start planning."""
HOST = re.compile(r"(127\.0\.0\.1|localhost)(:\d{1,5})?", re.ASCII)
"""Pattern of the host names with which a browser on this machine requests the page; others suggest an attack by DNS
rebinding."""
PATIENCE = 0.2
"""Maximum time to wait for connected pages when the viewer ends, so that Ctrl-C ends it within a second [s]."""
SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")


def claim_port(port: int) -> socket.socket:
    """Return a listening socket for the viewer's page, reachable from this machine only.

    Args:
        port: port number; 0 for any free port.

    Raises:
        ProblemError: the port is in use, or not allowed.
    """
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise ProblemError(
            f"port {port} of this machine cannot be used ({os.strerror(error.errno or 0)}); another "
            "`ccm-opt view` may be running; choose another with --port, or any free one with --port 0"
        ) from error


def refusal(request: Request, token: str) -> str | None:
    """Return the reason to refuse a web request; None for a request from this viewer's page.

    DNS rebinding by another site shows in the header `Host`, and a page of another origin in `Origin`, which browsers
    send with every WebSocket request. Neither knows the secret token in the path of the page.

    Args:
        request: the request.
        token: the secret token.
    """
    hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
    if len(hosts) != 1 or not HOST.fullmatch(hosts[0]):
        return "another host"
    if origins != [f"http://{hosts[0]}"] and (origins or "Upgrade" in request.headers):
        return "another origin"
    path = request.path.partition("?")[0].strip("/")
    return None if secrets.compare_digest(path.encode(errors="replace"), token.encode()) else "no such page"


def _serve_guarded(
    serve: Callable[..., Any],
    door: socket.socket,
    token: str,
    handler: Any,
    _host: str,
    _port: int,
    *,
    process_request: Callable[[Any, Request], Response | None],
    **options: Any,
) -> Any:
    """Start a web server on an open socket that refuses all requests but those of the viewer's page.

    Called by viser in place of ``websockets.asyncio.server.serve``, whose arguments follow the first three.

    Args:
        serve: the original function.
        door: the open socket.
        token: secret token in the path of the page.
        handler: handler of WebSocket connections.
        process_request: viser's handler of web requests, called for those not refused.
        options: further options of the original function.
    """

    def answer(connection: Any, request: Request) -> Response | None:
        reason = refusal(request, token)
        if reason is not None:
            return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", Headers(), f"{reason}\n".encode())
        response = process_request(connection, dataclasses.replace(request, path="/"))
        if response is not None:
            response.headers["Referrer-Policy"] = "no-referrer"  # links on the page must not reveal the token
        return response

    # Malformed requests are refused too, and need no message on the terminal.
    logging.getLogger("websockets.server").addFilter(lambda record: "opening handshake" not in record.msg)
    return serve(handler, sock=door, process_request=answer, **options)


class ViewerApp:
    """Web application that shows a motion in the browser.

    Args:
        frames: the motion shown first, of an arm of equal links.
        live: plan that is changed by dragging; None if nothing can be dragged.
        door: socket opened by `claim_port`.
        checks: verifier's checks of the first motion; empty if unknown.

    Attributes:
        frames: the motion shown.
        live: plan that is changed by dragging, or None.
        token: secret token in the path of the page.
        server: web server of the page.
        scene: scene of the motion.
        time: time of the pose shown [s]; beyond the duration while the final pose is held.
    """

    def __init__(
        self, frames: MotionFrames, live: LivePlan | None, door: socket.socket, checks: tuple[Check, ...] = ()
    ) -> None:
        self.frames, self.live = frames, live
        self.token = secrets.token_urlsafe(32)
        self.time = 0.0
        self._lock = threading.RLock()
        # viser offers no hook for requests, so it is given a server that has one. Its banner on stdout is suppressed.
        serve = partial(_serve_guarded, websockets.asyncio.server.serve, door, self.token)
        with mock.patch.object(websockets.asyncio.server, "serve", serve), redirect_stdout(io.StringIO()):
            port = door.getsockname()[1]
            self.server = viser.ViserServer(host=LOOPBACK, port=port, label="ccm-opt view", verbose=False)
        if self.server.get_port() != port:  # viser did not use the given server, so the page is not guarded
            self.server.stop()
            raise ProblemError(
                "this version of viser does not let the viewer protect its page; install a newer one: pip "
                "install -U viser"
            )
        self.scene = Scene(self.server, frames)
        self.scene.draw()
        self.server.on_client_connect(self.scene.look)
        self._status = self.server.gui.add_markdown("")
        self._build_player()
        self._build_layers()
        self._handles = None if live is None else Handles(self.scene, live, self._planned)
        self._status.content = _summary(frames, checks)

    @property
    def address(self) -> str:
        """URL of the page, with the secret token that every request needs."""
        return f"http://{LOOPBACK}:{self.server.get_port()}/{self.token}"

    @property
    def _end(self) -> float:
        """Maximum of the time slider, the duration rounded down to a millisecond [s]."""
        return floor(1e3 * self.frames.duration) / 1e3

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Play the motion until Ctrl-C, or until the function ``until`` returns true."""
        try:
            last = time.monotonic()
            slid = last
            while not until():
                time.sleep(1.0 / _FRAME_RATE)
                now = time.monotonic()
                with self._lock:
                    if self._play.value:
                        self._advance(now - last)
                        if now - slid >= 1.0 / _SLIDER_RATE:
                            slid = now
                            self._slider.value = round(min(self.time, self._end), 3)
                last = now
        finally:
            if self._handles is not None:
                self._handles.end()
            # viser waits five seconds for a page that does not answer.
            stopping = threading.Thread(target=self.server.stop, daemon=True)
            stopping.start()
            stopping.join(PATIENCE)

    def _advance(self, wall: float) -> None:
        """Advance playback by a wall time [s]; the final pose is held for a moment before the motion restarts."""
        speed = float(self._speed.value)
        self.time += speed * wall
        if self.time > self.frames.duration + speed * VIEW.rest:
            self.time = 0.0
        self._pose()

    def _pose(self) -> None:
        self.scene.pose(min(self.time, self.frames.duration))

    def _build_player(self) -> None:
        gui = self.server.gui
        with gui.add_folder("Play"):
            self._play: Any = gui.add_checkbox("playing", initial_value=True)
            self._slider: Any = gui.add_slider("time [s]", 0.0, self._end, 0.001, 0.0)
            self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")

        self._slider.on_update(self._slid)

    def _slid(self, event: Any) -> None:
        # Events from people have a client; those of the player have none.
        if event.client is not None:
            with self._lock:
                self._play.value = False
                self.time = float(self._slider.value)
                self._pose()

    def _build_layers(self) -> None:
        gui = self.server.gui
        with gui.add_folder("Layers"):
            colour = gui.add_dropdown("link colour", ("nothing", "gap", "torque"), initial_value="nothing")
            boxes = {
                layer: gui.add_checkbox(layer, initial_value=layer in self.scene.shown) for layer in self.scene.layers
            }

        colour.on_update(self._coloured)
        for layer, box in boxes.items():
            box.on_update(partial(self._switched, layer))

    def _coloured(self, event: Any) -> None:
        with self._lock:
            self.scene.colour_by = event.target.value
            self._pose()

    def _switched(self, layer: str, event: Any) -> None:
        with self._lock:
            self.scene.switch(layer, on=event.target.value)

    def _planned(self, live: LivePlan, answer: LiveAnswer | str) -> None:
        """Show the result of a change: the new plan, or the last plan with the reason why no new one was found."""
        with self._lock:
            self.scene.draw_bounds(live.problem)
            if isinstance(answer, str):
                self._status.content = f"**Not planned.** {answer}"
                return
            if not answer.current:
                self._status.content = f"**No plan; the last one is shown.** {answer.reason}"
                return
            plan = live.plan
            share = self.time / max(self.frames.duration, TINY)
            self.frames = MotionFrames(plan.problem, plan.trajectory, plan.joints)
            self.scene.frames = self.frames
            self.scene.draw_motion()
            self.time = share * self.frames.duration
            self._pose()
            self._slider.max = self._end
        message = f"planned and verified in {answer.cpu:.2f} s"
        self._status.content = f"{_summary(self.frames, plan.checks)}\n\n{message}"


def _summary(frames: MotionFrames, checks: tuple[Check, ...]) -> str:
    """Return one line of text about a motion: name of the problem, duration, minimum clearance."""
    gap = next((check.worst for check in checks if check.name == "wall clearance"), None)
    units = PageUnits.of_page(frames.problem)
    near = "" if gap is None or not np.isfinite(gap) else f", wall clearance at least {units.length(gap)}"
    return f"**{frames.problem.name}**: {frames.duration:.2f} s{near}"
