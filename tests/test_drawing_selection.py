"""Which parts of a drawing are read, in which unit, and where they are placed."""

import tempfile
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.io.drawing import PLACES, ImportedScene, ImportOptions, import_scene
from ccm_opt.io.reading import load_problem, parse_problem
from ccm_opt.io.scene_tables import DrawingPlace

from .conftest import PROBLEMS, SMALL_PROBLEM

LAYERS = ("Walls", "furniture", "notes")


def dxf(folder: Path, draw: Callable[[Any, Any], None]) -> Path:
    """Return the path of a DXF drawing written with the layers of these tests."""
    document = ezdxf.new()  # type: ignore[attr-defined]
    for layer in LAYERS:
        document.layers.add(layer)
    draw(document, document.modelspace())
    text = StringIO()
    document.write(text)
    path = folder / "plan.dxf"
    path.write_text(text.getvalue())
    return path


def svg(folder: Path, body: str, size: str = "") -> Path:
    """Return the path of an SVG drawing with a body and attributes of its root."""
    path = folder / "plan.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{body}</svg>')
    return path


def box(space: Any, x: float, layer: str) -> None:
    """Draw a square of side 1 with its corner at (x, 0) on a layer."""
    space.add_lwpolyline([(x, 0), (x + 1, 0), (x + 1, 1), (x, 1)], close=True, dxfattribs={"layer": layer})


def bounds(scene: ImportedScene) -> list[float]:
    """Return the bounding box of all obstacles of a drawing."""
    return list(scene.drawing.box)


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=30, deadline=None)
@given(
    wanted=st.none() | st.sets(st.sampled_from([*LAYERS, "0"])),
    without=st.sets(st.sampled_from([*LAYERS, "0"])),
)
def test_exactly_the_selected_layers_are_read(wanted: set[str] | None, without: set[str]) -> None:
    """A layer is read if it is listed, or nothing is, and not taken out; the rest is reported by layer."""

    def draw(_document: Any, space: Any) -> None:
        for k, layer in enumerate((*LAYERS, "0")):
            box(space, 3.0 * k, layer)
            box(space, 3.0 * k, layer.upper() if layer in LAYERS else layer)

    read = [k for k, layer in enumerate((*LAYERS, "0")) if (wanted is None or layer in wanted) and layer not in without]
    options = ImportOptions(layers=None if wanted is None else tuple(wanted), without=tuple(without))
    with tempfile.TemporaryDirectory() as folder:
        path = dxf(Path(folder), draw)
        if not read:
            with pytest.raises(ProblemError, match="contains no shape"):
                import_scene(path, options)
            return
        scene = import_scene(path, options)
    places = {round(shapely.bounds(obstacle.core)[0] / 3.0) for obstacle in scene.obstacles}
    assert places == set(read)
    skipped = [item for item in scene.drawing.left_out if "workspace." in item.reason]
    assert sum(int(item.what.split("(")[1].split()[0]) for item in skipped) == 2 * (4 - len(read))


def test_a_name_of_a_layer_that_some_programs_refuse_is_read(tmp_path: Path) -> None:
    """LibreCAD writes any character into names of layers; the shapes are read, and the name selects them."""
    path = dxf(tmp_path, lambda _document, space: box(space, 0.0, "plates"))
    path.write_text(path.read_text().replace("plates", 'plates "A/B"'))
    assert import_scene(path, ImportOptions(layers=('plates "A/B"',))).drawing.layers == (('plates "A/B"', 1),)


def test_what_cannot_be_read_does_not_matter_on_a_layer_that_is_not_wanted(tmp_path: Path) -> None:
    """A solid in space refuses a drawing, unless its layer is left out."""

    def draw(_document: Any, space: Any) -> None:
        box(space, 0.0, "Walls")
        space.add_3dface([(0, 0, 0), (1, 0, 1), (1, 1, 2), (0, 1, 3)], dxfattribs={"layer": "furniture"})
        space.add_mesh(dxfattribs={"layer": "furniture"})

    path = dxf(tmp_path, draw)
    with pytest.raises(ProblemError, match=r"cannot be an obstacle|of them"):
        import_scene(path, ImportOptions())
    for options in (ImportOptions(layers=("walls",)), ImportOptions(without=("furniture",))):
        assert len(import_scene(path, options).obstacles) == 1


def test_a_dangling_use_does_not_matter_in_a_group_that_is_not_wanted(tmp_path: Path) -> None:
    """A reference that leads nowhere refuses an SVG drawing, unless its group is left out."""
    path = svg(
        tmp_path,
        '<g id="walls"><rect id="post" width="2" height="1"/></g><g id="symbols"><use href="#gone"/></g>',
    )
    with pytest.raises(ProblemError, match="#gone"):
        import_scene(path, ImportOptions())
    assert [each.name for each in import_scene(path, ImportOptions(layers=("walls",))).obstacles] == ["post"]
    with pytest.raises(ProblemError, match="no shape"):
        import_scene(path, ImportOptions(layers=("walls",), without=("post",)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (ImportOptions(layers=("wals",)), "workspace.layers: it has no layer 'wals', did you mean 'Walls'?"),
        (ImportOptions(without=("zzz",)), "workspace.without: it has no layer or shape 'zzz', only 'Walls'"),
    ],
)
def test_a_name_that_the_drawing_does_not_have_is_an_error(
    options: ImportOptions, message: str, tmp_path: Path
) -> None:
    """A misspelt layer would otherwise leave obstacles out, or keep what was to go."""
    path = dxf(tmp_path, lambda _, space: box(space, 0.0, "Walls"))
    with pytest.raises(ProblemError) as refusal:
        import_scene(path, options)
    assert message in str(refusal.value)


@pytest.mark.parametrize(("unit", "metres"), [(4, 1e-3), (1, 0.0254), (6, 1.0), (5, 1e-2)])
def test_the_header_of_a_dxf_drawing_gives_its_unit(unit: int, metres: float, tmp_path: Path) -> None:
    """With the unit of the file, a square of side 1 has the side that the header says."""

    def draw(document: Any, space: Any) -> None:
        document.units = unit
        box(space, 2.0, "Walls")

    scene = import_scene(dxf(tmp_path, draw), ImportOptions(scale=None), metres=1e-3)
    assert bounds(scene) == pytest.approx([2e3 * metres, 0.0, 3e3 * metres, 1e3 * metres])
    assert scene.drawing.metres == pytest.approx(metres)


def test_the_page_of_an_svg_drawing_gives_its_unit(tmp_path: Path) -> None:
    """A page of 20 units that is 10 cm wide has units of 5 mm; one without a size is refused."""
    path = svg(tmp_path, '<rect width="2" height="1"/>', 'width="10cm" viewBox="0 0 20 20"')
    assert bounds(import_scene(path, ImportOptions(scale=None))) == pytest.approx([0.0, -0.005, 0.01, 0.0])
    with pytest.raises(ProblemError, match="states no unit of length"):
        import_scene(svg(tmp_path, '<rect width="2" height="1"/>'), ImportOptions(scale=None))


COORDINATE = st.floats(-10.0, 10.0)


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=30, deadline=None)
@given(
    corner=st.tuples(COORDINATE, COORDINATE), offset=st.tuples(COORDINATE, COORDINATE),
    scale=st.floats(0.1, 10.0), place=st.sampled_from(["origin", *PLACES]),
)  # fmt: skip
def test_the_chosen_point_of_a_drawing_comes_to_lie_at_the_offset(
    corner: tuple[float, float], offset: tuple[float, float], scale: float, place: DrawingPlace
) -> None:
    """Corners and centre are those of the rectangle around what is read, circles and all; the origin is the file's."""
    x, y = corner
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.dxf"
        document = ezdxf.new()  # type: ignore[attr-defined]
        document.modelspace().add_circle((x, y), 2.0)
        box(document.modelspace(), 40.0, "far")
        document.saveas(path)
        scene = import_scene(path, ImportOptions(scale, offset, place, without=("far",)))
    low = np.array(corner) - 2.0
    reference = np.zeros(2) if place == "origin" else low + 4.0 * np.array(PLACES[place])
    expected = np.concatenate((low, low + 4.0)) - np.tile(reference, 2)
    np.testing.assert_allclose(bounds(scene), scale * expected + np.tile(offset, 2), atol=1e-9)


def test_a_scale_beside_the_unit_of_the_file_is_refused(tmp_path: Path) -> None:
    """Two lengths for one unit of the drawing contradict each other."""
    dxf(tmp_path, lambda _, space: box(space, 0.5, "Walls"))
    keys = '[workspace]\nfile = "plan.dxf"\nunits = "file"\nscale = 2.0\n'
    path = tmp_path / "problem.toml"
    path.write_text(SMALL_PROBLEM.replace("[workspace]\n", keys))
    with pytest.raises(ProblemError, match="leave scale out"):
        load_problem(path)


def test_a_key_of_drawings_in_space_is_said_to_be_of_the_plane() -> None:
    """The message does not send the reader to the place where the key already stands."""
    text = (PROBLEMS / "space" / "elbow.toml").read_text().replace("bounds =", 'layers = ["a"]\nbounds =')
    with pytest.raises(ProblemFileError) as refused:
        parse_problem(text)
    assert refused.value.issues[0].message == "'layers' is a key of problems in the plane; this one has space = 3"
