"""The pictures of the concept pages are drawn from runs of the package, and show what their captions say."""

import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parent.parent / "docs" / "draw_pictures.py"
PICTURES = {
    "clearance-margin-spare.png",
    "route-and-corridor.png",
    "sag-and-certificate.png",
    "travelling-hairpin.png",
}


@pytest.fixture(scope="module")
def script() -> Iterator[ModuleType]:
    """The drawing script as a module, found with what it imports as when it is run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(SCRIPT.parent)
        yield importlib.import_module("draw_pictures")


@pytest.mark.planning
def test_every_picture_is_drawn(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The script writes the pictures that the pages show, each a PNG file."""
    monkeypatch.setattr("sys.argv", ["draw_pictures.py", str(tmp_path)])
    script.main()
    assert {file.name for file in tmp_path.iterdir()} == PICTURES
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in tmp_path.iterdir())
    assert all((SCRIPT.parent / "images" / name).exists() for name in PICTURES)


def test_corridor_has_a_segment_in_every_region(script: ModuleType) -> None:
    """There are three routes, and the curve has as many segments as its corridor has regions."""
    scene = script.corridor_scene()
    assert len(scene.routes) == 3
    assert len(scene.configuration.segments) == len(scene.corridor.regions)


def test_fold_travels_from_the_tip_past_the_base(script: ModuleType) -> None:
    """The fold of the drawn hairpin is ever nearer to the base, and has passed it in the last moment."""
    moments = script.hairpin_scene().moments
    places = [moment.fold_at for moment in moments]
    assert places == sorted(places, reverse=True)
    assert places[-1] < 0.0 < places[0]


def test_halving_proves_the_drawn_interval(script: ModuleType) -> None:
    """The certificate refuses the drawn interval as a whole and proves it in two halves."""
    scene = script.sag_scene()
    assert not scene.proved(0)
    assert scene.proved(1)
