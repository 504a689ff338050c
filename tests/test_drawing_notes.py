"""What commands tell of a drawing: a summary, what was left out and why, a warning where it does not fit the arm."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.cli.loading import TIMES
from ccm_opt.core.errors import ProblemFileError
from ccm_opt.io.place_rules import outside_message
from ccm_opt.io.reading import load_problem

from .conftest import SMALL_PROBLEM
from .test_cli_output import run

ROW = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape">
<defs><path id="blade" d="M0,0 L12,-16 L60,-30 L2,5 Z"/></defs>
<g inkscape:label="stator">{vanes}</g><g inkscape:label="rotor"><circle id="hub" cx="-100" cy="80" r="20"/></g>
<text id="title">no obstacle</text><g id="guides" display="none"><rect width="1" height="1"/></g></svg>"""
VANES = "".join(f'<use href="#blade" x="60" y="{-500 + 48 * k}" id="vane {k + 1}"/>' for k in range(5))


def problem_file(tmp_path: Path, scale: float, vanes: str = VANES, arm: str = "links = 4") -> Path:
    """The small problem with a row of blades beside it."""
    (tmp_path / "row.svg").write_text(ROW.format(vanes=vanes))
    path = tmp_path / "problem.toml"
    text = SMALL_PROBLEM.replace("[workspace]\n", f'[workspace]\nfile = "row.svg"\nscale = {scale}\n')
    path.write_text(text.replace("links = 4", arm))
    return path


def test_a_summary_says_how_many_how_large_and_where(tmp_path: Path) -> None:
    """Six obstacles with their box in the file's unit, the layers, and what was left out with the reason."""
    done = run("describe", problem_file(tmp_path, 0.001))
    lines = done.stdout.splitlines()
    assert lines[0] == f"row.svg: 6 obstacles, 0.24 {TIMES} 0.63 m, from (-0.12, -0.1) to (0.12, 0.53) m"
    assert lines[1] == "  layers: stator (5), rotor (1)"
    assert lines[2] == "  left out: text 'title': text is not an obstacle"
    assert lines[3] == "  left out: g 'guides': hidden by display: none, with 1 shapes in it"
    assert not done.stderr


def test_programs_are_told_of_the_drawing(tmp_path: Path) -> None:
    """The document has the number, the box in metres, the layers, and everything left out."""
    document = json.loads(run("describe", problem_file(tmp_path, 0.001), "--json").stdout)
    drawing = document["results"][0]["drawing"]
    assert (drawing["file"], drawing["obstacles"]) == ("row.svg", 6)
    assert drawing["box"] == pytest.approx([-0.12, -0.1, 0.12, 0.53])
    assert [item["what"] for item in drawing["left_out"]] == ["text 'title'", "g 'guides'"]


@pytest.mark.parametrize(
    ("size", "scale", "warned"),
    [
        ("240mm", 0.001, False),
        ("24cm", 0.001, False),
        ("240mm", 1.0, True),
        ("240mm", 0.00026, True),
        ("240", 1.0, False),
    ],
)
def test_a_drawing_read_at_another_size_than_it_states_is_warned_of(
    size: str, scale: float, warned: bool, tmp_path: Path
) -> None:
    """A page of 240 units that states a width of 240 mm has units of a millimetre, whatever the problem's scale."""
    path = problem_file(tmp_path, scale)
    drawing = tmp_path / "row.svg"
    drawing.write_text(ROW.format(vanes=VANES).replace("<svg ", f'<svg width="{size}" viewBox="0 0 240 630" ', 1))
    told = run("describe", path).stderr
    assert ("one unit of row.svg is 1 mm by the size or unit that it states" in told) == warned
    assert ('workspace.units = "file" would give it the stated size' in told) == warned


def test_long_lists_are_cut_unless_asked(tmp_path: Path) -> None:
    """Ten things that were left out are listed, and the number of the rest; --verbose lists all."""
    path = problem_file(tmp_path, 0.001, VANES + "<text/>" * 30)
    assert run("describe", path).stdout.count("left out:") == 10
    assert "and 22 more left out" in run("describe", path).stdout
    assert run("describe", path, "--verbose").stdout.count("left out:") == 32


@pytest.mark.parametrize(("scale", "word"), [(1.0, "larger"), (2e-6, "smaller"), (1000.0, "larger")])
def test_a_scene_that_does_not_fit_the_arm_is_warned_of(tmp_path: Path, scale: float, word: str) -> None:
    """Millimetres taken for metres, or the other way round, are warned of on standard error and in the document."""
    path = problem_file(tmp_path, scale)
    done = run("describe", path)
    assert f"times {word} than the arm's" in done.stderr
    assert "workspace.scale" in done.stderr
    document = json.loads(run("describe", path, "--json").stdout)
    assert word in document["results"][0]["warnings"][0]


def test_the_warning_stands_beside_defects_too(tmp_path: Path) -> None:
    """Where the file has other defects as well, which a wrong scale often brings, the scale is named."""
    with pytest.raises(ProblemFileError, match="times larger than the arm's") as caught:
        load_problem(problem_file(tmp_path, 1.0, arm="links = 4\nmasses = [1.0]"))
    assert {issue.key for issue in caught.value.issues} >= {"workspace.scale", "arm.masses"}


def test_an_unresolved_reference_is_an_error_with_key_and_line(tmp_path: Path) -> None:
    """A blade that is not there would be a missing obstacle: bad input, by its name."""
    done = run("describe", problem_file(tmp_path, 0.001, VANES + '<use href="#nosuch" id="vane 6"/>'))
    assert done.exit_code == 2
    assert "line 5: workspace.file: row.svg: use 'vane 6': it refers to '#nosuch'" in done.stderr


def test_names_of_uses_are_those_of_obstacles(tmp_path: Path) -> None:
    """Each blade goes by the name of its use."""
    names = [obstacle.name for obstacle in load_problem(problem_file(tmp_path, 0.001)).workspace.obstacles]
    assert names == ["post", "vane 1", "vane 2", "vane 3", "vane 4", "vane 5", "hub"]


def test_a_drawing_wholly_outside_the_room_is_an_error(tmp_path: Path) -> None:
    """Both boxes are told with the key path and the line, and the offset that is told brings the drawing in."""
    path = problem_file(tmp_path, 0.001)
    path.write_text(path.read_text().replace("scale =", "offset = [5, 5]\nscale ="))
    with pytest.raises(ProblemFileError, match=r"line 5: workspace\.file: row\.svg lies entirely outside") as caught:
        load_problem(path)
    assert "it spans (4.88, 4.9) to (5.12, 5.53) m, the workspace (-1, -1) to (1, 1) m" in str(caught.value)
    found = re.search(r"workspace\.offset = (\[.*?\])", str(caught.value))
    assert found is not None
    path.write_text(path.read_text().replace("[5, 5]", found[1]).replace("[0.0, 0.0]", "[-0.9, -0.9]"))
    assert load_problem(path).drawing is not None


@given(
    scale=st.sampled_from([1e-3, 1e3, 1.0 / 25.4, 25.4]),
    low=st.tuples(st.floats(-0.9, 0.0), st.floats(0.1, 0.2)),
    size=st.floats(0.1, 0.5),
)
def test_a_scale_that_is_off_by_a_unit_is_told(scale: float, low: tuple[float, float], size: float) -> None:
    """Of a file that would fit but for a factor of a thousand or of an inch, that factor is told."""
    room = np.array([[-1.0, 0.05], [1.0, 1.0]])
    box = np.array([low, np.add(low, size)]) / scale
    keys = "workspace.scale workspace.offset"
    told = outside_message("a.dxf", box, np.zeros(2), room, "m", scale=2.0, keys=keys)
    assert f"workspace.scale = {2.0 * scale:.6g} would" in told


def test_a_base_inside_an_outline_of_a_drawing_is_told_of_the_key(tmp_path: Path) -> None:
    """The outline is most likely the room: with the key it is, and the base may stand in it."""
    path = problem_file(tmp_path, 0.01)
    (tmp_path / "row.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><rect x="-90" y="-90" width="180" height="180"/></svg>'
    )
    with pytest.raises(ProblemFileError, match=r'set workspace\.closed = "room"'):
        load_problem(path)
    path.write_text(path.read_text().replace("scale =", 'closed = "room"\nscale ='))
    workspace = load_problem(path).workspace
    assert workspace.dimension == 2
    assert workspace.boundary.bounds == pytest.approx((-0.9, -0.9, 0.9, 0.9))
    assert [obstacle.name for obstacle in workspace.obstacles] == ["post"]
    path.write_text(path.read_text().replace("bounds = [-1.0", "bounds = [-0.5"))
    with pytest.raises(ProblemFileError, match=r"workspace\.closed.*leave bounds out"):
        load_problem(path)
    path.write_text(re.sub(r"(bounds|closed) = .*\n", "", path.read_text()))
    with pytest.raises(ProblemFileError, match=r'workspace: expected exactly one of .*, or closed = "room"'):
        load_problem(path)


def test_obstacles_outside_the_room_are_warned_of(tmp_path: Path) -> None:
    """A disc that is wholly outside is named; one that sticks out is not."""
    path = tmp_path / "problem.toml"
    far = '[[workspace.obstacles]]\nname = "far"\ncircle = { center = [9, 9], radius = 0.1 }\n'
    out = '[[workspace.obstacles]]\nname = "out"\ncircle = { center = [1, 1], radius = 0.1 }\n'
    path.write_text(SMALL_PROBLEM.replace("[arm]", far + out + "[arm]"))
    done = run("describe", path)
    assert "obstacles entirely outside the workspace: 'far'" in done.stderr
    assert "'out'" not in done.stderr
