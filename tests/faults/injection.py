"""Make the k-th operation of a kind fail: writes, renames, removals, folders, programs, libraries, solvers.

Operations of the file system, of processes and of libraries are met where Python itself announces them to an audit
hook, whoever calls them, so that none is forgotten; solvers are met at their calls. A hook cannot be taken out again:
this belongs into a process of its own.
"""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import daqp

NO_SPACE = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
REFUSED = PermissionError(errno.EACCES, os.strerror(errno.EACCES))
EVENTS = {
    "os.rename": "rename",
    "os.remove": "remove",
    "os.rmdir": "remove",
    "os.mkdir": "make a folder",
    "os.chmod": "change rights",
    "subprocess.Popen": "start a program",
    "ctypes.dlopen": "load a library",
}
"""Kinds of operations by audit event; ``open`` counts only for writing."""


@dataclass
class Faults:
    """Counter of operations that makes one of them fail.

    Attributes:
        fail_at: number of the operation that fails, from 1; None: none.
        kinds: kinds of all operations so far, in order.
        failed: description of the failed operation.
    """

    fail_at: int | None = None
    kinds: list[str] = field(default_factory=list)
    failed: str | None = None

    def met(self, kind: str, what: object, error: Exception) -> None:
        """Count one operation, and raise the given error if this is the operation that has to fail."""
        self.kinds.append(kind)
        if len(self.kinds) == self.fail_at:
            self.failed = f"{kind}: {what}"
            raise error


_armed: list[Faults] = []


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if not _armed:
        return
    if event in EVENTS:
        _armed[-1].met(EVENTS[event], arguments[0], REFUSED)
    elif event == "open" and _is_for_writing(arguments):
        _armed[-1].met("write", arguments[0], NO_SPACE)


def _is_for_writing(arguments: tuple[Any, ...]) -> bool:
    path, mode, flags = arguments
    if not isinstance(path, (str, bytes, os.PathLike)) or os.fspath(path) in {os.devnull, os.devnull.encode()}:
        return False
    if isinstance(mode, str):
        return any(letter in mode for letter in "wax+")
    return bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


@contextmanager
def injected(fail_at: int | None) -> Iterator[Faults]:
    """Count the operations in a ``with`` block, and let the operation of a given number fail."""
    faults = Faults(fail_at)
    _armed.append(faults)
    try:
        yield faults
    finally:
        _armed.remove(faults)


def install() -> None:
    """Install the hooks that count operations; call once per process, before the planner is imported."""
    sys.addaudithook(_hook)
    sys.dont_write_bytecode = True
    solve = daqp.solve

    def daqp_met(*arguments: Any, **options: Any) -> Any:
        _solver("daqp")
        return solve(*arguments, **options)

    call = ca.Function.__call__

    def casadi_met(function: Any, *arguments: Any, **options: Any) -> Any:
        if function.is_a("IpoptInterface"):
            _solver("ipopt")
        return call(function, *arguments, **options)

    daqp.solve = daqp_met
    ca.Function.__call__ = casadi_met


def _solver(name: str) -> None:
    if _armed:
        _armed[-1].met("solver", name, RuntimeError(f"{name} failed"))
