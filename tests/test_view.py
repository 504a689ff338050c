"""The viewer: solids over shapes of the plane, poses at any time, colours, and plans that follow what is dragged."""

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app as command_line
from ccm_opt.cli.drawing import plan_viewer
from ccm_opt.cli.view import settings as colours
from ccm_opt.cli.view.app import LOOPBACK, PatientEvent, ViewerApp, claim_port
from ccm_opt.cli.view.dragging import Replanner
from ccm_opt.cli.view.frames import MotionFrames, extruded
from ccm_opt.cli.view.hand import PATIENCE, Hands
from ccm_opt.cli.view.settings import ViewSettings
from ccm_opt.driver.live_plan import LiveAnswer, LivePlan
from ccm_opt.problem import TipGoal

from .conftest import PROBLEMS
from .test_tools import FILE as FILE_WITH_TOOL
from .test_tours import FREE as TOUR

SWAN = PROBLEMS / "swan-neck.toml"
PORT = 0
"""Any that is free."""


@given(
    corners=st.integers(3, 9),
    seed=st.integers(0, 10**6),
    hole=st.booleans(),
    depth=st.floats(0.1, 3.0),
)
def test_solids_have_the_volume_of_their_shape(corners: int, seed: int, hole: bool, depth: float) -> None:
    """They are closed, and hold the shape's area times their depth."""
    random = np.random.default_rng(seed)
    angles = np.sort(random.uniform(0.0, 2.0 * np.pi, corners)) + np.arange(corners) * 1e-2
    radii = random.uniform(0.7, 1.5, corners)
    shape = shapely.Polygon(np.stack((radii * np.cos(angles), radii * np.sin(angles)), axis=1))
    if not shape.is_valid or shape.area < 0.1:
        return
    if hole:
        shape = shape.difference(shape.buffer(-0.2).buffer(-0.05))
    vertices, faces = extruded(shape, -0.5 * depth, 0.5 * depth)
    mesh = trimesh.Trimesh(vertices, faces)
    mesh.merge_vertices()
    trimesh.repair.fix_normals(mesh)
    assert mesh.is_watertight
    assert abs(mesh.volume) == pytest.approx(shape.area * depth, rel=1e-6)
    assert mesh.area == pytest.approx(2.0 * shape.area + depth * shape.length, rel=1e-6)


@pytest.fixture(scope="module")
def live() -> LivePlan:
    """A plan of the swan's neck that follows."""
    return LivePlan(ccm_opt.load_problem(SWAN))


def frames_of(live: LivePlan) -> MotionFrames:
    """Its motion."""
    return MotionFrames(live.problem, live.plan.trajectory, live.plan.joints)


def test_poses_gaps_and_torques_are_those_of_the_plan(live: LivePlan) -> None:
    """At samples the pose is the plan's; the least gap is the verifier's, the largest torque share the peak's."""
    frames = frames_of(live)
    plan = live.plan
    for k in (0, len(plan.trajectory.time) // 2, -1):
        np.testing.assert_allclose(frames.pose(plan.trajectory.time[k]), plan.joint_positions[k], atol=1e-12)
    least = min(frames.gaps(at).min() for at in np.linspace(0.0, frames.duration, 400))
    assert least == pytest.approx(plan.metrics["least_wall_clearance_m"], abs=2e-4)
    limit = live.problem.limits.torque
    assert limit is not None
    peak = max(frames.torque_shares(at).max() for at in plan.trajectory.time)
    assert peak == pytest.approx((np.abs(plan.joints.torques) / limit).max())
    assert frames.swept().contains(shapely.LineString(plan.joint_positions[0]))


def test_colours_run_from_plenty_to_nothing() -> None:
    """No gap is red, a gap of plenty and more is green, and whoever works at the limit is as one who touches."""
    gaps = np.array([-1.0, 0.0, 0.01, 0.02, 1.0])
    shown = colours.by_gap(gaps, 0.02)
    assert np.array_equal(shown[0], shown[1])
    assert np.array_equal(shown[3], shown[4])
    assert np.array_equal(shown[1], colours.by_use(np.array([1.0]))[0])
    assert shown[1][0] > shown[1][1]
    assert shown[3][1] > shown[3][0]


def test_only_the_last_place_of_a_drag_is_planned(live: LivePlan) -> None:
    """While one change is planned those in between are forgotten, and after some quiet a plan is made anew."""
    begun, free, heard = threading.Event(), threading.Event(), []
    made: list[int] = []

    def change(number: int) -> LiveAnswer:
        made.append(number)
        begun.set()
        free.wait(20.0)
        return LiveAnswer(current=True, reason="", cpu=0.0)

    done = threading.Event()

    def told(answer: LiveAnswer | str) -> None:
        heard.append(answer)
        if len(heard) == 3:
            done.set()

    replanner = Replanner(live, told, ViewSettings(quiet=0.1, anew=2.0))
    replanner.start()
    replanner.ask(lambda: change(1))
    assert begun.wait(20.0)
    for number in (2, 3, 4):
        replanner.ask(lambda number=number: change(number))  # type: ignore[misc]
    free.set()
    assert done.wait(60.0)
    free.clear()
    begun.clear()
    for number in (5, 6):
        replanner.ask(lambda number=number: change(number))  # type: ignore[misc]
        assert begun.wait(20.0)
    resting = threading.Thread(target=replanner.rest)
    resting.start()
    free.set()
    resting.join(20.0)  # what waits is dropped, and the change that is made ends before
    replanner.end()
    assert made == [1, 4, 5]
    assert isinstance(heard[-1], LiveAnswer)


@pytest.fixture
def viewer() -> Iterator[ViewerApp]:
    """The page of the swan's neck."""
    app = plan_viewer(SWAN, PORT)
    stop = threading.Event()
    thread = threading.Thread(target=app.run, args=(stop.is_set,))
    thread.start()
    yield app
    stop.set()
    thread.join(20.0)


def test_the_page_follows_its_plan(viewer: ViewerApp) -> None:
    """It is served to this machine alone; it plays; a goal that moves is planned, one in a wall is explained."""
    assert viewer.address.startswith("http://127.0.0.1:")
    began = viewer.time
    deadline = time.monotonic() + 20.0
    while viewer.time == began and time.monotonic() < deadline:
        time.sleep(0.05)
    assert viewer.time > began
    with viewer._lock:  # it plays on meanwhile
        for layer in ("swept region", "route", "regions", "names"):
            viewer.scene.switch(layer, on=True)
            viewer.scene.switch(layer, on=False)
        for meaning in ("gap", "torque"):
            viewer.scene.colour_by = meaning
            viewer.scene.pose(0.5)
    live = viewer.live
    assert live is not None
    goal = live.problem.goal
    assert isinstance(goal, TipGoal)
    viewer._planned(live, live.move_goal(goal.position + 0.01))
    assert viewer.frames.trajectory is live.plan.trajectory
    assert "planned and verified" in viewer._status.content
    viewer._planned(live, live.move_goal((0.2, 0.3)))
    assert "No plan; the last one is shown" in viewer._status.content
    assert "hanging wall" in viewer._status.content


def test_a_page_hears_of_what_came_while_it_began_to_wait(viewer: ViewerApp) -> None:
    """Whoever waits for messages goes on within a second if the event was set without waking it."""
    event = viewer.server._websock_server._broadcast_buffer.message_event
    assert isinstance(event, PatientEvent)

    async def overheard() -> bool:
        event = PatientEvent()
        waiting = asyncio.create_task(event.wait())
        await asyncio.sleep(0.0)
        event._value = True  # as another thread leaves it that sets it then
        return await asyncio.wait_for(waiting, 1.0)

    assert asyncio.run(overheard())


def test_a_time_chosen_while_it_plays_is_what_the_slider_shows(
    viewer: ViewerApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page is sent the chosen time after the player's last one, and the motion stays there."""
    with viewer._lock:
        slider = viewer._slider
        slider.value = 0.125  # the player's time, which the page has not got yet
        slider._impl.value = 0.5  # as set by a message of the page
        sent: list[Any] = []
        monkeypatch.setattr(slider._impl.gui_api._websock_interface, "queue_message", sent.append)
        viewer._slid(SimpleNamespace(client=object()))
        monkeypatch.undo()
    shown = [message.updates for message in sent if getattr(message, "uuid", "") == slider._impl.uuid]
    assert shown[-1] == {"value": 0.5}
    time.sleep(0.1)
    assert viewer.time == 0.5


@pytest.fixture(scope="module")
def served(live: LivePlan) -> Iterator[ViewerApp]:
    """The page of the swan's neck, which nobody plays."""
    app = ViewerApp(frames_of(live), None, claim_port(PORT))
    yield app
    app.server.stop()


UPGRADE = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
KEY = f"Sec-WebSocket-Key: {'A' * 22}==\r\n"
OWN = "GET /TOKEN HTTP/1.1\r\nHost: HERE\r\n"
FOREIGN = {
    "another origin": f"{OWN}Origin: https://else.example\r\n{UPGRADE}",
    "the origin of a file": f"{OWN}Origin: null\r\n{UPGRADE}",
    "no origin": f"{OWN}{UPGRADE}",
    "an empty origin": f"{OWN}Origin:\r\n{UPGRADE}",
    "another port": f"{OWN}Origin: http://127.0.0.1:1\r\n{UPGRADE}",
    "another scheme": f"{OWN}Origin: https://HERE\r\n{UPGRADE}",
    "two origins": f"{OWN}Origin: http://HERE\r\nOrigin: https://else.example\r\n{UPGRADE}",
    "another spelling of upgrade": f"{OWN}Origin: https://else.example\r\n{UPGRADE.replace('w', 'W', 1)}",
    "an upgrade in a list": f"{OWN}{UPGRADE.replace('websocket', 'h2c, websocket')}",
    "no token": f"GET / HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "another token": f"GET /{'A' * 43} HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "the socket of hands without a token": f"GET /hand HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "the socket of hands of another origin": f"GET /TOKEN/hand HTTP/1.1\r\nHost: HERE\r\n{UPGRADE}",
    "the page of hands": "GET /TOKEN/hand HTTP/1.1\r\nHost: HERE\r\n",
    "more than the token": f"GET /TOKENx HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "the token asked for": f"GET /?TOKEN HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "no text": f"GET /\xe9 HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "a rebound host": f"GET /TOKEN HTTP/1.1\r\nHost: else.example\r\nOrigin: http://else.example\r\n{UPGRADE}",
    "a host that begins so": "GET /TOKEN HTTP/1.1\r\nHost: localhost.else.example\r\n",
    "a host with a user": "GET /TOKEN HTTP/1.1\r\nHost: else.example@HERE\r\n",
    "all addresses": "GET /TOKEN HTTP/1.1\r\nHost: 0.0.0.0\r\n",
    "no host": f"GET /TOKEN HTTP/1.1\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "two hosts": f"{OWN}Host: else.example\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "the page by its file": "GET /index.html HTTP/1.1\r\nHost: HERE\r\n",
    "the page by a script": f"{OWN}Origin: https://else.example\r\n",
    "a form": f"POST /TOKEN HTTP/1.1\r\nHost: HERE\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "an old protocol": f"GET /TOKEN HTTP/1.0\r\nHost: HERE\r\nOrigin: http://HERE\r\n{UPGRADE}",
    "two requests in one": f"GET / HTTP/1.1\r\nHost: HERE\r\nContent-Length: 0\r\n\r\n{OWN}",
}


def _answer(app: ViewerApp, request: str) -> str:
    """Return the first line of the answer to a request; empty where the connection is closed."""
    host, port = LOOPBACK, app.server.get_port()
    text = request.replace("HERE", f"{host}:{port}").replace("TOKEN", app.token)
    with socket.create_connection((host, port), timeout=20.0) as client:
        client.sendall(f"{text}{KEY if 'Upgrade' in text else ''}\r\n".encode("latin-1"))
        with suppress(ConnectionError):
            return client.recv(1000).decode("latin-1").partition("\r\n")[0]
    return ""


@pytest.mark.parametrize("way", FOREIGN)
def test_requests_of_others_are_refused(served: ViewerApp, way: str) -> None:
    """Neither page nor socket is given to another origin, to another host name, or without the token."""
    assert _answer(served, FOREIGN[way]) in ("", "HTTP/1.1 403 Forbidden")


@pytest.mark.parametrize("host", ["HERE", "localhost:9000"])
def test_the_own_page_is_served(served: ViewerApp, host: str) -> None:
    """Page and socket of the address that is told are served, through a forwarded port as well."""
    page = OWN.replace("HERE", host)
    assert _answer(served, page) == "HTTP/1.1 200 OK"
    for way in (page, page.replace("TOKEN", "TOKEN/hand")):
        assert _answer(served, f"{way}Origin: http://{host}\r\n{UPGRADE}") == "HTTP/1.1 101 Switching Protocols"


def test_a_taken_port_is_bad_input() -> None:
    """It is said in a sentence before anything is planned, with what to do."""
    with claim_port(PORT) as door:
        done = CliRunner().invoke(command_line, ["view", str(SWAN), "--port", str(door.getsockname()[1])])
    assert done.exit_code == 2
    assert "--port 0" in done.output


@pytest.mark.drawn(6, of="processes")
@pytest.mark.skipif(os.name == "nt", reason="no such signal")
def test_an_open_page_does_not_hold_the_viewer(tmp_path: Path) -> None:
    """Ctrl-C ends it well before viser has waited for connections that never say anything."""
    command = [sys.executable, "-m", "ccm_opt", "view", str(SWAN), "--no-browser", "--port", "0"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        told = re.search(r"http://([\d.]+):(\d+)/\S+", process.stderr.readline())
        assert told is not None
        with socket.create_connection((told[1], int(told[2]))) as client:
            client.sendall(b"GET /")
            process.send_signal(signal.SIGINT)
            assert process.wait(4.0) == 0


@pytest.mark.drawn(20, of="dear tests")
def test_a_written_plan_is_shown_as_it_was_written(tmp_path: Path) -> None:
    """A folder's own motion plays, whatever a plan made now would be; what is no plan is bad input."""
    run = CliRunner().invoke
    assert run(command_line, ["solve", str(SWAN), "--out", str(tmp_path), "--no-pictures", "-q"]).exit_code == 0
    app = plan_viewer(tmp_path / "swan-neck", PORT)
    app.server.stop()
    with np.load(tmp_path / "swan-neck" / "solution.npz") as arrays:
        np.testing.assert_array_equal(app.frames.trajectory.time, arrays["time"])
    done = run(command_line, ["view", str(tmp_path), "--no-browser"])
    assert (done.exit_code, "solution.json: there is no such file" in done.output) == (2, True)


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("text", [FILE_WITH_TOOL, TOUR], ids=["tool", "tour"])
def test_goals_of_tools_and_tours_have_a_handle(text: str, tmp_path: Path) -> None:
    """An arm with a tool is dragged like any other, and a tour in the order that was found for it."""
    file = tmp_path / "problem.toml"
    file.write_text(text)
    app = plan_viewer(file, PORT)
    live, handles = app.live, app._handles
    try:
        assert live is not None
        assert handles is not None
        for name, number in handles._goals.items():
            handles.attach_handle(name)
            assert live.move_goal(
                live.problem.goals[number - 1].goal.tip(live.problem.arm) + 1e-4, number=number
            ).current
    finally:
        app.server.stop()


@pytest.fixture
def driven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[ViewerApp, Hands]]:
    """The page of the swan's neck, which nobody plays, with the hands at its pages and a camera in front."""
    monkeypatch.chdir(tmp_path)
    live = LivePlan(ccm_opt.load_problem(SWAN))
    app = ViewerApp(frames_of(live), None, claim_port(PORT))
    camera = SimpleNamespace(wxyz=np.array([1.0, -1.0, 0.0, 0.0]) / np.sqrt(2.0))  # right is x, down is −z
    monkeypatch.setattr(app.server, "get_clients", lambda: {0: SimpleNamespace(camera=camera)})
    yield app, app._drive._hands
    app.server.stop()


def _until(done: Callable[[], bool]) -> None:
    """Wait until something is done, at most as long as a slow machine takes."""
    deadline = time.monotonic() + 60.0
    while not done() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert done()


@pytest.mark.drawn(20, of="dear tests")
def test_the_tip_is_driven_braked_and_saved(driven: tuple[ViewerApp, Hands], tmp_path: Path) -> None:
    """A hand moves the tip as the camera sees it; without messages the arm rests; the folder is a plan that passes."""
    app, hands = driven
    controls, numbers = app._drive, app._readings._table.content
    controls._switched(on=True)
    driver = controls._driver
    assert driver is not None
    assert hands.hear(1, '{"hand": [0, 0, 0], "turns": false}') == "driving"
    begun = driver.servo.problem.arm.joint_positions_at(app.frames.configuration(0.0))[-1]
    _until(lambda: bool(hands.hear(1, '{"hand": [-1, 0.5, 0], "turns": false}')) and driver.servo.ticks > 20)
    _until(lambda: not driver.servo.moving)  # no message any more
    assert app._readings._table.content != numbers  # those of now
    ticks = driver.servo.ticks
    controls.end()
    _until(lambda: not controls.driving and not controls._save.disabled)
    motion = app.frames.trajectory
    # Two spans of the spline lead up to the last control point.
    assert motion.duration == pytest.approx((ticks + 2) * driver.servo.period)
    moved = driver.servo.problem.arm.joint_positions_at(motion.positions[-1])[-1] - begun
    assert moved[0] < 0.0
    start = app.frames.problem.start.configuration(app.frames.problem.arm)
    np.testing.assert_allclose(motion.positions[0], start, atol=1e-12)
    controls._saved()
    assert "saved" in controls._words.content
    assert CliRunner().invoke(command_line, ["check", str(tmp_path / "runs/swan-neck-driven")]).exit_code == 0


@given(
    st.one_of(
        st.text(max_size=300),
        st.binary(max_size=50),
        st.fixed_dictionaries(
            {"hand": st.lists(st.floats(), max_size=4) | st.text(), "turns": st.booleans() | st.none()}
        ).map(json.dumps),
    )
)
def test_messages_of_pages_ask_for_at_most_the_greatest_speed(text: str | bytes) -> None:
    """Whatever a page sends is a hand of at most full speed, or refused; what is old asks for nothing."""
    now = [0.0]
    hands = Hands(lambda: now[0])
    try:
        hands.hear(1, text)
    except ValueError:
        assert hands.asked() is None
        return
    asked = hands.asked()
    assert asked is not None
    assert np.linalg.norm(asked.hand) <= 1.0 + 1e-12
    now[0] = PATIENCE + 0.01
    assert hands.asked() is None
