"""Server process with the package loaded, which forks for every command that it receives from a client.

Loading takes 1.5 s, most commands take less. Each command runs by the ``main`` of ``ccm-opt`` in its own process, with
the client's standard streams, folder and environment.
"""

import argparse
import array
import gc
import json
import multiprocessing.process
import os
import resource
import runpy
import signal
import socket
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

LOADED = (
    "ccm_opt.cli.solving",
    "ccm_opt.cli.written_plans",
    "ccm_opt.cli.comparing",
    "ccm_opt.cli.drawing",
    "ccm_opt.cli.examining",
    "ccm_opt.diagnosis.explain",
    "ccm_opt.viz.plan",
    "ccm_opt.planning.planner",
    "ccm_opt.planning.baseline.schemas",
    "casadi",
    "matplotlib.figure",
    "matplotlib.backends.backend_agg",
    "scipy.interpolate",
    "scipy.spatial",
)
"""Modules that commands import; none of them starts a thread."""
READ_ONLY_VARIABLE = "ONLY_READ"
"""Environment variable that is set if a script or command should only parse its options and stop."""
LONGEST = 100
"""CPU time after which a command is ended [s], since its client may no longer exist."""


class Order:
    """A command received from a client, and the socket for the answer."""

    def __init__(self, client: socket.socket) -> None:
        self.client = client
        room = socket.CMSG_SPACE(3 * array.array("i").itemsize)
        message, ancillary, _, _ = client.recvmsg(1 << 20, room)
        descriptors = array.array("i")
        for _, _, data in ancillary:
            descriptors.frombytes(data)
        self.descriptors = list(descriptors)
        order = json.loads(message)
        self.words: list[str] = order["words"]
        self.folder: str = order["folder"]
        self.environment: dict[str, str] = order["environment"]

    def take_over(self) -> None:
        """Replace standard streams, folder and environment of this process by those of the client."""
        for number, descriptor in enumerate(self.descriptors):
            os.dup2(descriptor, number)
            os.close(descriptor)
        self.client.close()
        os.chdir(self.folder)
        # Child processes look here for the main file, if its path is relative.
        multiprocessing.process.ORIGINAL_DIR = self.folder  # type: ignore[attr-defined]
        os.environ.clear()
        os.environ.update(self.environment)
        sys.path[:0] = [entry for entry in self.environment.get("PYTHONPATH", "").split(os.pathsep) if entry]


def serve(address: str) -> Order:
    """Wait for commands, and return each of them in a new process that has to run it.

    Args:
        address: path of the server's socket.
    """
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(address)
    listener.listen()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    while True:
        client, _ = listener.accept()
        if os.fork() == 0:
            break
        client.close()
    listener.close()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    order = Order(client)
    worker = os.fork()
    if worker:
        client.sendall(f"{worker}\n".encode())
        _, status = os.waitpid(worker, 0)
        client.sendall(f"{os.waitstatus_to_exitcode(status)}\n".encode())
        os._exit(0)
    resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST))
    order.take_over()
    return order


def run(words: Sequence[str]) -> None:
    """Run a command that begins with ``ccm-opt`` or ``python``, given as a list of words."""
    program, *arguments = words
    only_read = bool(os.environ.get(READ_ONLY_VARIABLE))
    if only_read:
        stop_when_read()
    if program == "ccm-opt" and only_read:
        commands = import_module("ccm_opt.cli.commands")
        group = import_module("typer").main.get_command(commands.app)
        group.commands[arguments[0]].make_context(arguments[0], arguments[1:])
    elif program == "ccm-opt":
        sys.argv = ["ccm-opt", *arguments]
        import_module("ccm_opt.cli").main()
    elif arguments[:1] == ["-m"]:
        sys.argv = arguments[1:]
        sys.path.insert(0, str(Path.cwd()))
        runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
    else:
        sys.argv = arguments
        sys.path.insert(0, str(Path(arguments[0]).resolve().parent))
        runpy.run_path(arguments[0], run_name="__main__")


def stop_when_read() -> None:
    """Change ``argparse`` such that scripts exit once their options are parsed; with code 2 if an option is wrong."""
    read = argparse.ArgumentParser.parse_args

    def parse_args(parser: argparse.ArgumentParser, *given: Any, **named: Any) -> None:
        read(parser, *given, **named)
        raise SystemExit(0)

    argparse.ArgumentParser.parse_args = parse_args  # type: ignore[assignment, method-assign]


def exit_code_of(words: Sequence[str]) -> int:
    """Run a command, and return its exit code."""
    try:
        run(words)
    except SystemExit as end:
        if isinstance(end.code, str):
            sys.stderr.write(f"{end.code}\n")
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # noqa: BLE001 - whatever it is, it is shown as Python shows it
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    for name in LOADED:
        import_module(name)
    # The loaded modules are shared by all commands: collecting garbage among their objects, or deleting them at exit,
    # would take longer than most commands.
    gc.freeze()
    code = exit_code_of(serve(sys.argv[1]).words)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
