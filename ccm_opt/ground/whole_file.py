"""A file written whole or not at all: beside its place first, on the disk, then renamed into it."""

import os
import tempfile
from contextlib import suppress
from pathlib import Path


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


def _umask() -> int:
    """What new files of this process are not allowed."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
