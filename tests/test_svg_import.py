"""SVG drawings: outlines against another program's, names, references, what is left out, and bounds on their cost."""

import contextlib
import io
import math
import time
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import ProblemError
from ccm_opt.io.drawing import ImportedScene, ImportOptions, import_scene
from ccm_opt.io.svg import path_subpaths
from ccm_opt.io.svg_document import parse_transform

HEAD = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
)
BOX = '<rect width="1" height="1"/>'
NUMBER = st.floats(-5.0, 5.0).map(lambda x: round(x, 2))
RADIUS = st.floats(0.1, 5.0).map(lambda x: round(x, 2))
EXTREME = st.builds(lambda sign, exponent: sign * 10.0**exponent, st.sampled_from((-1, 1)), st.integers(-308, 308))
SOON = 2.0
"""CPU time in which a drawing loads or is refused [s]."""


def imported(tmp_path: Path, body: str, root: str = "") -> ImportedScene:
    """What a drawing of some elements gives."""
    path = tmp_path / "a.svg"
    path.write_text(f"<svg {HEAD} {root}>{body}</svg>")
    return import_scene(path, ImportOptions())


def names(scene: ImportedScene) -> list[str]:
    """The names of the obstacles."""
    return [obstacle.name for obstacle in scene.obstacles]


def reasons(scene: ImportedScene) -> dict[str, str]:
    """What was left out, and why."""
    return {item.what: item.reason for item in scene.drawing.left_out}


@st.composite
def path_data(draw: st.DrawFn) -> str:
    """Path data of a few commands of all kinds."""
    counts = {"L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2}
    words = [f"M{draw(NUMBER)},{draw(NUMBER)}"]
    for _ in range(draw(st.integers(1, 6))):
        kind = draw(st.sampled_from("LHVCSQTA"))
        if kind == "A":
            flags = f"{draw(st.booleans()):d} {draw(st.booleans()):d}"
            numbers = f"{draw(RADIUS)} {draw(RADIUS)} {draw(NUMBER) * 30} {flags} {draw(NUMBER)} {draw(NUMBER)}"
        else:
            numbers = " ".join(str(draw(NUMBER)) for _ in range(counts[kind]))
        words.append((kind if draw(st.booleans()) else kind.lower()) + numbers)
    return " ".join(words)


@settings(max_examples=100, deadline=None)
@given(data=path_data())
def test_path_data_draw_what_another_program_draws(data: str) -> None:
    """Points at equal shares of every segment, from svgpathtools, lie on our flattened path, and the ends agree."""
    others = pytest.importorskip("svgpathtools")
    try:
        theirs = others.parse_path(data)
    except AssertionError:  # of arcs between equal points, which it cannot draw
        reject()
    points = np.array([segment.point(t) for segment in theirs for t in np.linspace(0.0, 1.0, 9)])
    found = np.column_stack((points.real, points.imag))
    (subpath,) = path_subpaths(data)
    ours, closed = subpath.flattened(1e-4)
    ours = np.vstack((ours, ours[:1])) if closed else ours
    drawn = shapely.LineString(ours) if len(ours) > 1 else shapely.Point(ours[0])
    distances = shapely.distance(shapely.points(found), drawn)
    assert distances.max() < 2e-4 * (1.0 + np.abs(found).max())
    np.testing.assert_allclose(ours[-1], found[-1], atol=1e-9)


@given(
    calls=st.lists(
        st.one_of(
            st.tuples(st.just("matrix"), st.tuples(*[NUMBER] * 6)),
            st.tuples(st.sampled_from(["translate", "scale"]), st.tuples(NUMBER, NUMBER)),
            st.tuples(st.just("rotate"), st.one_of(st.tuples(NUMBER), st.tuples(NUMBER, NUMBER, NUMBER))),
            st.tuples(st.sampled_from(["skewX", "skewY"]), st.tuples(NUMBER)),
        ),
        max_size=4,
    )
)
def test_transforms_are_those_of_another_program(calls: list[tuple[str, tuple[float, ...]]]) -> None:
    """Any list of functions gives svgelements' matrix."""
    elements = pytest.importorskip("svgelements")
    text = " ".join(f"{name}({', '.join(map(str, values))})" for name, values in calls)
    theirs = elements.Matrix(text)
    expected = (theirs.a, theirs.b, theirs.c, theirs.d, theirs.e, theirs.f)
    np.testing.assert_allclose(parse_transform(text)[:2].T.ravel(), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("data", "corners"),
    [
        ("M1 1h2v2h-2z", [(1, -1), (3, -1), (3, -3), (1, -3)]),
        ("m1,1 2,0 0,2-2,0Z", [(1, -1), (3, -1), (3, -3), (1, -3)]),
        ("M1 1 3 1 3 3 1 3z", [(1, -1), (3, -1), (3, -3), (1, -3)]),
        ("M1.5.5.25 1e1 4-1z", [(1.5, -0.5), (0.25, -10), (4, 1)]),
    ],
)
def test_path_data_may_be_written_tightly(tmp_path: Path, data: str, corners: list[tuple[float, float]]) -> None:
    """Numbers may follow each other without a blank, and a move with several points draws lines."""
    (shape,) = imported(tmp_path, f'<path d="{data}"/>').obstacles
    assert shape.core.equals(shapely.Polygon(corners))


def test_the_flags_of_arcs_need_no_blank_behind_them(tmp_path: Path) -> None:
    """``a1 1 0 01-2 0`` is half a circle."""
    tight = imported(tmp_path, '<path d="M0 0a1 1 0 01-2 0z"/>').obstacles[0].core
    loose = imported(tmp_path, '<path d="M0 0 a 1,1 0 0,1 -2,0 z"/>').obstacles[0].core
    assert tight.equals(loose)
    assert shapely.area(tight) == pytest.approx(0.5 * math.pi, abs=2e-3)


def test_round_corners_and_ellipses_have_their_area(tmp_path: Path) -> None:
    """A rounded box lacks its four corners, an ellipse has π a b; one half axis alone stands for both."""
    body = '<rect width="6" height="4" rx="1"/><ellipse cx="20" rx="3" ry="1"/>'
    box, egg = (shapely.area(obstacle.core) for obstacle in imported(tmp_path, body).obstacles)
    assert box == pytest.approx(24.0 - (4.0 - math.pi), abs=5e-3)
    assert egg == pytest.approx(3.0 * math.pi, abs=5e-3)


def test_uses_and_layers_name_what_they_draw(tmp_path: Path) -> None:
    """A use gives its own name, to the parts of a group with theirs; ids of programs give way to the layer's name."""
    body = f"""<defs><path id="blade" d="M0 0h1v1z"/><g id="pump"><rect id="foot" width="1" height="1"/>{BOX}</g></defs>
        <g inkscape:label="stator"><use href="#blade" id="vane 1"/><use xlink:href="#blade" id="vane 2" x="3"/>
        <path id="path1234" d="M9 9h1v1z"/></g>
        <g inkscape:label="rotor"><use href="#pump" id="pump A"/><use href="#blade" id="use77"/></g>"""
    scene = imported(tmp_path, body)
    assert names(scene) == ["vane 1", "vane 2", "stator", "pump A foot", "pump A", "blade"]
    assert scene.drawing.layers == (("stator", 3), ("rotor", 3))


def test_symbols_and_nested_pictures_are_fitted(tmp_path: Path) -> None:
    """A view box is fitted into the size that the use or the nested picture gives it, centred unless it says else."""
    body = f"""<symbol id="s" viewBox="0 0 10 10"><rect id="r" width="10" height="10"/></symbol>
        <use href="#s" x="1" y="2" width="4" height="2" id="used"/>
        <svg x="5" y="5" width="2" height="2" viewBox="0 0 1 1">{BOX}</svg>"""
    used, nested = imported(tmp_path, body).obstacles
    assert used.core.equals(shapely.box(2, -4, 4, -2))
    assert nested.core.equals(shapely.box(5, -7, 7, -5))


def test_lengths_have_units_or_are_parts_of_the_picture(tmp_path: Path) -> None:
    """An inch is 96 units and half the width is half the view box; without a size per cent is refused by name."""
    box, half = imported(
        tmp_path, '<rect width="1in" height="25.4mm"/><rect width="50%" height="1"/>', 'viewBox="0 0 8 4"'
    ).obstacles
    np.testing.assert_allclose(shapely.bounds(box.core), (0, -96, 96, 0), rtol=1e-12)
    assert shapely.bounds(half.core)[2] == 4.0
    with pytest.raises(ProblemError, match="'plate': it has the length '50%'"):
        imported(tmp_path, '<rect id="plate" width="50%" height="1"/>')


@pytest.mark.parametrize(
    ("body", "what", "reason"),
    [
        ('<text id="note">x</text>', "text 'note'", "text is not an obstacle"),
        ("<image/>", "image", "images are not obstacles"),
        (f'<g id="guides" display="none">{BOX}{BOX}</g>', "g 'guides'", "hidden by display: none, with 2 shapes in it"),
        (f'<g visibility="hidden">{BOX}</g>', "rect", "hidden by visibility"),
        (f'<style>.ghost{{display:none}}</style><g class="ghost">{BOX}</g>', "g", "hidden by display: none, with 1"),
        (
            "<style>rect#a.b{visibility:hidden}</style>" + BOX.replace("<rect", '<rect id="a" class="c b"'),
            "rect 'a'",
            "hidden",
        ),
        (
            f"<defs>{BOX.replace('<rect', '<rect id=' + chr(34) + 'spare' + chr(34))}</defs>",
            "rect 'spare'",
            "an unused definition",
        ),
        (f'<clipPath id="c">{BOX}</clipPath>', "clipPath 'c'", "a clip path draws nothing"),
        ('<circle id="dot"/>', "circle 'dot'", "zero size"),
        ('<path id="none" d="M1 1"/>', "path 'none'", "zero size"),
        ('<rect id="r" width="1" height="1" clip-path="url(#c)"/>', "the clipping of 'r'", "kept whole"),
        ("<style>g rect{display:none}</style>", "style rule 'g rect'", "cannot be read"),
    ],
)
def test_everything_left_out_has_a_reason(tmp_path: Path, body: str, what: str, reason: str) -> None:
    """What becomes no obstacle is named with why."""
    scene = imported(tmp_path, body + '<circle id="seen" r="1"/>')
    assert "seen" in names(scene)
    assert reason in reasons(scene)[what]


@pytest.mark.parametrize(("width", "told"), [("4m", True), ("4 apples", True), ("4cm", False), ("100%", False)])
def test_a_width_in_no_unit_of_svg_is_told(tmp_path: Path, width: str, told: bool) -> None:
    """It looks like a scale, and is none."""
    scene = imported(tmp_path, BOX, f'width="{width}" viewBox="0 0 9 9"')
    assert (f'width="{width}"' in reasons(scene)) == told


@pytest.mark.parametrize(("thickness", "told"), [(0.0, True), (5.9, True), (6.1, False)])
def test_strokes_wider_than_walls_are_reported(tmp_path: Path, thickness: float, told: bool) -> None:
    """The width that the transform gives the widest line counts; closed shapes and unseen strokes do not."""
    path = tmp_path / "a.svg"
    path.write_text(
        f'<svg {HEAD}><g style="stroke: black; stroke-width: 2" transform="scale(3)">'
        '<line id="wall" x2="9"/><path d="M0 1H9" stroke-width="1"/><path d="M0 2H9" style="stroke: none"/>'
        '<rect y="5" width="1" height="1" style="stroke-width: 9"/></g></svg>'
    )
    found = reasons(import_scene(path, ImportOptions(wall_thickness=thickness)))
    assert any(what.startswith("stroke width of 'wall'") and "up to 6," in why for what, why in found.items()) == told
    assert len(found) == told


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<use href="#nosuch" id="stator1"/>', "use 'stator1': it refers to '#nosuch', which is not in the drawing"),
        ('<use href="other.svg#a"/>', "refers to 'other.svg#a' in another file"),
        ('<use id="u"/>', "use 'u': it has no href"),
        ('<g id="a"><use href="#a"/></g>', "refers to '#a', which contains itself"),
        ('<path id="p" d="L1 1"/>', "'p': it has path data that do not begin with a move"),
        ('<path id="p" d="M1 1L1"/>', "'p': it has path data with a command that has too few"),
        ('<path id="p" d="M1 1A1 1 0 2 0 3 3"/>', "'p': it has path data with a command .* invalid one"),
        ('<polygon id="p" points="1 2 3"/>', "'p': it has 3 coordinates"),
        ('<rect id="p" width="-1" height="1"/>', "'p': it is -1 wide"),
        ('<rect id="p" width="1em" height="1"/>', "'p': it has the length '1em'"),
        ('<g id="q" transform="twist(3)"><rect/></g>', r"g 'q': it has the transform 'twist\(3\)'"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(tmp_path: Path, body: str, message: str) -> None:
    """A missing obstacle would be worse than a refused drawing."""
    with pytest.raises(ProblemError, match=message):
        imported(tmp_path, body + BOX)


def test_all_unresolved_references_are_reported_at_once(tmp_path: Path) -> None:
    """Twelve of them: ten by name, and the number of the rest."""
    body = "".join(f'<use href="#no{k}" id="u{k}"/>' for k in range(12))
    with pytest.raises(ProblemError, match=r"use 'u0': .*use 'u9': .*and 2 more"):
        imported(tmp_path, body)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f'<svg xmlns="http://www.w3.org/2000/sv">{BOX}</svg>', "the namespace 'http://www.w3.org/2000/sv'; expected"),
        (f'<svg {HEAD} display="none">{BOX}</svg>', "left out: svg: hidden by display: none, with 1 shapes"),
        (f'<svg {HEAD} style="display:none">{BOX}</svg>', "hidden by display: none"),
        ("<html/>", "expected the outermost element svg, got html"),
    ],
)
def test_hidden_and_foreign_roots_say_why(tmp_path: Path, text: str, message: str) -> None:
    """A drawing of which nothing is seen is refused with the reason."""
    path = tmp_path / "a.svg"
    path.write_text(text)
    with pytest.raises(ProblemError, match=message):
        import_scene(path, ImportOptions())


def test_a_root_without_a_namespace_loads(tmp_path: Path) -> None:
    """What people write by hand often has none."""
    path = tmp_path / "a.svg"
    path.write_text(f"<svg>{BOX}</svg>")
    assert names(import_scene(path, ImportOptions())) == ["rect"]


def doubled(levels: int) -> str:
    """A group that uses another twice, and so on: 2 to the power of ``levels`` boxes."""
    groups = [f'<g id="u{k}"><use href="#u{k - 1}"/><use href="#u{k - 1}"/></g>' for k in range(1, levels + 1)]
    return f'<defs><g id="u0">{BOX}</g>{"".join(groups)}</defs><use href="#u{levels}"/>'


def entities(levels: int) -> str:
    """A document type whose entities hold each other ten times."""
    lines = [f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, levels)]
    return f'<!DOCTYPE svg [<!ENTITY e0 "lol">{"".join(lines)}]>'


USE_OF_P = "<use href='#p'/>"
HOSTILE = {
    "2¹⁶ uses": (f"<svg {HEAD}>{doubled(16)}</svg>", "draws more than"),
    "2⁴⁰ uses of nothing": (f"<svg {HEAD}>{doubled(40).replace(BOX, '')}</svg>", "draws more than"),
    "many uses of a long path": (
        f"<svg {HEAD}><path id='p' d='M0 0{'h1v1' * 5000}'/>{USE_OF_P * 20_000}</svg>",
        "more than 100000 points",
    ),
    "100 000 groups deep": (f"<svg {HEAD}>{'<g>' * 100_000}{'</g>' * 100_000}</svg>", "nested more than 200 deep"),
    "a path of 3 million points": (
        f'<svg {HEAD}><path id="p" d="M0 0{" 1 1" * 3_000_000}"/></svg>',
        "'p': it has path data of",
    ),
    "a polygon of 3 million points": (
        f'<svg {HEAD}><polygon points="{"0,0 " * 3_000_000}"/></svg>',
        "it has path data of",
    ),
    "a few points too many": (f'<svg {HEAD}><path d="M0 0{" 1 1" * 100_001}"/></svg>', "more than 100000 points"),
    "a long style": (f'<svg {HEAD}><rect style="{"a:b;" * 3_000_000}"/></svg>', "the attribute style"),
    "a long transform": (f'<svg {HEAD}><rect transform="{"scale(1)" * 1_000_000}"/></svg>', "the attribute transform"),
    "letters for a transform": (f'<svg {HEAD}><rect transform="{"a" * 20_000}"/></svg>', "which cannot be read"),
    "a number of a million digits": (f'<svg {HEAD}><path d="M0 0L{"1" * 1_000_000} 1"/></svg>', "not a finite number"),
    "blanks": (f'<svg {HEAD}><path d="M0 0{" " * 1_900_000}x"/></svg>', "neither a command nor a number"),
    "digits without end for an arc": (f'<svg {HEAD}><path d="M0 0A{"1" * 1_000_000}"/></svg>', "too few numbers"),
    "entities in entities": (f"{entities(9)}<svg {HEAD}>&e8;</svg>", "entities"),
    "a long entity, often": (
        f'<!DOCTYPE svg [<!ENTITY e "{"x" * 10_000}">]><svg {HEAD}><title>{"&e;" * 100_000}</title></svg>',
        "entities",
    ),
    "a few elements too many": (f"<svg {HEAD}>{'<g/>' * 300_001}</svg>", "more than 300000 elements"),
    "an unknown encoding": ('<?xml version="1.0" encoding="klingon"?><svg/>', "not readable as XML"),
}


@pytest.mark.drawn(6)
@pytest.mark.planning
@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_drawings_are_refused_soon(tmp_path: Path, case: str) -> None:
    """Whatever a small file expands to, and however long its parts are, it is refused in one sentence, and soon."""
    text, message = HOSTILE[case]
    path = tmp_path / "a.svg"
    path.write_text(text)
    began = time.process_time()
    with pytest.raises(ProblemError, match=message) as caught:
        import_scene(path, ImportOptions())
    # The bound is generous against what is measured, and nothing here depends on how fast the machine is.
    assert len(str(caught.value)) < 2000
    assert time.process_time() - began < 10.0 * SOON


@settings(max_examples=200, deadline=None)
@given(kind=st.sampled_from("LHVCSQTAlhvcsqta"), numbers=st.lists(EXTREME, min_size=7, max_size=7))
def test_numbers_near_the_ends_of_double_precision_load_or_are_refused(
    tmp_path_factory: pytest.TempPathFactory, kind: str, numbers: list[float]
) -> None:
    """Huge and tiny numbers in path data end in no warning and no error but a ProblemError."""
    if kind in "Aa":
        numbers[3:5] = [float(number > 0.0) for number in numbers[3:5]]
    counted = {"L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}[kind.upper()]
    written = " ".join(f"{number:g}" for number in numbers[:counted])
    with contextlib.suppress(ProblemError):
        imported(tmp_path_factory.mktemp("svg"), f'{BOX}<path d="M1 2L3 1{kind}{written}"/>')


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_mutated_drawings_load_or_are_refused(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Whatever is cut out, doubled or replaced in a drawing, nothing but obstacles or a ProblemError comes of it."""
    whole = (
        f'<svg {HEAD}><style>.a{{fill-rule:evenodd}}</style><g transform="translate(1,2) rotate(30)">'
        "<title>group</title>"
        '<path id="p" d="M0 0 C 1 2 3 4 5 6 L 7 1 Z M1 1 A 1 2 30 0 1 3 3 Q 1 2 4 4"/><rect x="1" y="1" '
        'width="0.5" height="0.3" rx="0.1"/><circle cx="2" cy="2" r="0.2"/><ellipse rx="0.2" ry="0.4"/><line y1="3" '
        'x2="1"/><polyline points="0,0 1,1 2,0"/></g><symbol id="s" viewBox="0 0 1 1"><rect width="1" height="1"/>'
        '</symbol><use href="#s" x="3" width="2" height="2"/></svg>'
    )
    text = whole
    for _ in range(data.draw(st.integers(1, 4))):
        begin = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(begin, min(begin + 20, len(text))))
        piece = data.draw(st.sampled_from(["", text[begin:end] * 2, "1e999", "-", "#", "<g>", "&", "nan", '"', "é"]))
        text = text[:begin] + piece + text[end:]
    path = tmp_path_factory.mktemp("svg") / "a.svg"
    path.write_text(text)
    try:
        scene = import_scene(path, ImportOptions())
    except ProblemError as error:
        assert io.StringIO(str(error)).readline().strip()  # noqa: PT017 - says something
    else:
        assert all(np.isfinite(shapely.bounds(obstacle.core)).all() for obstacle in scene.obstacles)


@pytest.mark.parametrize(
    ("head", "area"),
    [("<g>", 16.0), ('<g fill="none">', 12.0), ('<style>.c{stroke:red;fill:none}</style><g class="c">', 12.0)],
)
def test_outlines_within_outlines_are_holes_where_nothing_is_filled(tmp_path: Path, head: str, area: float) -> None:
    """Of a box in a box without fill the wall between them is solid; painted boxes are solid both."""
    boxes = '<rect width="4" height="4"/><path d="M1 1h2v2h-2z"/></g>'
    found = imported(tmp_path, head + boxes)
    assert shapely.union_all([obstacle.core for obstacle in found.obstacles]).area == area


def test_what_is_cut_or_covered_is_taken_whole_and_told(tmp_path: Path) -> None:
    """Clip paths and masks of shapes and groups, by attribute or style, are told by name."""
    cut = '<g id="panel" clip-path="url(#c)">' + BOX + '</g><rect id="lid" width="2" height="1" style="mask:url(#m)"/>'
    found = imported(tmp_path, cut)
    assert {"the clipping of 'panel'", "the masking of 'lid'"} == set(reasons(found))
    assert len(found.obstacles) == 2
