"""Reading and atomic writing of whole files, and conversion of records to strict JSON."""

import json
import math
import os
import stat
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from ccm_opt.core.errors import ProblemError

_AT_ONCE = getattr(os, "O_NONBLOCK", 0)
"""Flag without which opening a pipe that has no writer would block forever."""


def read_plain(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file.

    Args:
        path: path of the file, or of a link to one.
        most_bytes: largest size; larger files are rejected without reading.

    Raises:
        OSError: the file cannot be read, is not a regular file, or is too large.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0) | _AT_ONCE)
    try:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise OSError("it is not a regular file")
        if about.st_size > most_bytes:
            raise OSError(f"it has {about.st_size} bytes; at most {most_bytes} are read")
        with os.fdopen(handle, "rb", closefd=False) as file:
            content = file.read(most_bytes + 1)  # some system files report a size of 0
    finally:
        os.close(handle)
    if len(content) > most_bytes:
        raise OSError(f"it has more than {most_bytes} bytes")
    return content


def put_file(place: Path, content: bytes) -> None:
    """Write a file atomically: readers find the complete old or new content, even after a failure.

    Args:
        place: path of the file; anything else, such as a pipe or ``/dev/null``, is written to directly.
        content: new content.

    Raises:
        OSError: the file cannot be written; the old file is then unchanged.
    """
    true_place = place.resolve()
    if true_place.exists() and not true_place.is_file():
        true_place.write_bytes(content)
        return
    handle, name = tempfile.mkstemp(prefix=f".{true_place.name}.", dir=true_place.parent)
    beside = Path(name)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.chmod(true_place.stat().st_mode if true_place.exists() else 0o666 & ~_umask())
        beside.replace(true_place)
    except BaseException:
        with suppress(OSError):
            beside.unlink()
        raise


def put_file_or_refuse(place: Path, content: bytes, advice: str = "") -> None:
    """Write a file atomically, as ``put_file`` does, and create its folder if needed.

    Raises:
        ProblemError: the file cannot be written; the message ends with ``advice``.
    """
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        put_file(place, content)
    except OSError as error:
        then = f"; {advice}" if advice else ""
        raise ProblemError(f"cannot write {place}: {error.strerror or error}{then}") from error


def _umask() -> int:
    """Return the umask of this process, the permissions withheld from new files."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def strict_text(record: Mapping[str, object]) -> str:
    """Convert a record, which may contain NumPy values, to strict JSON text with a final line break.

    Numbers that are not finite become null.
    """
    return json.dumps(_strict(record), indent=2, ensure_ascii=False, allow_nan=False, default=_plain) + "\n"


def _strict(value: object) -> object:
    """Return a value with every number that is not finite replaced by None."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_strict(item) for item in value]
    return value


def _plain(value: object) -> object:
    """Convert a NumPy scalar or array to numbers and lists, and any other object to text, for the JSON encoder."""
    convert = getattr(value, "tolist", None)
    return _strict(convert()) if convert is not None else str(value)
