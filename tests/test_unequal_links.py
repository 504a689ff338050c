"""Arms whose links differ: lengths, radii and limits of their own, in kinematics, files, plans and proofs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.io.mjcf_models import mjcf_text
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import problem_from_mapping
from ccm_opt.planning.baseline.hill_climbing_planner import HillClimbingPlanner
from ccm_opt.planning.surface_certificate import SpaceCertificate
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import joint_positions_3d, revolute_angles
from ccm_opt.robot.link_bodies import cylinder_inertia
from ccm_opt.robot.link_layout import Proportions
from ccm_opt.scene.contact_finder import SurfaceFinder, WallFinder, nearest_links
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup
from ccm_opt.scene.workspace import Workspace
from ccm_opt.verification.limits import check_bends
from ccm_opt.verification.selfcollision import far_along_arm, segment_distances
from ccm_opt.verification.wall_clearance import exposed_starts

from .space_arms import space_arm
from .test_export_models import load_mujoco

GRAVITY = np.array([0.0, 0.0, -9.81])


def unequal(arm: Arm, seed: int) -> Arm:
    """The arm with links of random proportions, as long as before."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.4, 1.8, arm.links)
    radii = np.sort(rng.uniform(0.3, 1.0, arm.links))[::-1]
    limits = np.ones(len(arm.bend_limits))
    return replace(arm, proportions=Proportions(lengths / lengths.mean(), radii / radii[0], limits))


def sections(*rows: dict[str, Any]) -> dict[str, Any]:
    """An arm of sections at the origin of space."""
    return {"sections": list(rows), "base": {"position": (0.0, 0.0, 0.0)}}


def posed(arm: dict[str, Any], goal: tuple[float, float, float] = (0.4, 0.2, 0.1), **obstacles: Any) -> Problem:
    """A problem of an arm in space among obstacles."""
    limits = {"velocity": 1.0, "acceleration": 4.0}
    return ccm_opt.make_problem("sections", arm=arm, obstacles=obstacles, limits=limits, goal={"position": goal})


@given(st.integers(0, 2**32 - 1), st.integers(2, 30))
@settings(max_examples=40, deadline=None)
def test_joints_lie_as_far_apart_as_links_are_long(seed: int, links: int) -> None:
    """In any pose, in the plane and in space; places along the arm are sums of the lengths."""
    rng = np.random.default_rng(seed)
    for plain in (space_arm(links), Arm.snake(length=0.1 * links, links=links + links % 2, radius=0.01)):
        arm = unequal(plain, seed)
        q = rng.uniform(-1.0, 1.0, len(arm.coordinates))
        steps = np.linalg.norm(np.diff(arm.joint_positions_at(q), axis=0), axis=1)
        np.testing.assert_allclose(steps, arm.lengths, atol=1e-12)
        np.testing.assert_allclose(np.diff(arm.joint_places), arm.lengths, atol=1e-12)
        assert arm.joint_places[-1] == pytest.approx(arm.length)
        mount = replace(arm, mount_length=float(rng.uniform(0.0, arm.length)))
        assert float(mount.free_shares @ mount.lengths) == pytest.approx(mount.mount_length)
        # A mount of whole links ends at a joint, however its length was rounded.
        for end in arm.joint_places[1:] * (1.0 + rng.uniform(-1e-15, 1e-15)):
            assert set(replace(arm, mount_length=float(min(end, arm.length))).free_shares) <= {0.0, 1.0}


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None)
def test_mujoco_knows_the_same_arm(seed: int) -> None:
    """Places of the joints and holding torques agree with MuJoCo's from our MJCF."""
    mujoco, model, data = load_mujoco(arm := unequal(space_arm(5), seed))
    q = np.random.default_rng(seed).uniform(-1.0, 1.0, 2 * arm.links)
    angles = revolute_angles(arm, q)
    data.qpos[:] = angles
    mujoco.mj_forward(model, data)
    bodies = [data.body(f"link{k + 1:02d}").xpos for k in range(arm.links)]
    np.testing.assert_allclose(arm.joint_positions_at(q)[:-1], bodies, atol=1e-12)
    np.testing.assert_allclose(joint_positions_3d(arm, angles)[-1], data.site("tip").xpos, atol=1e-12)
    assert "capsule" in mjcf_text(arm, "arm", GRAVITY)


def thick_anywhere(arm: Arm, seed: int) -> Arm:
    """Return an arm of unequal links, the thickest of which may be anywhere."""
    arm = unequal(arm, seed)
    assert arm.proportions is not None
    radii = np.random.default_rng(seed).permutation(arm.proportions.radii)
    return replace(arm, proportions=replace(arm.proportions, radii=radii))


@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
@settings(max_examples=40, deadline=None)
def test_distant_links_have_half_a_turn_of_the_thickest_between_them(seed: int, links: int) -> None:
    """And two links at least: no other pair counts, neither with the arm nor with the verifier nor with C."""
    arm = thick_anywhere(space_arm(links, radius=0.05), seed)
    places = arm.joint_places
    apart = [
        [j > i + 2 and places[j] - places[i + 1] >= np.pi * arm.radii[i : j + 1].max() for j in range(links)]
        for i in range(links)
    ]
    np.testing.assert_array_equal(apart, arm.distant_links)
    np.testing.assert_array_equal(apart, far_along_arm(arm))
    following = [[next((k for k in range(j, links) if row[k]), links) for j in range(links + 1)] for row in apart]
    np.testing.assert_array_equal(following, arm.next_self_pairs)


@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from((6, 16, 40)))
@settings(max_examples=40, deadline=None)
def test_links_of_any_radii_are_found_near_each_other(seed: int, thick_base: bool, links: int) -> None:
    """By the planners' searches in the plane and in space, and by those of samples."""
    rng = np.random.default_rng(seed)
    arm = thick_anywhere(Arm.snake(length=0.1 * links, links=links, radius=0.05), seed)
    if thick_base:
        # No link is far enough along the arm from the base to collide with it.
        proportions = Proportions(np.ones(links), np.repeat([1.0, 0.02], [1, links - 1]), np.ones(links))
        arm = replace(arm, radius=0.3 * arm.length, proportions=proportions)
    bends = rng.uniform(0.1, 0.9, links)
    points = arm.joint_positions(arm.headings(bends))
    first, second = arm.distant_pairs
    apart = segment_distances(points[first], points[first + 1], points[second], points[second + 1])
    gap = apart - arm.radii[first] - arm.radii[second]
    near = set(zip(first[gap < 0.1], second[gap < 0.1], strict=True))
    walls = Workspace(shapely.box(-9.0, -9.0, 9.0, 9.0), ()).flat_walls
    found = WallFinder(arm, walls, 0.0, 0.0, 0.1).find(points)
    assert set(zip(found.first, found.second, strict=True)) == near
    solid = replace(arm, base=np.zeros(3), direction=np.array([1.0, 0.0, 0.0]))
    flat = solid.joint_positions_at(np.stack((bends, np.zeros(links)), axis=1).ravel())
    nowhere = SurfaceTree.from_triangles(TriangleSoup.joined([]))
    found = SurfaceFinder(solid, nowhere, (), 0.0, 0.0, 0.1).near_links(flat, 0.1)
    assert set(zip(found.first, found.second, strict=True)) == near
    assert nearest_links(solid, flat[None], 9.0).gap[0] == pytest.approx(gap.min(initial=9.0))


@given(st.integers(0, 2**32 - 1), st.integers(1, 7))
@settings(max_examples=40, deadline=None)
def test_a_mount_that_ends_with_a_link_covers_it(seed: int, mounted: int) -> None:
    """Whatever is left by rounding, for the verifier too: the end of a thick link within the wall is not checked."""
    arm = unequal(Arm.snake(length=0.8, links=8, radius=0.01), seed)
    arm = replace(arm, mount_length=round(float(arm.lengths[:mounted].sum()), 15))
    assert arm.whole_mount_links == np.sum(exposed_starts(arm) == 1.0) == np.sum(arm.free_shares == 1.0) == mounted


@given(st.integers(0, 2**32 - 1), st.integers(1, 7))
@settings(max_examples=20, deadline=None)
def test_the_outer_part_of_an_arm_is_the_same_arm(seed: int, first: int) -> None:
    """Links and limits of the part are those of the whole, in the measures of the part."""
    whole = unequal(Arm.snake(length=0.8, links=8, radius=0.01), seed)
    part = whole.beyond(first)
    np.testing.assert_allclose(part.lengths, whole.lengths[first:])
    np.testing.assert_allclose(part.radii, whole.radii[first:])
    np.testing.assert_allclose(part.bend_limits, whole.bend_limits[first:])
    assert part.proportions is not None
    assert part.proportions.lengths.mean() == pytest.approx(1.0)
    assert part.proportions.radii.max() == part.proportions.limits.max() == 1.0


def test_locked_joints_cannot_turn_in_mujoco() -> None:
    """Every joint has a range there, since MuJoCo leaves a joint without one free."""
    arm = unequal(space_arm(5), 0)
    assert arm.proportions is not None
    limits = np.array([1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.5, 0.2, 0.0, 1.0])
    arm = replace(arm, proportions=replace(arm.proportions, limits=limits))
    _, model, _ = load_mujoco(arm)
    assert np.all(model.jnt_limited)
    bends = model.jnt_range.reshape(arm.links, 3, 2)[:, :2]
    np.testing.assert_allclose(bends[..., 1].ravel(), arm.bend_limits, atol=1e-5)
    np.testing.assert_allclose(bends[..., 0], -bends[..., 1])


def test_the_limit_of_the_arm_is_that_of_joints_that_bend() -> None:
    """Sections of locked joints do not count, nor does the first joint; at least one joint must bend."""
    row = {"links": 3, "link_length": 0.08, "radius": 0.02, "joint_limit_deg": 30}
    stiff = {**row, "joint_limit_deg": 80, "locked": [1, 2, 3]}
    arm = posed(sections({**row, "links": 1, "joint_limit_deg": 70}, row, stiff)).arm
    assert np.rad2deg(arm.joint_limit) == pytest.approx(30.0)
    np.testing.assert_allclose(np.rad2deg(arm.bend_limits[::2]), [360, 30, 30, 30, 0, 0, 0])
    with pytest.raises(ProblemFileError, match="all joints are locked"):
        posed(sections(stiff, stiff))


def test_a_joint_in_space_has_a_limit_a_bend() -> None:
    """In turn about z and y, as on most snake robots: a plan bends no joint about the other, and is read back."""
    row = {"links": 1, "link_length": 0.06, "radius": 0.02, "joint_limit_deg": [60, 0]}
    other = {**row, "joint_limit_deg": [0, 50]}
    problem = posed({**sections(*[row, other] * 6), "base_limit_deg": [90, 0]}, goal=(0.4, 0.3, 0.2))
    arm = problem.arm
    assert not arm.locked_joints.any()
    np.testing.assert_allclose(np.rad2deg(arm.bend_limits), [90, 0, 0, 50, *[60, 0, 0, 50] * 5])
    again = problem_from_mapping(problem_data(problem)).arm
    np.testing.assert_allclose(again.bend_limits, arm.bend_limits)
    solution = ccm_opt.solve(problem)
    bends = np.abs(solution.joints.angles).max(axis=0)[arm.coordinates.drive_numbers]
    assert np.all(bends[arm.bend_limits == 0.0] == 0.0)
    replaced = {**problem_data(problem), "start": {"joints_deg": [[0, 0], [5, 0], *[[0, 0]] * 10]}}
    with pytest.raises(ProblemFileError, match=r"start.joints_deg\[1\]\[0\]: 5° exceeds joint_limit_deg = 0"):
        problem_from_mapping(replaced)


def test_a_planar_joint_has_one_limit() -> None:
    """A pair is refused there."""
    row = {"links": 4, "link_length": 0.05, "radius": 0.01, "joint_limit_deg": [40, 40]}
    limits = {"velocity": 1.0, "acceleration": 4.0}
    with pytest.raises(ProblemFileError, match=r"arm\.sections\[0\]\.joint_limit_deg: expected one number"):
        ccm_opt.make_problem(
            "flat", arm={"sections": [row], "base": (0, 0)}, limits=limits, goal={"position": (0.1, 0.1)}
        )


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.booleans())
@settings(max_examples=40, deadline=None)
def test_the_verifier_holds_every_joint_to_its_own_limit(seed: int, links: int, in_space: bool) -> None:
    """A motion at all limits passes, and one that exceeds the limit of any one joint, locked or not, is refused."""
    rng = np.random.default_rng(seed)
    plain = space_arm(links) if in_space else Arm.snake(length=0.1 * links, links=links + links % 2, radius=0.01)
    limits = rng.uniform(0.2, 1.0, len(plain.bend_limits)) * (rng.random(len(plain.bend_limits)) < 0.7)
    arm = unequal(plain, seed)
    assert arm.proportions is not None
    arm = replace(arm, proportions=replace(arm.proportions, limits=limits))

    def passes(bends: FloatArray) -> bool:
        still = np.zeros((2, len(bends)))
        motion = JointTrajectory(np.array([0.0, 1e-3]), np.tile(bends, (2, 1)), still, still, arm.coordinates)
        return check_bends(arm, motion).passed

    at_limits = rng.choice([-1.0, 1.0], len(arm.bend_limits)) * arm.bend_limits
    assert passes(at_limits)
    beyond = at_limits.copy()
    joint = rng.integers(len(beyond))
    beyond[joint] += np.copysign(1e-6, beyond[joint])
    assert not passes(beyond)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_the_certificate_keeps_each_link_by_its_own_radius(seed: int) -> None:
    """What is proved to touch nothing keeps, at every sample, the radius of each link from balls and other links."""
    rng = np.random.default_rng(seed)
    arm = replace(unequal(space_arm(9, 0.08, radius=0.05), seed), mount_length=0.0)
    centres = rng.uniform(-0.7, 0.7, (6, 3))
    problem = posed(
        sections({"links": 2, "link_length": 0.1, "radius": 0.01, "joint_limit_deg": 40}),
        (0.1, 0.0, 0.0),
        **{f"ball {k}": {"sphere": {"center": c.tolist(), "radius": 0.05}} for k, c in enumerate(centres)},
    )
    certificate = SpaceCertificate(arm, SurfaceTree.from_triangles(problem.workspace.triangle_soup))
    start = rng.uniform(-0.5, 0.5, 2 * arm.links)
    end = start + rng.uniform(-0.1, 0.1, 2 * arm.links)
    if not certificate.safe(start, end):
        return
    first, second = arm.distant_pairs
    for share in np.linspace(0.0, 1.0, 21):
        points = arm.joint_positions_at(start + share * (end - start))
        assert np.all(from_balls(points, centres, 0.05) >= arm.radii - 1e-9)
        apart = segment_distances(points[first], points[first + 1], points[second], points[second + 1])
        assert np.all(apart >= arm.radii[first] + arm.radii[second] - 1e-9)


def from_balls(points: FloatArray, centres: FloatArray, radius: float) -> FloatArray:
    """Distance of each link's axis from balls, shape (links,)."""
    line = np.diff(points, axis=0)
    away = centres[:, None] - points[:-1]
    share = np.clip(np.einsum("bld,ld->bl", away, line) / np.sum(line**2, axis=1), 0.0, 1.0)
    return np.asarray(np.min(np.linalg.norm(away - share[..., None] * line, axis=2), axis=0) - radius)


EQUAL = {"links": 8, "link_length": 0.06, "radius": 0.01, "joint_limit_deg": 50}


def test_equal_sections_are_the_short_form() -> None:
    """Two sections alike give the arm of the short form, and so its plan."""
    halves = {**EQUAL, "links": 4}
    one, other = posed(sections(halves, halves)), posed({**EQUAL, "base": {"position": (0.0, 0.0, 0.0)}})
    assert problem_data(one) == problem_data(other)
    assert one.arm.proportions is None


def test_sections_are_read_and_written() -> None:
    """A taper becomes links of the greater radius; locked joints stay straight; what is written reads the same."""
    problem = posed(
        sections(
            {"links": 3, "link_length": 0.08, "radius": 0.03, "joint_limit_deg": 30, "mass": 0.3},
            {
                "links": 4,
                "link_length": 0.05,
                "radius": [0.02, 0.012],
                "joint_limit_deg": 45,
                "mass": 0.1,
                "locked": [2],
            },
        )
    )
    arm = problem.arm
    np.testing.assert_allclose(arm.lengths, [0.08] * 3 + [0.05] * 4)
    np.testing.assert_allclose(arm.radii, [0.03] * 3 + [0.02, 0.018, 0.016, 0.014])
    np.testing.assert_allclose(np.rad2deg(arm.bend_limits[::2]), [360, 30, 30, 45, 0, 45, 45])
    np.testing.assert_allclose(arm.masses, [0.3] * 3 + [0.1] * 4)
    again = problem_from_mapping(problem_data(problem)).arm
    for key in ("lengths", "radii", "bend_limits", "masses", "inertia_axial", "inertia_transverse"):
        np.testing.assert_allclose(getattr(again, key), getattr(arm, key), rtol=1e-14)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"links": 0}, r"arm\.sections\[0\]\.links"),
        ({"radius": -0.01}, r"arm\.sections\[0\]\.radius"),
        ({"radius": [0.02, -0.01]}, r"arm\.sections\[0\]\.radius"),
        ({"locked": [4]}, r"arm\.sections\[0\]\.locked"),
        ({"colour": "red"}, r"arm\.sections\[0\]\.colour"),
        ({"drive": "section"}, r"arm\.sections\[1\]\.drive: expected \"section\" for all sections or for none"),
        ({"mass": 0.2}, r"arm\.sections\[1\]: mass is missing"),
    ],
)
def test_a_bad_section_is_named_by_its_key(changes: dict[str, Any], told: str) -> None:
    """And nothing else is reported."""
    row = {"links": 3, "link_length": 0.08, "radius": 0.02, "joint_limit_deg": 30}
    with pytest.raises((ProblemFileError, ProblemError), match=told):
        posed(sections({**row, **changes}, row))


def test_keys_of_the_whole_arm_are_refused_beside_sections() -> None:
    """Lengths are said once."""
    row = {"links": 3, "link_length": 0.08, "radius": 0.02, "joint_limit_deg": 30}
    with pytest.raises((ProblemFileError, ProblemError), match=r"arm\.radius: not together with arm\.sections"):
        posed({**sections(row, row), "radius": 0.02})


def test_an_even_number_is_asked_of_equal_links_alone() -> None:
    """Sections may make an arm of an odd number of links."""
    assert posed(sections({**EQUAL, "links": 7})).arm.links == 7
    with pytest.raises((ProblemFileError, ProblemError), match="even number"):
        posed({**EQUAL, "links": 7, "base": {"position": (0.0, 0.0, 0.0)}})


@pytest.mark.drawn(6, of="whole plans")
@pytest.mark.planning
def test_a_thin_tip_goes_where_the_base_does_not_fit() -> None:
    """Through a slot narrower than the thickest section, and nothing is touched at any sample."""
    problem = posed(
        sections(
            {"links": 6, "link_length": 0.07, "radius": 0.03, "joint_limit_deg": 40},
            {"links": 9, "link_length": 0.04, "radius": [0.012, 0.008], "joint_limit_deg": 45},
        ),
        (0.6, 0.1, 0.0),
        below={"box": [[0.5, -0.6, -0.6], [0.53, 0.6, -0.013]]},
        above={"box": [[0.5, -0.6, 0.013], [0.53, 0.6, 0.6]]},
    )
    turned = replace(problem.start, bends=np.vstack(([1.4, 0.0], np.zeros((problem.arm.links - 1, 2)))))
    solution = ccm_opt.solve(replace(problem, start=turned), explain=False)
    tree = SurfaceTree.from_triangles(problem.workspace.triangle_soup)
    for points in solution.joint_positions[:: max(1, len(solution.joint_positions) // 200)]:
        away = tree.distances(np.stack((points[:-1], points[1:]), axis=1), 1.0)
        assert np.all(away[1:] >= problem.arm.radii[1:] - 1e-6)


def test_the_papers_planner_refuses_unequal_links() -> None:
    """It says so, instead of taking the links to be equal."""
    problem = posed(sections({**EQUAL, "links": 3}, {**EQUAL, "links": 4, "link_length": 0.05}))
    with pytest.raises(ProblemError, match="equal links"):
        HillClimbingPlanner().plan(problem)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_the_reach_of_a_tapered_arm_is_mapped() -> None:
    """Many cells are reached, none of which is proved to be out of reach."""
    arm = sections({**EQUAL, "links": 2, "radius": 0.03}, {**EQUAL, "links": 4, "radius": [0.012, 0.004]})
    found = ccm_opt.reach_map(posed(arm, goal=(0.2, 0.1, 0.1)), step=0.25)
    assert found.reachable.sum() > 10
    assert not np.any(found.reachable & found.proved)


def test_a_misspelt_key_of_sections_is_the_only_defect() -> None:
    """What sections stand for is not missing as well."""
    row = {"links": 4, "link_length": 0.05, "radius": 0.01, "joint_limit_deg": 40}
    arm = {"section": [row], "base": {"position": (0.0, 0.0, 0.0)}}
    with pytest.raises(ProblemFileError) as error:
        posed(arm)
    assert [issue.key for issue in error.value.issues] == ["arm.section"]


def test_a_contact_tolerance_beside_sections_is_refused_by_its_key() -> None:
    """As for equal links, by the length of all sections."""
    row = {"links": 4, "link_length": 0.05, "radius": 0.01, "joint_limit_deg": 40}
    data = problem_data(posed(sections(row, {**row, "radius": 0.008})))
    with pytest.raises(ProblemFileError, match=r"verification\.contact_tolerance: expected at most a thousandth"):
        problem_from_mapping({**data, "verification": {"contact_tolerance": 0.5e-3}})
    problem_from_mapping({**data, "verification": {"contact_tolerance": 0.3e-3}})


def test_cylinders_of_another_length_are_cylinders() -> None:
    """Their moments of inertia are those of their own mass and length."""
    arm = space_arm(40)
    axial, transverse = cylinder_inertia(arm.masses, 0.02, arm.lengths)
    coarse = replace(arm, inertia_axial=axial, inertia_transverse=transverse).with_links(24)
    own = cylinder_inertia(coarse.masses, 0.02, coarse.lengths)
    np.testing.assert_allclose((coarse.inertia_axial, coarse.inertia_transverse), own, rtol=1e-12)
