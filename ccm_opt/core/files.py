"""Files that are read whole and written whole, and the strict JSON text of records."""

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
"""Opening a pipe that nobody writes to would else wait for ever."""


def read_plain(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file.

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


def put_file(place: Path, content: bytes) -> None:
    """Write a file such that whoever reads it finds the old content or the new one, whole, also after a failure.

    Args:
        place: of the file; what is no file, such as a pipe or ``/dev/null``, is written to as it is.
        content: of the file.

    Raises:
        OSError: it cannot be written; then it is as it was.
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
    """Write a file as ``put_file`` does, in a folder that is made where there is none.

    Raises:
        ProblemError: it cannot be written; ``advice`` says what to do then.
    """
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        put_file(place, content)
    except OSError as error:
        then = f"; {advice}" if advice else ""
        raise ProblemError(f"cannot write {place}: {error.strerror or error}{then}") from error


def _umask() -> int:
    """Return what new files of this process are not allowed."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def strict_text(record: Mapping[str, object]) -> str:
    """Return the text of a record, numpy's numbers and arrays among its values; ends with a line break."""
    return json.dumps(_strict(record), indent=2, ensure_ascii=False, allow_nan=False, default=_plain) + "\n"


def _strict(value: object) -> object:
    """Return the same value with null for every number that is not finite."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_strict(item) for item in value]
    return value


def _plain(value: object) -> object:
    """Return the numpy scalars and arrays, and mappings that are not dictionaries, as JSON knows them."""
    convert = getattr(value, "tolist", None)
    return _strict(convert()) if convert is not None else str(value)
