"""Reads files that somebody else may have put there: regular ones alone, and none of more bytes than are expected."""

import os
import stat
from pathlib import Path

_AT_ONCE = getattr(os, "O_NONBLOCK", 0)
"""Opening a pipe that nobody writes to would else wait for ever."""


def read_plain(path: Path, most_bytes: int) -> bytes:
    """The content of a regular file.

    Args:
        path: of the file, or of a link to one.
        most_bytes: files of more are refused unread.

    Raises:
        OSError: it cannot be read, is no regular file, or is larger.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0) | _AT_ONCE)
    try:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise OSError("it is no regular file")
        if about.st_size > most_bytes:
            raise OSError(f"it has {about.st_size} bytes, at most {most_bytes} are read")
        with os.fdopen(handle, "rb", closefd=False) as file:
            content = file.read(most_bytes + 1)  # some files of the system say that they have none
    finally:
        os.close(handle)
    if len(content) > most_bytes:
        raise OSError(f"it has more than {most_bytes} bytes")
    return content
