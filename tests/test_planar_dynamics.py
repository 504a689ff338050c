"""The dynamics of arms that stay in their plane: fewer operations, and the same numbers to the last bit."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.algorithms.arm_model import ArmModel, arm_model, in_plane_alone
from ccm_opt.dynamics.algorithms.in_plane import free, in_plane
from ccm_opt.dynamics.runtime.inverse_dynamics import DynamicsFunction, DynamicsKind
from ccm_opt.dynamics.simulation.controller import CompiledLoop
from ccm_opt.robot.base_axes import Feed
from tests.dynamics_arms import swan_neck
from tests.oracles.interpreted_function import InterpretedFunction
from tests.oracles.interpreted_loop import with_feed

LINKS = 7
SEEDS = st.integers(0, 2**32 - 1)


def _model(random: np.random.Generator, *, rotors: bool) -> ArmModel:
    """An arm of random masses, payload, friction, rotors and feed, in a plane in which gravity lies."""
    arm = replace(
        swan_neck(LINKS, varied=True),
        payload=random.uniform(0.0, 0.5),
        friction=random.uniform(0.0, 0.05, 3 * LINKS),
        rotor_inertia=random.uniform(1e-6, 1e-4, 3 * LINKS) if rotors else 0.0,
        feed=Feed(0.0, 0.1, 0.1) if random.integers(2) else None,
    )
    gravity = np.array([random.normal(), 0.0, random.normal()])
    return arm_model(arm, 10.0 * gravity)


def _planar(random: np.random.Generator, *shape: int) -> FloatArray:
    """Numbers of all revolutes of which those out of the plane are zero."""
    numbers = np.zeros((*shape, 3 * LINKS))
    numbers[..., 1::3] = random.uniform(-1.5, 1.5, (*shape, LINKS))
    return numbers


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, rotors=st.booleans(), kind=st.sampled_from(["inverse_dynamics", "forward_dynamics"]))
def test_planar_code_gives_the_same_bits(seed: int, rotors: bool, kind: DynamicsKind) -> None:
    """In the plane the shorter recursions give the full ones' results for bends and base, and 0 for what stands."""
    random = np.random.default_rng(seed)
    full = _model(random, rotors=rotors)
    planar = in_plane_alone(full)
    assert planar.structure.planar
    states = [_planar(random, 5) for _ in range(3)]
    feed = random.normal(size=5)
    wanted = DynamicsFunction(kind, full).with_feed(*states, feed)
    got = DynamicsFunction(kind, planar).with_feed(*states, feed)
    assert np.array_equal(got[0], wanted[0])
    assert np.array_equal(got[1], wanted[1])
    assert np.any(got[0][:, 1::3])

    interpreted = InterpretedFunction(kind, planar).many(*states, feed)
    assert np.allclose(interpreted[0], wanted[0], rtol=1e-9, atol=1e-9 * np.max(np.abs(wanted[0])))
    assert np.allclose(interpreted[1], wanted[1], rtol=1e-9, atol=1e-9 * np.max(np.abs(wanted[1])))


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, computed=st.booleans(), rotors=st.booleans(), share=st.floats(0.05, 20.0))
def test_planar_loop_gives_the_same_bits(seed: int, computed: bool, rotors: bool, share: float) -> None:
    """Under noise, brakes and limits that saturate, the shorter closed loop ends in the states of the full one."""
    random = np.random.default_rng(seed)
    plant = _model(random, rotors=rotors)
    believed = replace(plant, bodies=1.1 * plant.bodies)
    joints = 3 * LINKS
    kp, kd = (900.0, 60.0) if computed else (2.0, 0.02)
    numbers = {"step": 1e-4, "computed": computed, "kp": np.full(joints, kp), "kd": np.full(joints, kd)}
    numbers = with_feed(numbers | {"limit": np.full(joints, share)}, believed, (400.0, 40.0), 20.0 * share)
    state, reference = (
        np.dstack((_planar(random, n, 2 + k), random.normal(size=(n, 2 + k)))) for k, n in ((0, 1), (1, 9))
    )
    noise = 1e-3 * _planar(random, 9, 2)
    arguments = (state[0], reference, noise, int(random.integers(0, 2)))
    wanted = CompiledLoop(plant, believed, numbers).run(*arguments)
    plant, believed = in_plane_alone(plant), in_plane_alone(believed)
    got = CompiledLoop(plant, believed, numbers).run(*arguments)
    assert np.array_equal(got[0], wanted[0])
    assert np.array_equal(got[1], wanted[1])


def test_what_leads_out_of_the_plane_keeps_the_full_code() -> None:
    """Gravity across the plane, or axes of which a straight joint is singular, leave a model as it is."""
    across = arm_model(swan_neck(LINKS), np.array([0.0, 1e-9, -9.81]))
    assert in_plane_alone(across) is across
    other_axes = arm_model(swan_neck(LINKS, "zyz"), np.array([0.0, 0.0, -9.81]))
    assert in_plane_alone(other_axes) is other_axes


@settings(max_examples=60, deadline=None)
@given(numbers=st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6), known=st.integers(0, 2**6 - 1))
def test_known_numbers_change_no_bit(numbers: list[float], known: int) -> None:
    """Whatever numbers of an argument are known to be 0 or 1, a function has the same results where they are."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 3)
    terms = ca.vertcat(x * y, x[0] / (1.0 + x[0] * x[1] + y[1] ** 2), x[1] - y[2], -x[2] + y[0], 2 * x[1], ca.sin(y[0]))
    function = ca.Function("some", [x, y], [terms])
    choices = [float(number > 0.0) if known >> k & 1 else number for k, number in enumerate(numbers)]
    pattern = [choice if known >> k & 1 else None for k, choice in enumerate(choices)]
    reduced, (zero,) = in_plane(function, [tuple(pattern[:3]), tuple(pattern[3:])])
    wanted = np.array(function(choices[:3], choices[3:])).ravel()
    # Known numbers are taken as known, whatever is given in their place.
    given_numbers = [9.0 if known >> k & 1 else choice for k, choice in enumerate(choices)]
    got = np.array(reduced(given_numbers[:3], given_numbers[3:])).ravel()
    assert np.array_equal(got, wanted, equal_nan=True)
    assert all(value == 0.0 for value, each in zip(wanted, zero, strict=True) if each == 0.0)


def test_nothing_known_changes_nothing() -> None:
    """Where nothing is known the function has as many operations as before."""
    x = ca.SX.sym("x", 3)
    function = ca.Function("some", [x], [ca.vertcat(x[0] * x[1], x[1] / (x[1] * x[2]))])
    reduced, (zero,) = in_plane(function, [free(3)])
    assert reduced.n_instructions() == function.n_instructions()
    assert zero == free(2)
