"""Draw the pictures of the gallery and of the page on the paper: run the command below each, and keep what it draws.

Run it from the project's folder; it takes some minutes::

    python docs/draw_gallery.py

The pages say above each command which file it draws and what that is called here. Pictures are reduced to the width at
which they are shown, and to as many colours as they need.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent
PAGES = (DOCS / "gallery.md", DOCS / "the-paper-claim-by-claim.md")
PICTURES = DOCS / "images" / "gallery"
WIDTH = 1100
"""Of a picture [pixels]: twice the width of the page's text."""
COLOURS = 256
COMMAND = re.compile(r"(?P<comments>(?:<!-- (?:(?!-->).)*? -->\n)+)```sh\n(?P<command>.*?)```", re.DOTALL)
PICTURE = re.compile(r"<!-- picture: (?P<made>\S+) as (?P<kept>\S+) -->")


@dataclass(frozen=True)
class Drawing:
    """A command of a page with the files that it draws, each with its name in the gallery."""

    command: str
    pictures: tuple[tuple[str, str], ...]


def drawings(page: str) -> Iterator[Drawing]:
    """Yield the commands of a page in their order."""
    for found in COMMAND.finditer(page):
        yield Drawing(found["command"], tuple(PICTURE.findall(found["comments"])))


def compressed(picture: bytes) -> bytes:
    """Return a PNG file with no more pixels and colours than the page has use for."""
    image = Image.open(BytesIO(picture)).convert("RGB")
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    reduced = image.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    buffer = BytesIO()
    reduced.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def main() -> None:
    """Run all commands in a folder of their own, with this Python first in the path."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    wanted = set(sys.argv[1:])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("problems", "examples"):
            shutil.copytree(DOCS.parent / part, folder / part)
        for drawing in (each for page in PAGES for each in drawings(page.read_text())):
            if not drawing.pictures:
                continue
            environment = {**os.environ, "PATH": programs}
            command = ["/bin/sh", "-ec", drawing.command]
            subprocess.run(command, cwd=folder, env=environment, check=True)  # noqa: S603 - the page's own commands
            for made, kept in drawing.pictures:
                if not wanted or kept in wanted:
                    (PICTURES / kept).write_bytes(compressed((folder / made).read_bytes()))


if __name__ == "__main__":
    main()
