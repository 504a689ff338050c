"""Output folders that somebody else has made: read or refused with a line, at once, and never with a traceback."""

import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ccm_opt.cli.outcome import BAD_INPUT, NO_PLAN
from ccm_opt.cli.written_plans import check_folders
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import read_plain
from ccm_opt.io.reading_back import read_archive
from ccm_opt.io.record_reading import recorded_nearest

from .corruption.plans import Folder, write_plans


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """A plan as it was written."""
    return write_plans(tmp_path_factory.mktemp("plans"), ("smooth",))["smooth"]


@pytest.fixture
def place(written: Folder, tmp_path: Path) -> Path:
    """Its folder, to be changed."""
    written.write(tmp_path / "plan")
    return tmp_path / "plan"


def judged(place: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code of a check, and what it says."""
    code = check_folders([place])
    said = capsys.readouterr()
    return code, said.out + said.err


def head(text: str) -> bytes:
    """An array of a file whose description is this text."""
    raw = text.encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(raw)) + raw


HEADS = {
    "brackets": head("(" * 3000),
    "signs": head("{'descr': '<f8', 'fortran_order': False, 'shape': (" + "-" * 9000 + "1,)}"),
    "text that does not end": head("{'descr': '''<f8', "),
    "keys of two types": head("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), b'x': 1}"),
    "a key that is a list": head("{[]: 1}"),
    "more than there is": head("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}"),
    "whole numbers of an older Python": head("{'descr': '<f8', 'fortran_order': False, 'shape': (2L,)}") + bytes(16),
    "no array": b"hello",
    "nothing": b"",
}
"""Of the array of the times."""


@pytest.mark.parametrize("name", HEADS)
def test_arrays_that_are_none_are_refused(place: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """Whatever an array's description says, it is refused in a line."""
    archive = place / "solution.npz"
    with zipfile.ZipFile(archive) as packed:
        content = {member: packed.read(member) for member in packed.namelist()}
    with zipfile.ZipFile(archive, "w") as packed:
        for member, bytes_of_it in (content | {"time.npy": HEADS[name]}).items():
            packed.writestr(member, bytes_of_it)
    code, said = judged(place, capsys)
    assert code == BAD_INPUT
    assert "not readable as arrays" in said


def _set(content: bytearray, local: int, central: int, value: bytes) -> None:
    """Set a field of all members, by its place in the heads before them and in the list at the end."""
    for mark, offset in ((b"PK\x03\x04", local), (b"PK\x01\x02", central)):
        at = content.find(mark)
        while at >= 0:
            content[at + offset : at + offset + len(value)] = value
            at = content.find(mark, at + 4)


ARCHIVES: dict[str, Callable[[bytearray], None]] = {
    "encrypted": lambda content: _set(content, 6, 8, b"\x01"),
    "patched": lambda content: _set(content, 6, 8, b"\x20"),
    **{f"method {k}": lambda content, k=k: _set(content, 8, 10, bytes([k, 0])) for k in (1, 9, 12, 14, 93, 99)},  # type: ignore[misc]
    "another version": lambda content: _set(content, 4, 6, b"\xfa\x00"),
}


@pytest.mark.parametrize("name", ARCHIVES)
def test_archives_of_other_kinds_are_refused(place: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """So are archives that are encrypted, or packed as numpy packs none."""
    content = bytearray((place / "solution.npz").read_bytes())
    ARCHIVES[name](content)
    (place / "solution.npz").write_bytes(content)
    code, said = judged(place, capsys)
    assert code == BAD_INPUT
    assert "solution.npz: " in said


def test_bytes_that_are_changed_at_random_are_read_or_refused(place: Path, written: Folder) -> None:
    """Most of what is told about members and arrays stands in a few bytes, which are drawn from."""
    path = place / "solution.npz"
    content = path.read_bytes()
    marks = (b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06", b"\x93NUMPY")
    heads = [k for k in range(len(content)) if content.startswith(marks, k)]
    rng = np.random.default_rng()
    for _ in range(300):
        changed = bytearray(content)
        for at in rng.choice(heads, 2) + rng.integers(130, size=2):
            changed[min(at, len(changed) - 1)] = rng.integers(256)
        path.write_bytes(changed)
        try:
            read_archive(path, written.arrays)
        except ProblemError as error:
            assert str(path) in str(error)  # noqa: PT017 - most are refused, but not all of them


@pytest.mark.parametrize(("name", "expected"), [("solution.json", BAD_INPUT), ("solution.npz", BAD_INPUT)])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "huge"])
def test_what_is_no_file_is_not_read(
    place: Path, capsys: pytest.CaptureFixture[str], name: str, expected: int, kind: str
) -> None:
    """A pipe would be waited for, and a device fill the memory, for ever."""
    _put(place / name, kind)
    code, said = judged(place, capsys)
    assert code == expected
    assert name in said


@pytest.mark.drawn(6)
@pytest.mark.parametrize("name", ["trajectory.csv", "trajectory.yaml", "arm.urdf", "arm.mjcf.xml"])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "huge"])
def test_nor_are_texts(place: Path, capsys: pytest.CaptureFixture[str], name: str, kind: str) -> None:
    """They fail their checks."""
    _put(place / name, kind)
    code, said = judged(place, capsys)
    assert code == NO_PLAN
    assert "Traceback" not in said


def _put(path: Path, kind: str) -> None:
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "folder":
        path.mkdir()
    else:
        with path.open("wb") as file:
            file.truncate(2**31)


def test_files_that_say_that_they_are_empty_are_bounded_too(tmp_path: Path) -> None:
    """As those of the system do."""
    told = Path("/proc/self/maps")
    if not told.exists():
        pytest.skip("this system has no such files")
    with pytest.raises(OSError, match="more than 10 bytes"):
        read_plain(told, 10)
    (tmp_path / "ten").write_bytes(b"0123456789")
    assert read_plain(tmp_path / "ten", 10) == b"0123456789"
    with pytest.raises(OSError, match="it has 10 bytes; at most 9"):
        read_plain(tmp_path / "ten", 9)


RECORDS = {
    "a figure of many digits": ('"duration_s": ', f'"duration_s": 1{"0" * 400}, "x": '),
    "a figure without end": ('"duration_s": ', '"duration_s": 1e999, "x": '),
    "a check of many digits": ('"limit": ', f'"limit": 1{"0" * 400}, "x": '),
    "no number": ('"duration_s": ', '"duration_s": NaN, "x": '),
    "a key twice": ('"status": ', '"status": "solved", "status": '),
    "true for one": ('"schema": 1,', '"schema": true,'),
    "one and nothing": ('"schema": 1,', '"schema": 1.0,'),
}


@pytest.mark.parametrize("name", RECORDS)
def test_records_that_others_would_read_otherwise_are_refused(
    place: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """A record is strict JSON, each of its numbers finite and each of its keys there once."""
    path = place / "solution.json"
    text = path.read_text(encoding="utf-8")
    found, put = RECORDS[name]
    assert found in text
    path.write_text(text.replace(found, put, 1), encoding="utf-8")
    code, said = judged(place, capsys)
    assert code == BAD_INPUT
    assert "solution.json: " in said


@pytest.mark.parametrize("near", ['{"link": 1}', '{"link": "one", "gap": 0, "wanted": 0, "time": 0}'])
def test_a_least_gap_that_is_none_is_refused(place: Path, near: str) -> None:
    """Where pictures ask for it."""
    (place / "solution.json").write_text(f'{{"room": {{"nearest": {near}}}}}', encoding="utf-8")
    with pytest.raises(ProblemError, match="the least gap in it is not readable"):
        recorded_nearest(place)


def test_a_motion_without_keyframes_is_refused(
    place: Path, written: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every motion passes one at least."""
    arrays = written.arrays | {"keyframes": written.arrays["keyframes"][:0]}
    np.savez(place / "solution.npz", **arrays)  # type: ignore[arg-type]
    code, said = judged(place, capsys)
    assert code == BAD_INPUT
    assert "at least one keyframe" in said


def _second(line: str) -> Callable[[str], str]:
    return lambda text: f"{text}{line}\n"


MESSAGES: dict[str, Callable[[str], str]] = {
    "points once more": _second("points: [{time_from_start: {sec: 0, nanosec: 0}, positions: [9]}]"),
    "points once more in quotes": _second('"points": []'),
    "another key": _second("header: {frame_id: map}"),
    "a second document": _second("---\njoint_names: [a]"),
    "all of it in a text": lambda text: "note: |\n" + "".join(f"  {k}\n" for k in text.splitlines()) + '"points": []\n',
    "a list once more in quotes": lambda text: text.replace("  velocities", '  "positions": [9]\n  velocities', 1),
    "points by another name": lambda text: text.replace("\npoints:", "\npoint:"),
    "a time that belongs to the point before": lambda text: text.replace(
        "- time_from_start", "  time_from_start"
    ).replace("  positions", "- positions"),
    "lists outside of points": lambda text: text.replace("  positions", "positions"),
    "a tag": lambda text: f"!!python/name:os.system\n{text}",
}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_that_others_would_read_otherwise_is_refused(
    place: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """Whoever loads a message with a parser of YAML gets what was checked."""
    path = place / "trajectory.yaml"
    path.write_text(MESSAGES[name](path.read_text(encoding="utf-8")), encoding="utf-8")
    code, said = judged(place, capsys)
    assert code == NO_PLAN
    assert "ROS message against arrays" in said


MODELS: dict[str, Callable[[str], str]] = {
    "text behind an element": lambda text: text.replace("</link>", "</link>0.1", 1),
    "an instruction": lambda text: text.replace("</link>", "</link><?include x?>", 1),
    "other letters": lambda text: f'<?xml version="1.0" encoding="utf-7"?>\n{text.removeprefix(PROLOGUE)}',
    "a number of Python": lambda text: text.replace('value="0.1"', 'value="0.1_0"', 1),
}
PROLOGUE = '<?xml version="1.0"?>\n'


@pytest.mark.parametrize("name", MODELS)
def test_so_is_a_description_of_the_arm(place: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    """Whatever stands between elements, and how letters are written, is held as elements are."""
    path = place / "arm.urdf"
    text = path.read_text(encoding="utf-8")
    changed = MODELS[name](text)
    assert changed != text
    path.write_text(changed, encoding="utf-8")
    code, said = judged(place, capsys)
    assert code == NO_PLAN
    assert "URDF against problem" in said
