"""Web server and controls of the viewer."""

import asyncio
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
from contextlib import redirect_stdout, suppress
from functools import partial
from math import floor
from pathlib import Path
from typing import Any, Literal
from unittest import mock

import numpy as np
import viser
import websockets.asyncio.server
from websockets import Headers
from websockets.http11 import Request, Response

from ccm_opt.cli.view.dragging import Handles
from ccm_opt.cli.view.driving import DriveControls
from ccm_opt.cli.view.frames import MotionFrames
from ccm_opt.cli.view.hand import PATH as HAND
from ccm_opt.cli.view.hand import Hands
from ccm_opt.cli.view.readings import Readings
from ccm_opt.cli.view.scene import Scene
from ccm_opt.cli.view.settings import VIEW
from ccm_opt.core.arrays import TINY, FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import Check, Solution
from ccm_opt.viz.document import PageUnits

_FRAME_RATE = 30.0
"""Rate at which poses are sent to the browser during playback [1/s]."""
_LEAST_PAUSE = 0.001
"""Pause between poses that take longer to send than their rate allows, in which others get the lock [s]."""
_LONGEST_WAIT = 0.5
"""Time after which the sender of messages to the pages looks again whether there are any [s]."""
_SLIDER_RATE = 10.0
"""Rate at which the time slider and the numbers are updated during playback [1/s]."""

LOOPBACK = "127.0.0.1"
"""Address on which the page is served: to this machine only, since anyone who loads the page can start planning."""
HOST = re.compile(r"(127\.0\.0\.1|localhost)(:\d{1,5})?", re.ASCII)
"""Pattern of the host names with which a browser on this machine requests the page; others suggest an attack by DNS
rebinding."""
PATIENCE = 0.2
"""Maximum time to wait for connected pages when the viewer ends, so that Ctrl-C ends it within a second [s]."""
SCRIPTS = tuple(Path(__file__).with_name(name) for name in ("hand.js", "coarse.js"))
"""The scripts that the page runs beside viser's."""
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
    path = request.path.partition("?")[0].removesuffix(HAND if "Upgrade" in request.headers else "/").strip("/")
    return None if secrets.compare_digest(path.encode(errors="replace"), token.encode()) else "no such page"


def _serve_guarded(
    serve: Callable[..., Any],
    door: socket.socket,
    token: str,
    hands: Hands,
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
        hands: receiver of what the hands at the pages ask for.
        handler: handler of WebSocket connections.
        process_request: viser's handler of web requests, called for those not refused.
        options: further options of the original function.
    """

    def answer(connection: Any, request: Request) -> Response | None:
        reason = refusal(request, token)
        if reason is not None:
            return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", Headers(), f"{reason}\n".encode())
        plain = [(name, value) for name, value in request.headers.raw_items() if name.lower() != "accept-encoding"]
        response = process_request(connection, dataclasses.replace(request, path="/", headers=Headers(plain)))
        if response is not None:
            response.headers["Referrer-Policy"] = "no-referrer"  # links on the page must not reveal the token
            head, body, rest = response.body.rpartition(b"</body>")
            response.body = head + b"<script>" + b"".join(map(Path.read_bytes, SCRIPTS)) + b"</script>" + body + rest
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
        return response

    async def handled(connection: Any) -> None:
        of_hand = connection.request.path.partition("?")[0].endswith(HAND)
        await (hands.serve(connection) if of_hand else handler(connection))

    # Malformed requests are refused too, and need no message on the terminal.
    logging.getLogger("websockets.server").addFilter(lambda record: "opening handshake" not in record.msg)
    return serve(handled, sock=door, process_request=answer, **options)


class PatientEvent(asyncio.Event):
    """Event whose waiters look at it twice a second, so that none waits for ever although it is set.

    viser sets an event of its event loop from other threads. One that is set just while a task begins to wait does not
    wake this task, and neither does any setting after that: the pages would stand still.
    """

    async def wait(self) -> Literal[True]:
        """Wait until the event is set."""
        while not self.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(_LONGEST_WAIT):
                    await super().wait()
        return True


class ViewerApp:
    """Web application that shows a motion in the browser.

    Args:
        frames: the motion shown first.
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
        hands = Hands()
        serve = partial(_serve_guarded, websockets.asyncio.server.serve, door, self.token, hands)
        with mock.patch.object(websockets.asyncio.server, "serve", serve), redirect_stdout(io.StringIO()):
            port = door.getsockname()[1]
            self.server = viser.ViserServer(host=LOOPBACK, port=port, label="ccm-opt view", verbose=False)
        if self.server.get_port() != port:  # viser did not use the given server, so the page is not guarded
            self.server.stop()
            raise ProblemError(
                "this version of viser does not let the viewer protect its page; install a newer one: pip "
                "install -U viser"
            )
        messages = getattr(getattr(self.server, "_websock_server", None), "_broadcast_buffer", None)
        if messages is not None and hasattr(messages, "message_event"):
            messages.message_event = PatientEvent()
        self.scene = Scene(self.server, frames)
        self.scene.draw()
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)
        self.server.gui.main_panel.dock_right()
        self.server.on_client_connect(self._connected)
        self._summary = _summary(frames, checks)
        self._status = self.server.gui.add_markdown(self._summary)
        self._build_player()
        self._handles = None if live is None else Handles(self.scene, live, self._planned, self._planning)
        self._drive = DriveControls(self.scene, hands, self._driving, self._moved, self._driven)
        self._readings = Readings(self.server, frames)
        self._build_layers()

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
                time.sleep(max(last + 1.0 / _FRAME_RATE - time.monotonic(), _LEAST_PAUSE))
                now = time.monotonic()
                with self._lock:
                    if self._play.value:
                        self._advance(now - last)
                        if now - slid >= 1.0 / _SLIDER_RATE:
                            slid = now
                            self._slider.value = round(min(self.time, self._end), 3)
                            self._readings.show(min(self.time, self.frames.duration))
                last = now
        finally:
            self._drive.end()
            if self._handles is not None:
                self._handles.end()
            # viser waits five seconds for a page that does not answer.
            stopping = threading.Thread(target=self.server.stop, daemon=True)
            stopping.start()
            stopping.join(PATIENCE)

    def _connected(self, client: viser.ClientHandle) -> None:
        """Show a browser that connects the scene, and arrange the names whenever its camera moves."""
        self.scene.look(client)
        client.camera.on_update(self.scene.arrange_names)

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
                chosen = self.time = float(self._slider.value)
                if self._play.value:
                    self._play.value = False
                    # The player's last time may reach the page after this one was chosen there, so it is sent again;
                    # viser sends changes only.
                    self._slider.value = 0.0 if chosen else self._end
                    self._slider.value = chosen
                self._pose()
                self._readings.show(self.time)

    def _build_layers(self) -> None:
        gui = self.server.gui
        with gui.add_folder("Layers"):
            colour = gui.add_dropdown("link colour", ("nothing", "gap", "torque"), initial_value="nothing")
            boxes = {
                layer: gui.add_checkbox(layer, initial_value=layer in self.scene.shown) for layer in self.scene.layers
            }

            if self.frames.problem.dimension == 3:
                opacity = gui.add_slider("opacity of obstacles", 0.05, 1.0, 0.05, self.scene.opacity)
                axis = gui.add_dropdown("cut across", ("nothing", "x", "y", "z"), initial_value="nothing")
                share = gui.add_slider("cut at", 0.0, 1.0, 0.01, 0.5)
                opacity.on_update(self._shaded)
                for control in (axis, share):
                    control.on_update(lambda _: self._cut(axis.value, share.value))
        colour.on_update(self._coloured)
        for layer, box in boxes.items():
            box.on_update(partial(self._switched, layer))

    def _coloured(self, event: Any) -> None:
        with self._lock:
            self.scene.colour_by = event.target.value
            self._pose()

    def _shaded(self, event: Any) -> None:
        with self._lock:
            self.scene.shade(event.target.value)

    def _cut(self, axis: str, share: float) -> None:
        with self._lock:
            self.scene.cut_across(None if axis == "nothing" else "xyz".index(axis), share)

    def _switched(self, layer: str, event: Any) -> None:
        with self._lock:
            self.scene.switch(layer, on=event.target.value)

    def _driving(self) -> Problem:
        """Stop playing and planning, and return the problem that begins in the pose shown."""
        if self._handles is not None:
            self._handles.hide()  # planning would take time from the ticks, and needs the lock to end
        with self._lock:
            self._play.value = False
            problem = self.frames.problem if self.live is None else self.live.problem
            pose = self.frames.configuration(min(self.time, self.frames.duration))
            start = JointPose.from_configuration(pose, problem.arm.coordinates)
            if problem.workspace is not self.frames.problem.workspace:
                self.frames = self.scene.frames = dataclasses.replace(self.frames, problem=problem)
            return dataclasses.replace(problem, start=start)

    def _moved(self, configuration: FloatArray) -> None:
        """Show the numbers of the pose to which the arm is driven."""
        self._readings.show_driven(self.frames, configuration)

    def _driven(self, driven: Solution | None) -> None:
        """Show a driven motion; the one before stays if there is none."""
        if self._handles is not None:
            self._handles.show()
        if driven is None:
            with self._lock:
                self._pose()
            return
        self._show(driven, driven.trajectory.duration)
        self._summary = _summary(self.frames, driven.checks)
        self._status.content = f"{self._summary}\n\ndriven by hand"

    def _show(self, plan: Solution, time: float) -> None:
        """Show another motion, at a time [s]."""
        with self._lock:
            self.frames = MotionFrames(plan.problem, plan.trajectory, plan.joints)
            self.scene.frames = self.frames
            self.scene.draw_motion()
            self.time = time
            self._pose()
            self._slider.max = self._end
            self._slider.value = round(min(self.time, self._end), 3)
            self._readings.load(self.frames, min(self.time, self.frames.duration))

    def _planning(self) -> None:
        """Say that a plan is being made; the last one stays until then."""
        self._status.content = f"{self._summary}\n\n*planning …*"

    def _planned(self, live: LivePlan, answer: LiveAnswer | str) -> None:
        """Show the result of a change: the new plan, or the last plan with the reason why no new one was found."""
        if self._drive.driving:
            return
        with self._lock:
            self.scene.draw_bounds(live.problem)
            if isinstance(answer, str):
                self._status.content = f"**Not planned.** {answer}"
                return
            if not answer.current:
                reason, _, _ = answer.reason.partition("; ")  # what else was tried would fill the panel
                self._status.content = f"**No plan; the last one is shown.** {reason}"
                return
            plan = live.plan
            self._show(plan, self.time / max(self.frames.duration, TINY) * plan.trajectory.duration)
        self._summary = _summary(self.frames, plan.checks)
        route = "" if answer.same_route else "; **made from scratch: the route may have changed**"
        self._status.content = f"{self._summary}\n\nplanned and verified in {answer.cpu:.2f} s{route}"


def _summary(frames: MotionFrames, checks: tuple[Check, ...]) -> str:
    """Return one line of text about a motion: name of the problem, duration, minimum clearance."""
    gap = next((check.worst for check in checks if check.name == "wall clearance"), None)
    units = PageUnits.of_page(frames.problem)
    near = "" if gap is None or not np.isfinite(gap) else f", wall clearance {units.length(gap)}"
    return f"**{frames.problem.name}**: {frames.duration:.2f} s{near}"
