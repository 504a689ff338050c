"""Obstacles from drawings: what is read and refused, how curves are contained, how a problem file uses a drawing."""

import io
import itertools
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.io.drawing import ImportOptions
from ccm_opt.io.drawing import import_scene as import_drawing
from ccm_opt.io.drawn_obstacles import divided
from ccm_opt.io.dxf_pieces import Piece, joined_pieces
from ccm_opt.io.problem_data import recorded_data
from ccm_opt.io.reading import load_problem, parse_problem, problem_from_mapping
from ccm_opt.io.shapes import Shape, flatten_bezier, flatten_bulges, flatten_ellipse, flatten_spline
from ccm_opt.scene.workspace import Obstacle

from .conftest import SMALL_PROBLEM

DATA = Path(__file__).parent / "data"
COORDINATE = st.floats(-5.0, 5.0).map(lambda x: round(x, 3))
POINT = st.tuples(COORDINATE, COORDINATE)
Writer = Callable[[str, str | bytes], Path]


@pytest.fixture
def write(tmp_path: Path) -> Writer:
    """Writes a drawing of the given name."""

    def writer(name: str, content: str | bytes) -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return writer


def svg(body: str) -> str:
    """An SVG document."""
    head = 'xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
    return f"<svg {head}>{body}</svg>"


def dxf(draw: Callable[..., None]) -> str:
    """A DXF document whose model space ``draw(document, modelspace)`` filled."""
    import ezdxf

    document, text = ezdxf.new(), io.StringIO()
    draw(document, document.modelspace())
    document.write(text)
    return text.getvalue()


def import_scene(path: Path, options: ImportOptions, taken: Collection[str] = ()) -> tuple[Obstacle, ...]:
    """The obstacles of a drawing."""
    return import_drawing(path, options, taken).obstacles


def polygons(obstacles: tuple[Obstacle, ...]) -> dict[str, shapely.Geometry]:
    """The cores by name."""
    return {obstacle.name: obstacle.core for obstacle in obstacles}


def furthest(points: np.ndarray, geometry: shapely.Geometry) -> float:
    """Greatest distance of points from a geometry."""
    return float(shapely.distance(shapely.points(points), geometry).max())


@pytest.mark.parametrize("suffix", ["svg", "dxf", "geojson", "wkt"])
def test_the_same_picture_in_each_format_gives_the_same_obstacles(suffix: str) -> None:
    """A frame with a hole, a wedge and an open shelf, placed by scale and offset, come out alike from all formats."""
    found = import_scene(DATA / f"scene.{suffix}", ImportOptions(scale=0.5, offset=(10.0, 20.0)))
    by_area = sorted(found[:4], key=lambda o: -shapely.area(o.core))
    frame, wedge = by_area[0].core, by_area[1].core
    hole = shapely.box(2, 1, 4, 3)
    expected = shapely.affinity.affine_transform(shapely.box(1, 0, 5, 4) - hole, [0.5, 0, 0, 0.5, 10, 20])
    assert frame.equals(expected)
    assert wedge.equals(shapely.Polygon([(13, 20.5), (13.5, 20.5), (13.5, 21)]))
    shelf = next(o for o in found if isinstance(o.core, shapely.LineString))
    assert shelf.core.equals(shapely.LineString([(13, 22), (13.5, 22), (13.5, 22.5)]))
    assert shelf.rounding == 0.0
    if suffix != "wkt":
        assert (by_area[0].name, by_area[1].name, shelf.name) == ("frame", "wedge", "shelf")
    if suffix in {"svg", "dxf"}:
        post = next(o for o in found if o.name == "post")
        assert isinstance(post.core, shapely.Point)
        np.testing.assert_allclose([post.core.x, post.core.y, post.rounding], [14.5, 24.5, 0.25], rtol=1e-12)
    assert len(found) == (4 if suffix in {"svg", "dxf"} else 3)


@settings(max_examples=40, deadline=None)
@given(control=st.lists(POINT, min_size=3, max_size=6), exponent=st.integers(1, 4))
def test_a_flattened_bezier_curve_stays_within_the_distance(control: list[tuple[float, float]], exponent: int) -> None:
    """Every point of the curve, from Bernstein's formula, is near the polyline, and the ends agree."""
    from scipy.special import comb

    points, distance = np.array(control), 10.0**-exponent
    degree, t = len(points) - 1, np.linspace(0.0, 1.0, 300)[:, None]
    bernstein = [comb(degree, k) * t**k * (1 - t) ** (degree - k) * points[k] for k in range(degree + 1)]
    flat = flatten_bezier(points, distance)
    assert furthest(np.sum(bernstein, axis=0), shapely.LineString(flat)) <= distance * (1 + 1e-9)
    np.testing.assert_array_equal(flat[[0, -1]], points[[0, -1]])


@settings(max_examples=40, deadline=None)
@given(
    axes=st.tuples(st.floats(0.01, 5.0), st.floats(0.01, 5.0)),
    start=st.floats(-6.0, 6.0),
    sweep=st.floats(0.1, 6.28) | st.floats(-6.28, -0.1),
)
def test_a_flattened_elliptic_arc_stays_within_the_distance(
    axes: tuple[float, float], start: float, sweep: float
) -> None:
    """Points of the arc at random parameters are within the distance of the polyline."""
    major, minor = np.array([0.6, 0.8]) * axes[0], np.array([-0.8, 0.6]) * axes[1]
    t = start + sweep * np.linspace(0.0, 1.0, 333)
    flat = flatten_ellipse(np.zeros(2), major, minor, start, sweep, 1e-3)
    curve = np.outer(np.cos(t), major) + np.outer(np.sin(t), minor)
    assert furthest(curve, shapely.LineString(flat)) <= 1e-3


@given(bulge=st.floats(0.01, 8.0) | st.floats(-8.0, -0.01))
def test_a_bulge_is_the_arc_through_its_sagitta(bulge: float) -> None:
    """The middle of the arc over a chord of length 2 is the bulge away from it, on its right for a positive bulge."""
    flat = flatten_bulges(np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([bulge]), 1e-5)
    assert furthest(np.array([[1.0, -bulge]]), shapely.LineString(flat)) <= 1.1e-5
    radius = (1.0 + bulge**2) / (2.0 * abs(bulge))
    center = np.array([1.0, -bulge + np.sign(bulge) * radius])
    np.testing.assert_allclose(np.hypot(*(flat - center).T), radius, rtol=1e-9)


@settings(max_examples=30, deadline=None)
@given(control=st.lists(st.tuples(COORDINATE, COORDINATE, st.floats(0.5, 2.0)), min_size=4, max_size=9))
def test_a_flattened_spline_stays_within_the_distance(control: list[tuple[float, float, float]]) -> None:
    """Points of a clamped cubic B-spline, a rational one, are within the distance of the polyline."""
    points, weights = np.array(control)[:, :2], np.array(control)[:, 2]
    inner = np.linspace(0.0, 1.0, len(control) - 2)
    inner[1 : len(inner) // 2] = inner[1]  # knots may be repeated
    knots = np.concatenate(([0.0] * 3, inner, [1.0] * 3))
    flat = flatten_spline(knots, points, weights, 3, 1e-2)
    t = np.linspace(0.0, 1.0, 300)
    curve = BSpline(knots, weights[:, None] * points, 3)(t) / BSpline(knots, weights, 3)(t)[:, None]
    assert furthest(curve, shapely.LineString(flat)) <= 1e-2 * (1 + 1e-9)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=10, deadline=None)
@given(
    axes=st.tuples(st.floats(0.2, 3.0), st.floats(0.2, 3.0)),
    matrix=st.tuples(*[st.floats(-2.0, 2.0)] * 4).filter(lambda m: abs(m[0] * m[3] - m[1] * m[2]) > 0.2),
    tolerance=st.floats(1e-3, 1e-1),
)
def test_the_polygon_of_a_curve_contains_it_and_leaves_it_by_no_more_than_the_tolerance(
    tmp_path_factory: pytest.TempPathFactory,
    axes: tuple[float, float],
    matrix: tuple[float, float, float, float],
    tolerance: float,
) -> None:
    """An ellipse under any transform lies inside its polygon, and the polygon within the tolerance of the ellipse."""
    a, b, c, d = matrix
    body = f'<ellipse rx="{axes[0]!r}" ry="{axes[1]!r}" transform="matrix({a!r} {b!r} {c!r} {d!r} 1 2)"/>'
    path = tmp_path_factory.mktemp("svg") / "egg.svg"
    path.write_text(svg(body))
    (egg,) = import_scene(path, ImportOptions(scale=2.0, curve_tolerance=tolerance))
    assume(not isinstance(egg.core, shapely.Point))  # a circle stays one, without a polygon
    t = np.linspace(0.0, 2.0 * np.pi, 2000)
    x, y = axes[0] * np.cos(t), axes[1] * np.sin(t)
    true = 2.0 * np.column_stack((a * x + c * y + 1.0, -(b * x + d * y + 2.0)))
    polygon = egg.outline()
    assert shapely.intersects_xy(polygon, true).all()
    dense = shapely.get_coordinates(shapely.segmentize(polygon.exterior, 0.02))
    assert furthest(dense, shapely.LinearRing(true)) <= tolerance + 1e-4
    assert furthest(dense, shapely.Polygon(true)) <= tolerance + 1e-5


def test_circles_stay_exact_under_similarities_only(write: Writer) -> None:
    """A turned, mirrored and scaled circle is a point with a radius; a sheared one is a polygon."""
    body = """<g transform="translate(3 4) rotate(20) scale(-2 2)"><circle cx="1" r="2"/></g>
              <ellipse rx="1" ry="2" transform="scale(2 1)"/><circle r="2" transform="skewX(10)"/>"""
    disc, round_again, sheared = import_scene(write("a.svg", svg(body)), ImportOptions(scale=0.5))
    assert isinstance(disc.core, shapely.Point)
    assert disc.rounding == pytest.approx(2.0)
    turn = np.deg2rad(20)
    np.testing.assert_allclose(disc.core.coords[0], [1.5 - np.cos(turn), -2.0 + np.sin(turn)], atol=1e-12)
    assert isinstance(round_again.core, shapely.Point)
    assert round_again.rounding == pytest.approx(1.0)
    assert isinstance(sheared.core, shapely.Polygon)


def test_straight_outlines_are_not_grown(write: Writer) -> None:
    """Corners keep their coordinates, y negated, however large the curve tolerance."""
    path = write("a.svg", svg('<rect x="1" y="2" width="3" height="4"/>'))
    (rect,) = import_scene(path, ImportOptions(curve_tolerance=0.5))
    assert rect.core.equals(shapely.box(1, -6, 4, -2))


def test_names_come_from_label_title_id_or_group_and_never_double(write: Writer) -> None:
    """The nearest name wins; a name met before, in the problem file too, gets the next free number."""
    box = 'width="1" height="1"'
    body = f"""<g inkscape:label="wall" id="layer1"><rect {box}/><rect id="own" {box}/>
               <rect inkscape:label="label" id="x" {box}><title>title</title></rect>
               <rect id="y" {box}><title>title</title></rect><rect {box}/></g><rect {box}/>
               <use href="#own" x="5"/>"""
    found = import_scene(write("a.svg", svg(body)), ImportOptions(), taken={"wall", "wall 3"})
    assert [o.name for o in found] == ["wall 2", "own", "label", "title", "wall 4", "rect", "own 2"]


def test_what_an_svg_does_not_show_is_no_obstacle(write: Writer) -> None:
    """Hidden shapes, clip paths, masks, markers, patterns and unused symbols are left out."""
    box = '<rect width="1" height="1"/>'
    hidden = [f"<{tag}>{box}</{tag}>" for tag in ("clipPath", "mask", "marker", "pattern", "symbol", "defs")]
    hidden += [f'<g style="display:none">{box}</g>', f'<g visibility="hidden">{box}</g>', "<image/>"]
    found = import_scene(write("a.svg", svg("".join(hidden) + '<circle id="seen" r="1"/>')), ImportOptions())
    assert [o.name for o in found] == ["seen"]


@pytest.mark.parametrize(
    ("rule", "inner", "holes"),
    [("evenodd", "M1 1h2v2h-2z", 1), ("nonzero", "M1 1h2v2h-2z", 0), ("nonzero", "M1 1v2h2v-2z", 1)],
)
def test_rings_within_rings_are_holes_by_the_fill_rule(write: Writer, rule: str, inner: str, holes: int) -> None:
    """Even-odd makes every inner ring a hole, nonzero only one drawn the other way round."""
    path = write("a.svg", svg(f'<path fill-rule="{rule}" d="M0 0h4v4h-4z {inner}"/>'))
    (frame,) = import_scene(path, ImportOptions())
    assert isinstance(frame.core, shapely.Polygon)
    assert len(frame.core.interiors) == holes


def test_open_lines_are_walls_of_the_given_thickness_and_curves_inside_them(write: Writer) -> None:
    """A straight line gets half the thickness as rounding; a curved one lies inside its wall."""
    path = write("a.svg", svg('<line x2="1"/><path d="M0 0Q1 2 2 0"/>'))
    line, curve = import_scene(path, ImportOptions(wall_thickness=0.2))
    assert line.rounding == pytest.approx(0.1)
    assert curve.rounding == pytest.approx(0.1 + 1.25e-4)
    t = np.linspace(0.0, 1.0, 500)
    _, bare = import_scene(path, ImportOptions(curve_tolerance=1e-2))
    true = np.column_stack((2.0 * t, -4.0 * t * (1.0 - t)))
    assert furthest(true, bare.core) <= bare.rounding == 5e-3


def test_a_small_loop_is_repaired_and_a_bow_tie_refused_with_its_place(write: Writer) -> None:
    """A repair that hardly changes the area is made; one that does is refused by name, with the crossing."""
    nearly = "POLYGON ((0 0, 10 0, 10 10, 5 10.001, 4.999 9.999, 5.001 9.999, 4.998 10.001, 0 10, 0 0))"
    (mended,) = import_scene(write("a.wkt", nearly), ImportOptions())
    assert mended.core.is_valid
    assert shapely.area(mended.core) == pytest.approx(100.0, abs=0.01)
    bow_tie = svg('<path id="bow" d="M0 0L1 1V0L0 1z"/><circle id="fine" r="1"/>')
    with pytest.raises(ProblemError, match=r"'bow' cannot be an obstacle: the outline crosses itself at \(5.5, -0.5\)"):
        import_scene(write("a.svg", bow_tie), ImportOptions(offset=(5.0, 0.0)))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.png", b"x", "not a drawing of a known format"),
        ("a.svg", b" \n", "is empty"),
        ("a.svg", b"<svg", "not readable as XML"),
        ("a.svg", b"<html/>", "expected the outermost element svg, got html"),
        ("a.svg", svg("").encode(), "contains no shape"),
        ("a.svg", svg('<path d="M0,0 L nan,3"/>').encode(), "neither a command nor a number"),
        (
            "a.svg",
            svg('<rect id="far" width="1e400" height="3"/>').encode(),
            "'far': it has a length that is too large",
        ),
        ("a.svg", svg('<rect id="far" width="1e40" height="3"/>').encode(), "'far' cannot be an obstacle: .*1e.40"),
        ("a.svg", svg('<circle id="huge" r="1e15" transform="skewX(3)"/>').encode(), "'huge': a curve needs"),
        ("a.svg", svg('<path id="dot" d="M1 2L1 2"/>').encode(), "left out: 'dot': it has zero size"),
        ("a.dxf", b"hello", "has no end"),
        ("a.dxf", b"\x00\x01 EOF", "not readable as DXF"),
        ("a.wkt", b"POINT (1 2)", "left out: Point 'geometry 1': points have zero size"),
        ("a.wkt", b"POLYGON EMPTY", "is empty"),
        ("a.wkt", b"POLYGON ((0 0, 1 0", "cannot be read as well-known text"),
        ("a.wkt", b"POLYGON ((0 0, 1 0, nan 1, 0 0))", "not a finite number"),
        ("a.wkt", b"CURVEPOLYGON (CIRCULARSTRING (0 0, 1 1, 2 0, 1 -1, 0 0))", "cannot be read as well-known text"),
        ("a.wkt", b"\xff\xfe", "not a UTF-8 text file"),
        ("a.json", b"{", "not JSON"),
        ("a.json", b"[]", "expected a GeoJSON object"),
        ("a.json", b'{"type": "Sphere"}', "'Sphere' is not a GeoJSON geometry"),
        ("a.json", b'{"type": "FeatureCollection"}', "needs a list of 'features'"),
        ("a.json", b'{"type": "Polygon", "coordinates": "x"}', "coordinates are not those of a Polygon"),
    ],
)
def test_an_unusable_drawing_is_refused_in_one_clear_sentence(
    write: Writer, name: str, content: bytes, message: str
) -> None:
    """Whatever is wrong with the drawing, the error is a ProblemError that says so."""
    with pytest.raises(ProblemError, match=message):
        import_scene(write(name, content), ImportOptions())


def test_too_many_vertices_and_missing_files_are_refused(tmp_path: Path, write: Writer) -> None:
    """A drawing no planner could use, a path to nothing and a directory are refused."""
    ring = np.column_stack((np.cos(t := np.linspace(0, 2 * np.pi, 60_000, endpoint=False)), np.sin(t)))
    with pytest.raises(ProblemError, match="has 60001 vertices; at most 50000"):
        import_scene(write("a.wkt", shapely.Polygon(ring).wkt), ImportOptions())
    with pytest.raises(ProblemError, match="does not exist"):
        import_scene(tmp_path / "none.svg", ImportOptions())
    (tmp_path / "folder.svg").mkdir()
    with pytest.raises(ProblemError, match="is a directory"):
        import_scene(tmp_path / "folder.svg", ImportOptions())


def test_dxf_curves_widths_and_reverse_sides_are_read(write: Writer) -> None:
    """Bulges, wide polylines, arcs closed by lines, and what is drawn on the back of the plane come out right."""

    def draw(_document: object, space: object) -> None:
        space.add_lwpolyline([(0, 0, 0, 0, 1), (2, 0, 0, 0, 1)], close=True, dxfattribs={"layer": "ring"})
        space.add_lwpolyline([(5, 0), (7, 0)], dxfattribs={"layer": "wide", "const_width": 0.4})
        space.add_arc((3, 3), 1, 0, 180, dxfattribs={"layer": "dome"})
        space.add_line((2, 3), (4, 3), dxfattribs={"layer": "dome"})
        space.add_circle((3, 0), 2, dxfattribs={"layer": "back", "extrusion": (0, 0, -1)})
        space.add_ellipse((0, 0), (2, 0), 0.5, dxfattribs={"layer": "egg"})

    found = import_scene(write("a.dxf", dxf(draw)), ImportOptions())
    cores = polygons(found)
    assert shapely.area(cores["ring"]) == pytest.approx(np.pi, abs=2e-3)
    assert shapely.area(cores["dome"]) == pytest.approx(np.pi / 2, abs=2e-3)
    assert shapely.area(cores["egg"]) == pytest.approx(2 * np.pi, abs=5e-3)
    assert cores["back"].equals(shapely.Point(-3, 0))
    assert next(o for o in found if o.name == "wide").rounding == pytest.approx(0.2)


def test_dxf_blocks_are_taken_apart_and_hidden_layers_left_out(write: Writer) -> None:
    """Nested, turned and stretched blocks land where they belong; layers that are off or frozen do not count."""

    def draw(document: object, space: object) -> None:
        document.layers.add("off").off()
        document.layers.add("frozen").freeze()
        inner, outer = document.blocks.new("disc"), document.blocks.new("pair")
        inner.add_circle((1, 0), 0.5)
        outer.add_blockref("disc", (0, 0))
        outer.add_blockref("disc", (0, 0), dxfattribs={"rotation": 90})
        space.add_blockref("pair", (10, 0), dxfattribs={"layer": "pumps"})
        space.add_blockref("disc", (0, 0), dxfattribs={"xscale": 2})
        for layer in ("off", "frozen"):
            space.add_circle((0, 0), 9, dxfattribs={"layer": layer})
        space.add_text("note")

    found = import_scene(write("a.dxf", dxf(draw)), ImportOptions())
    assert [o.name for o in found] == ["pumps", "pumps 2", "disc"]
    np.testing.assert_allclose([o.core.coords[0] for o in found[:2]], [(11, 0), (10, 1)], atol=1e-12)
    np.testing.assert_allclose(shapely.bounds(found[2].core), (1, -0.5, 3, 0.5), atol=3e-4)


def test_a_dxf_reference_to_a_block_that_is_not_there_is_refused(write: Writer) -> None:
    """A lost block may have been an obstacle."""

    def draw(_document: object, space: object) -> None:
        space.add_circle((0, 0), 1)
        space.add_blockref("nowhere", (0, 0))

    with pytest.raises(ProblemError, match=r"damaged: Deleted entity INSERT.* without required BLOCK"):
        import_scene(write("a.dxf", dxf(draw)), ImportOptions())


def test_dxf_entities_that_cannot_be_read_are_refused_by_name(write: Writer) -> None:
    """An entity that would be a missing obstacle stops the import, and all such entities are named."""

    def draw(_document: object, space: object) -> None:
        space.add_circle((0, 0), 1, dxfattribs={"extrusion": (1, 0, 0), "layer": "standing"})
        space.add_rational_spline([(0, 0), (1, 1), (2, 0), (3, 1)], [1, -2, 1, 1], dxfattribs={"layer": "conic"})
        space.add_3dface([(0, 0), (1, 0), (1, 1)])
        space.add_mesh()
        space.add_polyface()
        space.add_polymesh()

    with pytest.raises(ProblemError) as caught:
        import_scene(write("a.dxf", dxf(draw)), ImportOptions())
    for words in (
        *("CIRCLE 'standing'", "does not lie in the x-y plane", "SPLINE 'conic'", "weight", "3DFACE: a 3-D face"),
        *("MESH: a 3-D mesh", "POLYFACE: a 3-D mesh", "POLYMESH: a 3-D mesh"),
    ):
        assert words in str(caught.value)


@pytest.mark.parametrize("kind", ["3DSOLID", "BODY", "REGION", "SURFACE", "ACAD_PROXY_ENTITY", "NEWS"])
def test_dxf_entities_in_space_and_unknown_ones_are_refused_by_type(write: Writer, kind: str) -> None:
    """What cannot be read is named by its type, and never passed over."""
    entity = f"0\n{kind}\n5\nA1\n100\nAcDbEntity\n8\n0\n100\nAcDbModelerGeometry\n70\n1\n"
    text = dxf(lambda _, space: space.add_circle((0, 0), 1)).replace("  0\nCIRCLE", entity + "  0\nCIRCLE")
    with pytest.raises(ProblemError, match=kind):
        import_scene(write("a.dxf", text), ImportOptions())


def test_dxf_annotations_may_be_broken_and_lines_without_length_are_told(write: Writer) -> None:
    """A dimension without its block, points and zero-length lines become no obstacles, each with its reason."""

    def draw(_document: object, space: object) -> None:
        space.add_circle((0, 0), 1)
        space.add_mline([(5, 0), (9, 0)])
        space.add_line((3, 3), (3, 3))
        space.add_leader([(0, 0), (1, 1)])
        space.new_entity("DIMENSION", {"text": "40"})
        space.add_text("gone").set_placement((1, 1))

    text = dxf(draw)
    broken = text.replace("AcDbText", "AcDbNothing").replace("AcDbLeader", "AcDbNothing")
    assert import_drawing(write("b.dxf", broken), ImportOptions()).drawing.obstacles == 3
    found = import_drawing(write("a.dxf", text), ImportOptions())
    assert [obstacle.core.geom_type for obstacle in found.obstacles] == ["Point", "LineString", "LineString"]
    told = {item.what.split(" ")[0]: item.reason for item in found.drawing.left_out}
    assert told["LINE"] == "it has zero length"
    assert {"LEADER", "DIMENSION"} <= set(told)


def test_dxf_blocks_within_blocks_may_have_no_height(write: Writer) -> None:
    """A scale of 0 along z, which some programs write, does not matter."""

    def draw(document: object, space: object) -> None:
        document.blocks.new("hole").add_circle((0, 0), 1)
        document.blocks.new("plate").add_blockref("hole", (1, 0), {"zscale": 0.0, "xscale": 2.0, "yscale": 2.0})
        space.add_blockref("plate", (0, 0), {"zscale": 0.0})

    found = import_drawing(write("a.dxf", dxf(draw)), ImportOptions())
    assert found.drawing.box == (-1.0, -2.0, 3.0, 2.0)


@pytest.mark.parametrize("form", ["asc", "bin"])
def test_dxf_is_read_as_text_and_as_binary(tmp_path: Path, form: str) -> None:
    """Both forms of the format hold the same obstacles, and the unit that the header names."""
    import ezdxf

    document = ezdxf.new(units=4)
    document.modelspace().add_circle((1, 2), 3)
    document.saveas(tmp_path / "a.dxf", fmt=form)
    found = import_drawing(tmp_path / "a.dxf", ImportOptions())
    assert found.drawing.box == (-2.0, -1.0, 4.0, 5.0)
    assert found.drawing.unit == "mm"


@settings(max_examples=40, deadline=None)
@given(data=st.data(), corners=st.integers(3, 9))
def test_lines_of_a_polygon_join_to_it_in_any_order_and_direction(data: st.DataObject, corners: int) -> None:
    """The sides of a polygon, shuffled and some of them reversed, join to one closed piece; without one, to a chain."""
    turn = 2.0 * np.pi * np.arange(corners) / corners
    points = np.column_stack((np.cos(turn), np.sin(turn)))
    order = data.draw(st.permutations(range(corners)))
    flips = data.draw(st.lists(st.booleans(), min_size=corners, max_size=corners))
    sides = [np.array([points[k], points[(k + 1) % corners]])[:: -1 if flips[k] else 1] for k in order]
    (ring,) = joined_pieces([Piece(side) for side in sides], 1e-9)
    assert ring.closed
    assert shapely.Polygon(ring.points).equals(shapely.Polygon(points))
    (chain,) = joined_pieces([Piece(side) for side in sides[1:]], 1e-9)
    assert not chain.closed
    assert len(chain.points) == corners


@settings(max_examples=30, deadline=None)
@given(data=st.data(), corners=st.integers(3, 7))
def test_lines_drawn_twice_whole_or_in_parts_count_once(data: st.DataObject, corners: int) -> None:
    """The sides of a polygon, drawn again in halves and in any order, join to the polygon all the same."""
    turn = 2.0 * np.pi * np.arange(corners + 1) / corners
    points = 50.0 + np.column_stack((np.cos(turn), np.sin(turn)))
    halves = np.stack((points[:-1], 0.5 * (points[:-1] + points[1:]), points[1:]), axis=1)
    again = [side[cut] for side in halves for cut in data.draw(st.sampled_from([[[2, 0]], [[0, 1], [1, 2]]]))]
    sides = data.draw(st.permutations([*halves[:, [0, 2]], *again]))
    (ring,) = joined_pieces([Piece(side) for side in sides], 1e-6)
    assert ring.closed
    assert shapely.Polygon(ring.points).area == pytest.approx(shapely.Polygon(points[:-1]).area)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=30, deadline=None)
@given(
    nested=st.lists(st.integers(0, 1), min_size=1, max_size=5),
    repeated=st.booleans(),
    closed=st.sampled_from(["solid", "walls", "room"]),
)
def test_outlines_within_outlines_are_holes_by_turns(nested: list[int], repeated: bool, closed: str) -> None:
    """Boxes and circles in each other, maybe drawn twice, are solid by turns; lines; or fill a room by turns."""
    sizes = 10.0 - np.arange(len(nested))

    def draw(_document: object, space: object) -> None:
        for size, is_round in zip(sizes, nested, strict=True):
            for k in range(1 + repeated):
                if is_round:
                    space.add_circle((3, 4), 0.5 * size)
                else:
                    corners = [(3 + x * size, 4 + y * size) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
                    space.add_lwpolyline(corners[k:] + corners[:k], close=True)

    inside = [
        shapely.Point(3, 4).buffer(0.5 * s, 64) if r else shapely.box(3 - s, 4 - s, 3 + s, 4 + s)
        for s, r in zip(sizes, nested, strict=True)
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.dxf"
        path.write_text(dxf(draw))
        assume(all(one.contains_properly(other) for one, other in itertools.pairwise(inside)))
        found = import_drawing(path, ImportOptions(curve_tolerance=1e-3, closed=closed))
    area = sum(shapely.area(obstacle.outline()) for obstacle in found.obstacles)
    if closed == "walls":
        assert all(isinstance(obstacle.core, shapely.LineString) for obstacle in found.obstacles)
        assert len(found.obstacles) == len(nested) * (1 + repeated)
        return
    solids = inside
    if closed == "room":
        assert found.room is not None
        assert found.room.area == pytest.approx(inside[0].area, rel=1e-2)
        solids = inside[1:]
    expected = sum((-1) ** k * solid.area for k, solid in enumerate(solids))
    assert area == pytest.approx(expected, rel=1e-2, abs=1e-2)


@given(place=st.tuples(COORDINATE, COORDINATE), size=st.sampled_from([1e-13, 1e-9, 1e-3, 1.0]))
def test_outlines_without_area_are_walls_or_told(place: tuple[float, float], size: float) -> None:
    """A polygon whose corners lie in a line is a wall along it; one whose corners are one place is told."""
    ring = np.array(place) + size * np.array([[0.0, 0.0], [0.5, 0.25], [1.0, 0.5]])
    found = divided(Shape("thin", (ring,)), 1e9)
    if np.all(ring == ring[0]):
        assert found == []
    else:
        (wall,) = found
        assert wall.drawn == "line"
        assert shapely.LineString(wall.rings[0]).distance(shapely.Point(ring[2])) == 0.0


def test_chains_end_where_three_lines_meet() -> None:
    """A junction of three ends joins nothing."""
    star = [Piece(np.array([[0.0, 0.0], [np.cos(a), np.sin(a)]])) for a in (0.0, 2.0, 4.0)]
    assert len(joined_pieces(star, 1e-9)) == 3


def with_drawing(keys: str = "") -> str:
    """The small problem with a drawing beside it."""
    return SMALL_PROBLEM.replace("[workspace]\n", f'[workspace]\nfile = "scene.svg"\n{keys}')


def test_a_problem_file_takes_the_obstacles_of_a_drawing_after_its_own(write: Writer) -> None:
    """The drawing is placed in the problem's unit, its obstacles follow the listed ones, names stay unique."""
    write("scene.svg", svg('<circle id="post" cx="5" cy="6" r="1"/><rect x="-9" y="5" width="2" height="3"/>'))
    problem = load_problem(write("problem.toml", with_drawing("scale = 0.1\noffset = [0.0, -0.1]\n")))
    names = [o.name for o in problem.workspace.obstacles]
    assert names == ["post", "post 2", "rect"]
    _, post, rect = problem.workspace.obstacles
    np.testing.assert_allclose([*post.core.coords[0], post.rounding], [0.5, -0.7, 0.1], rtol=1e-12)
    np.testing.assert_allclose(shapely.bounds(rect.core), [-0.9, -0.9, -0.7, -0.6], rtol=1e-12)


def test_the_copy_of_a_problem_needs_the_drawing_no_more(write: Writer) -> None:
    """The data kept for solution.json rebuild the same workspace, to the last bit, after the drawing is gone."""
    content = (DATA / "scene.svg").read_text() + "<!-- -->"
    drawing = write("scene.svg", content.replace("</svg>", '<ellipse cx="4" cy="-8" rx="2" ry=".5"/></svg>'))
    text = with_drawing("scale = 0.05\noffset = [0.3, 0.3]\nwall_thickness = 0.01\n").replace(
        "[0.3, 0.1]", "[0.3, 0.0]"
    )
    problem = load_problem(write("problem.toml", text))
    drawing.unlink()
    again = problem_from_mapping(json.loads(json.dumps(recorded_data(problem))))
    assert len(problem.workspace.obstacles) == 6
    for before, after in zip(problem.workspace.obstacles, again.workspace.obstacles, strict=True):
        assert (before.name, before.rounding) == (after.name, after.rounding)
        assert shapely.equals_exact(before.core, after.core, 0.0)


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_the_default_tolerance_is_the_same_in_every_unit(write: Writer, unit: str) -> None:
    """Curves grow by half of a quarter millimetre, whatever the problem file's unit."""
    write("scene.svg", svg('<path id="hair" d="M.5 .5Q.6 .6 .7 .5"/>'))
    factor = {"m": 1.0, "mm": 1e3}[unit]
    text = with_drawing(f"scale = {factor}\n")
    if unit == "mm":
        text = with_drawing(f"scale = {factor}\n").replace('name = "small"', 'name = "small"\nunits = "mm"')
        for old, new in (
            ("bounds = [-1.0, -1.0, 1.0, 1.0]", "bounds = [-1e3, -1e3, 1e3, 1e3]"),
            ("center = [0.0, 0.3], radius = 0.1", "center = [0.0, 300.0], radius = 100.0"),
            ("link_length = 0.1\nradius = 0.02", "link_length = 100.0\nradius = 20.0"),
            ("position = [0.3, 0.1]", "position = [300.0, 100.0]"),
        ):
            text = text.replace(old, new)
    hair = load_problem(write("problem.toml", text)).workspace.obstacles[-1]
    assert hair.rounding == pytest.approx(1.25e-4)
    np.testing.assert_allclose(hair.core.coords[0], [0.5, -0.5], rtol=1e-12)


@pytest.mark.parametrize(
    ("keys", "key", "message"),
    [
        ("", "workspace.file", "does not exist"),
        ("scale = 0.0\n", "workspace.scale", "greater than 0"),
        ("offset = [1.0]\n", "workspace.offset", "expected exactly 2 entries"),
        ("sclae = 1.0\n", "workspace.sclae", "did you mean 'scale'"),
    ],
)
def test_what_is_wrong_with_a_drawing_is_reported_with_key_and_line(
    write: Writer, keys: str, key: str, message: str
) -> None:
    """A missing drawing and bad placement are issues of the problem file like any other."""
    with pytest.raises(ProblemFileError) as caught:
        load_problem(write("problem.toml", with_drawing(keys)))
    issue = next(issue for issue in caught.value.issues if issue.key == key)
    assert message in issue.message
    assert issue.line == (6 if keys and key != "workspace.file" else 5)


def test_a_drawing_s_defects_and_those_of_the_file_come_together(write: Writer) -> None:
    """A bow tie in the drawing and an odd number of links are reported at once."""
    write("scene.svg", svg('<path id="bow" d="M0 0L1 1V0L0 1z"/>'))
    with pytest.raises(ProblemFileError) as caught:
        load_problem(write("problem.toml", with_drawing().replace("links = 4", "links = 5")))
    assert {issue.key for issue in caught.value.issues} == {"workspace.file", "arm.links"}


def test_placement_without_a_file_and_a_file_without_a_folder_are_refused() -> None:
    """``scale`` alone has no meaning, and a text that was read from no file has no folder to look in."""
    with pytest.raises(ProblemFileError, match="only allowed together with file") as caught:
        parse_problem(SMALL_PROBLEM.replace("[workspace]", "[workspace]\nscale = 2.0"))
    assert caught.value.issues[0].key == "workspace.scale"
    with pytest.raises(ProblemFileError, match="was not read from a file"):
        parse_problem(with_drawing())


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("polygon = [[0.4, 0.4], [0.8, 0.4], [0.8, 0.8], [0.4, 0.8]]", None),
        ("box = [0.4, 0.4, 0.8, 0.8]", "only allowed together with polygon"),
        ("polygon = [[0.4, 0.4], [0.6, 0.4], [0.6, 0.6], [0.4, 0.6]]", "holes that lie inside the polygon"),
    ],
)
def test_polygons_in_a_problem_file_may_have_holes(kind: str, message: str | None) -> None:
    """Holes belong to a polygon and lie inside it."""
    hole = "holes = [[[0.5, 0.5], [0.7, 0.5], [0.7, 0.7], [0.5, 0.7]]]"
    text = SMALL_PROBLEM.replace("[arm]", f"[[workspace.obstacles]]\n{kind}\n{hole}\n[arm]")
    if message is None:
        assert shapely.area(parse_problem(text).workspace.obstacles[1].core) == pytest.approx(0.16 - 0.04)
    else:
        with pytest.raises(ProblemFileError, match=message):
            parse_problem(text)


def test_readers_are_loaded_only_for_their_own_files() -> None:
    """A problem without a drawing loads neither reader, and a WKT file does not load the one for DXF."""
    code = f"""
import sys
import tomllib
from pathlib import Path
import ccm_opt
from ccm_opt.io.reading import parse_problem
parse_problem({SMALL_PROBLEM!r})
assert "ezdxf" not in sys.modules
from ccm_opt.io.drawing import import_scene
from ccm_opt.io.shapes import Shape
from ccm_opt.io.drawing import ImportOptions
from ccm_opt.io.drawn_obstacles import divided
import_scene(Path({str(DATA / "scene.wkt")!r}), ImportOptions())
assert "ezdxf" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)
