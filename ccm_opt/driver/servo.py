"""Servo control: the tip follows a hand at a fixed rate, and certified braking to rest is held ready at all times."""

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ccm_opt.core.arguments import expect, expect_that, expect_vector, is_number
from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.length_words import short_length, words_in
from ccm_opt.core.progress import Stages
from ccm_opt.core.threads import on_one_thread
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.solution_assembly import draft_solution
from ccm_opt.driver.verified_plan import TermResults, VerifiedPlan, verified
from ccm_opt.dynamics.retiming.motion_limits import DriveEffort
from ccm_opt.dynamics.retiming.timed_path import TimedPath
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.planning.clamped_base import with_clamped_base
from ccm_opt.planning.ends import refuse_ends, resolve_ends
from ccm_opt.planning.link_space import nearest_curves
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.planning.passage_widths import MARGINS
from ccm_opt.planning.plane_in_space import needs_space
from ccm_opt.planning.planner import MotionPlanner
from ccm_opt.planning.pose import Pose
from ccm_opt.planning.section_map import unknowns_through
from ccm_opt.planning.servo_state import Cut, ServoState, TipVelocity, knot_values, spline_values
from ccm_opt.planning.servoing import TipServo
from ccm_opt.planning.space_task import space_task
from ccm_opt.planning.step import StepperOf
from ccm_opt.planning.tool_problem import own_coordinates, problem_with_tool_links
from ccm_opt.problem import JointPose, Limits, Problem, TipGoal
from ccm_opt.problem.solution import JointPath, JointTrajectory, Solution
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import revolute_angles

_SHORTEST = 1e-4
"""Shortest duration of a tick [s]: the motion to rest has a control point a tick."""
_LONGEST = 0.05
"""Longest duration of a tick [s]."""
_SAMPLE = 5e-3
"""Longest time between samples of a recorded motion [s], as in all plans."""
_LOST = 0.01
"""Part of the commanded speed by which the tip's velocity or angular velocity may differ without a reason."""
_SPARE = 0.01
"""Certified gap beyond contact in space, in nominal links: larger than for plans, so that chords of the motion, which
deviates from them by up to half of it, are long. Heuristic."""
_DEPTH = 3
"""Number of bisections of certificates of ticks in the plane. Heuristic: refusals that cost more come too late."""
_FIRM = 0.2
"""Fraction of a gap's shortfall from the planning margin that the arm makes good until it rests. Heuristic."""
_EFFORT_RESERVE = 0.98
"""Fraction of the usable efforts that the samples of a motion may take, since efforts vary between samples."""
_KEYFRAMES = 200
"""Largest number of keyframes of a recorded motion."""
_TURNED = 0.3
"""Largest turn of the tip towards a commanded direction until the arm rests [rad]. Heuristic."""
_ARRIVED = 1e-3
"""Distance from the target, in nominal links, and angle [rad], within which the arm comes to rest. Heuristic."""
_WITHOUT_NUMBERS = {
    "stretched": "the arm is stretched, so that hardly any joint moves the tip that way",
    "guide tube": "{} has to be straight until it has left the guide tube",
    "turn": "a link would turn too fast to be stopped in time",
    "unsolved": "no motion was found that keeps all limits; the arm goes on with its braking",
}
"""Reasons in words, by kind, with the name of what is concerned."""
_Efforts: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], Cut | None]


@contextmanager
def _uncollected() -> Iterator[None]:
    """Keep the garbage collector from running in a block: looking through all objects of a program takes many ticks."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@dataclass(frozen=True)
class Twist:
    """Commanded velocity of the tip.

    Attributes:
        linear: velocity of the tip, shape (2,) or (3,) [m/s].
        angular: angular velocity of the last link: in the plane a number, counter-clockwise, in space shape (3,)
            [rad/s]; None if the tip may turn as it likes.
    """

    linear: Sequence[float] | FloatArray
    angular: float | Sequence[float] | FloatArray | None = None


@dataclass(frozen=True)
class ServoStep:
    """State of the arm at the end of a tick, to be commanded until then.

    Attributes:
        time: time since the beginning of the motion [s].
        positions: coordinates of the arm, shape (c,) [rad, m].
        velocities: their velocities, shape (c,) [rad/s, m/s].
        accelerations: their accelerations, shape (c,) [rad/s², m/s²].
        lost: difference of the tip's velocity from the command, as a fraction of the commanded speed or, if greater, of
            the present one; 0 if the tip is to stand still.
        lost_turn: likewise of its angular velocity; 0 if that is not commanded.
        reasons: what kept the tip from following the command, with by how much; empty if it follows.
    """

    time: float
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    lost: float = 0.0
    lost_turn: float = 0.0
    reasons: tuple[str, ...] = ()


@dataclass
class Servo:
    """Controller of the tip by hand: ``step`` is called at a fixed rate with a velocity or a pose of the tip.

    The whole arm keeps clear of obstacles and of itself and within its limits. Every tick is certified between its
    ends, together with a motion that brakes the arm to rest afterwards; this motion is held in ``braking``, so that an
    arm whose next command is late can always stop. Goals of the problem are not used::

        servo = ccm_opt.Servo(ccm_opt.load_problem("problems/space/borescope.toml"))
        step = servo.step(ccm_opt.Twist((0.05, 0.0, 0.0)))
        print(step.positions, step.velocities, step.reasons)
        servo.brake()
        servo.solution().save("runs")

    Attributes:
        problem: the problem: arm, limits, workspace and the start from which the motion begins.
        period: duration of a tick, from 0.0001 to 0.05 [s].
        settings: settings of all stages of planning.

    Raises:
        ProblemError: the start is in contact, or the problem has limits that servo control does not support.
        UnreachableGoal: the start is in contact, in the plane.
    """

    problem: Problem
    period: float = 0.01
    settings: Settings = DEFAULT_SETTINGS
    _arm: Arm = field(init=False, repr=False)
    _metres: float = field(init=False, repr=False)
    _engine: TipServo = field(init=False, repr=False)
    _state: ServoState = field(init=False, repr=False)
    _controls: list[FloatArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        Problem.expected(self.problem)
        fits = is_number(self.period) and _SHORTEST <= self.period <= _LONGEST
        expect_that(lambda: fits, self.period, f"a period from {_SHORTEST} to {_LONGEST} s")
        expect(self.settings, Settings, "ccm_opt.Settings for settings=")
        _refuse_unsupported(self.problem)
        problem = _ending_at(self.problem, self.problem.start)
        with on_one_thread(), words_in(self.problem.length_unit):
            prepared = (
                _in_space(problem, self.settings) if problem.dimension == 3 else _in_plane(problem, self.settings)
            )
        self._arm, stepper, v, spare, limits, self._metres = prepared
        self._engine = TipServo(
            curve=stepper.space,
            limits=stepper.limits,
            rates=limits.of_coordinates(self._arm.coordinates).rates_within(problem.planner.effort_share),
            spare=spare,
            period=self.period,
            depth=stepper.settings.step.proof_depth or _DEPTH,
            efforts=_efforts(problem, self._in_metres),
        )
        self._state = self._engine.at_rest(v)
        self._controls = list(self._state.controls)
        still = self._state.controls[:1]
        weak = self._engine.efforts and self._engine.efforts(still, np.zeros_like(still), np.zeros_like(still))
        if weak:
            raise ProblemError(f"the start cannot be held still: {self._words(weak)}")

    # ------------------------------------------------------------ driving
    @_uncollected()
    def step(self, command: Twist | TipGoal) -> ServoStep:
        """Move on by one tick after a command, and return the state of the arm at its end.

        Python's garbage collector does not run meanwhile.

        Args:
            command: velocity that the tip shall have, or place (and direction) to which it shall go.

        Raises:
            ProblemError: the command does not fit the arm.
        """
        pose = self._engine.curve.pose(self._state.unknowns[1])
        wanted = self._velocity(command, pose)
        before = self._state
        self._state, cuts = self._engine.stepped(before, pose, wanted)
        self._controls.append(self._state.controls[-1])
        if wanted.at_rest:
            return self._now((0.0, 0.0), ())
        lost = self._engine.lost(before, pose, wanted, self._state.unknowns[1] - self._state.unknowns[0])
        with words_in(self.problem.length_unit):
            reasons = tuple(self._words(cut) for cut in cuts) if max(lost) > _LOST else ()
        return self._now(lost, reasons)

    def brake(self) -> JointTrajectory:
        """Move on along the held braking until the arm rests, and return that motion, sampled at every tick."""
        motion = self.braking
        while self._state.moving:
            self._state = self._state.continued()
            self._controls.append(self._state.controls[-1])
        return motion

    @property
    def braking(self) -> JointTrajectory:
        """The certified motion from now to rest, sampled at every tick; a single sample at rest."""
        controls = self._state.to_rest()
        positions, velocities, accelerations = map(self._in_metres, knot_values(controls, self.period))
        time = np.asarray(self.period * np.arange(len(positions)), dtype=np.float64)
        return JointTrajectory(time, positions, velocities, accelerations, self.problem.arm.coordinates)

    @property
    def moving(self) -> bool:
        """Whether the arm moves, or is about to."""
        return self._state.moving

    @property
    def ticks(self) -> int:
        """Number of ticks since the start."""
        return len(self._controls) - 3

    def _now(self, lost: tuple[float, float], reasons: tuple[str, ...]) -> ServoStep:
        controls = np.vstack((self._state.controls, self._state.controls[-1:]))
        place, velocity, gain = (self._in_metres(each)[0] for each in spline_values(controls, self.period, 0.0))
        return ServoStep(self.period * self.ticks, place, velocity, gain, *lost, reasons)

    # ------------------------------------------------------------ commands
    def _velocity(self, command: Twist | TipGoal, pose: Pose) -> TipVelocity:
        """Return the velocity of the tip that a command asks for, in units of planning.

        Raises:
            ProblemError: the command does not fit the arm.
        """
        expect(command, (Twist, TipGoal), "a ccm_opt.Twist or ccm_opt.TipGoal")
        d = self.problem.dimension
        if isinstance(command, Twist):
            linear = _vector(command.linear, d, "a velocity")
            if command.angular is None:
                return TipVelocity(linear / self._metres)
            about = [command.angular] if d == 2 and is_number(command.angular) else command.angular
            return TipVelocity(linear / self._metres, _vector(about, 2 * d - 3, "an angular velocity"))
        if command.path is not None or command.via or command.look_at is not None:
            raise ProblemError("servo control follows a position and a direction; leave out path, via and look_at")
        unit, seconds = self._engine.curve.nominal_length, self._engine.seconds_to_rest
        # The tip is at its target when the arm, braked from now on, rests.
        away = _vector(command.position, d, "a position") / self._metres - pose.tip
        turn, axes = np.zeros(1), None
        if command.direction is not None:
            direction = _vector(command.direction, d, "a direction")
            expect_that(lambda: bool(np.any(direction)), command.direction, "a direction other than zero")
            frame = pose.frames[-1]
            turn = _turn_onto(frame, direction / np.linalg.norm(direction))
            axes = None if d == 2 else frame[:, 1:].T
        far, turned = float(np.linalg.norm(away)) / unit, float(np.linalg.norm(turn))
        if max(far, turned) < _ARRIVED:
            return TipVelocity(np.zeros(d))
        linear = away / max(far, 1.0) / seconds
        if command.direction is None:
            return TipVelocity(linear)
        return TipVelocity(linear, turn / max(turned / _TURNED, 1.0) / seconds, axes)

    def _words(self, cut: Cut) -> str:
        """Return the reason why a tick does not follow its command in words."""
        if cut.kind in {"contact", "clearance", "certificate"}:
            near = f"{cut.name}: gap {short_length(cut.value * self._metres)}" if cut.name else "nothing near"
            before = {"certificate": "not certified; ", "clearance": "the arm keeps away; "}
            return f"{before.get(cut.kind, '')}{near}"
        if cut.kind in _WITHOUT_NUMBERS:
            return _WITHOUT_NUMBERS[cut.kind].format(cut.name)
        angle = cut.unit.startswith("rad")
        value, limit = ((np.rad2deg(x) if angle else x * self._metres) for x in (cut.value, cut.limit))
        if cut.kind == "effort":
            return f"{cut.name}: {cut.value:.0%} of its usable effort"
        unit = cut.unit.replace("rad", "°") if angle else cut.unit
        # A motion that would exceed the limit is not taken.
        wanted = "would be " if abs(value) > abs(limit) else ""
        return f"{cut.kind} of {cut.name}: {wanted}{value:.4g} of {limit:.4g} {unit}"

    @cached_property
    def _own(self) -> tuple[IntArray, FloatArray]:
        """Indices of the arm's own coordinates among those of planning, and their units there, each (c,) [m, rad]."""
        lengths = np.array(self.problem.arm.coordinates.units) == "m"
        return np.flatnonzero(own_coordinates(self._arm)), np.where(lengths, self._metres, 1.0)

    def _in_metres(self, values: FloatArray) -> FloatArray:
        """Return the coordinates (m, c) of the arm itself, with lengths in metres, from those of planning."""
        own, units = self._own
        return np.asarray(values[:, own] * units)

    def _places(self, values: FloatArray) -> FloatArray:
        """Return configurations (m, c) of the arm itself in metres, within its limits in spite of rounding."""
        arm = self.problem.arm
        return np.clip(self._in_metres(values), arm.lower_limits, arm.upper_limits)

    # ------------------------------------------------------------ the motion as a plan
    @on_one_thread()
    def solution(self) -> Solution:
        """Return the motion driven so far, and the braking to rest after it, as a verified plan.

        The goal of its problem is the configuration in which the arm comes to rest. Clearance over time, tolerance and
        simulation are left out, since a motion may be long.

        Raises:
            ProblemError: nothing was driven yet.
            VerificationError: the verifier rejects the motion.
        """
        if self.ticks == 0:
            raise ProblemError("there is no motion yet: call step before")
        controls = np.vstack((self._controls, self._state.to_rest()[3:]))
        stages = Stages()
        with words_in(self.problem.length_unit), stages("servo control"):
            trajectory = self._trajectory(controls)
            end = JointPose.from_configuration(trajectory.positions[-1].copy(), self.problem.arm.coordinates)
            problem = _ending_at(self.problem, end)
            joints = joint_states(problem.arm, trajectory, InverseDynamics(problem.arm, problem.simulation.gravity))
        with words_in(self.problem.length_unit):
            with stages("verification"):
                checks = verified(problem, trajectory, joints, self.settings.verification)
            return draft_solution(
                problem, VerifiedPlan(self._path(controls), trajectory, joints, checks, TermResults()), stages
            )

    def save(self, folder: str | Path) -> Path:
        """Write the motion driven so far as a plan into a folder, as ``Solution.save`` does, and return its folder.

        Raises:
            ProblemError: nothing was driven yet.
            VerificationError: the verifier rejects the motion.
        """
        return self.solution().save(folder)

    def _trajectory(self, controls: FloatArray) -> JointTrajectory:
        """Return the motion with control points (m + 3, c), sampled as finely as it is certified."""
        parts = np.maximum(self._engine.parts(controls), int(np.ceil(self.period / _SAMPLE)))
        time: list[FloatArray] = []
        states: list[tuple[FloatArray, ...]] = []
        for count in np.unique(parts):
            spans = np.flatnonzero(parts == count)
            for share in np.arange(count) / count:
                time.append(self.period * (spans + share))
                states.append(tuple(each[spans] for each in spline_values(controls, self.period, share)))
        time.append(np.array([self.period * len(parts)]))
        states.append(tuple(each[-1:] for each in spline_values(controls, self.period, 1.0)))
        order = np.argsort(np.concatenate(time))
        places, *rates = (np.vstack(each)[order] for each in zip(*states, strict=True))
        velocities, accelerations = map(self._in_metres, rates)
        coordinates = self.problem.arm.coordinates
        return JointTrajectory(
            np.concatenate(time)[order], self._places(places), velocities, accelerations, coordinates
        )

    def _path(self, controls: FloatArray) -> JointPath:
        """Return the path of the motion with control points (m + 3, c), with its time as the path parameter."""
        places = self._places(knot_values(controls, self.period)[0])
        spline = make_interp_spline(np.linspace(0.0, 1.0, len(places)), places, 3, bc_type="clamped")
        kept = np.unique(np.linspace(0, len(places) - 1, _KEYFRAMES).round().astype(np.intp))
        keyframes = np.ascontiguousarray(places[kept])
        curves = nearest_curves(self.problem.arm, keyframes) if self.problem.dimension == 2 else ()
        return JointPath(spline, keyframes, curves, "driven", 0.5 * self._engine.spare * self._metres)


_Prepared: TypeAlias = tuple[Arm, StepperOf[Any], FloatArray, float, Limits, float]
"""Arm with its bodies as links, solver of steps, unknowns of the start, certified spare, limits, and unit of length
[m], of an engine."""


def _in_space(problem: Problem, settings: Settings) -> _Prepared:
    """Return what servo control of an arm in space needs."""
    whole = problem_with_tool_links(problem)
    tree = whole.workspace.surface_tree
    whole = with_clamped_base(whole, tree)
    certificate = replace(settings.space.certificate, spare=_SPARE)
    step = replace(settings.space.step, firm_share=_FIRM)
    task = space_task(whole, tree, Deadline.never(), replace(settings.space, certificate=certificate, step=step))
    refuse_ends(whole, task)
    curve, v = unknowns_through(whole.arm, task.start)
    return whole.arm, task.stepper(curve), v, task.spare, whole.limits, 1.0


def _in_plane(problem: Problem, settings: Settings) -> _Prepared:
    """Return what servo control of an arm in the plane needs, with the arm's length as the unit of length."""
    units = OwnUnits(problem.arm.length)
    whole = units.scaled(problem_with_tool_links(problem))
    step = replace(settings.curve.motion.step, still=True, firm_share=_FIRM)
    curve = replace(settings.curve, motion=replace(settings.curve.motion, step=step))
    task = MotionPlanner(plane=curve).task_without_routes(whole, resolve_ends(whole), Deadline.never())
    space, v = task.space_through(task.start)
    spare = task.contact_certificate.spare
    return task.arm, task.stepper(space, MARGINS[0]), v, spare, whole.limits, units.metres


def _efforts(problem: Problem, in_metres: Callable[[FloatArray], FloatArray]) -> _Efforts | None:
    """Return the function that finds a drive whose effort exceeds its limit; None if no effort is limited."""
    arm = problem.arm
    start = problem.start.configuration(arm)
    path = TimedPath(
        BSpline(np.array([0.0, 0.0, 1.0, 1.0]), np.stack((start, start)), 1),
        problem.limits,
        InverseDynamics(arm, problem.simulation.gravity),
        partial(revolute_angles, arm),
        arm.coordinates,
        arm,
        problem.planner.effort_share,
    )
    limit = DriveEffort(path)

    def exceeded(*states: FloatArray) -> Cut | None:
        name, used = limit.most_used(*map(in_metres, states))
        return Cut("effort", name, used, _EFFORT_RESERVE, "") if used > _EFFORT_RESERVE else None

    return exceeded if limit.limited else None


def _turn_onto(frame: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the turns that bring the first axis of a frame (d, d) onto a direction (d,), shape (d − 1,) [rad].

    In the plane it is the turn counter-clockwise, in space the turns about the frame's second and third axis.
    """
    along, *across = frame.T @ direction
    angle = np.arctan2(np.linalg.norm(across), along)
    if len(across) == 1:
        return np.array([np.arctan2(across[0], along)])
    # A turn about y moves x towards −z, one about z moves x towards y.
    about = np.array([-across[1], across[0]])
    size = float(np.linalg.norm(about))
    return angle * about / size if size > TINY else np.array([angle, 0.0])


def _ending_at(problem: Problem, pose: JointPose) -> Problem:
    """Return a problem with a pose of the whole arm as its only goal."""
    planner = replace(problem.planner, order="given", end="free", tries=1)
    return replace(problem, goal=pose, stops=(), pause=0.0, planner=planner, source="")


def _refuse_unsupported(problem: Problem) -> None:
    """Raise an error for limits of a problem that servo control does not keep.

    Raises:
        ProblemError: there is such a limit; the message names its key.
    """
    limits = problem.limits
    sections = problem.arm.sections
    found = [
        key
        for key, given in (
            ("limits.jerk", limits.jerk is not None or limits.feed_jerk is not None),
            ("limits.points", bool(limits.points)),
            ("planner.follow_within", problem.planner.follow_within is not None),
            ("tolerance.joint_error_deg", problem.joint_error > 0.0),
            ("tendons.speed", sections is not None and bool(np.any(np.isfinite(sections.of_tendons("speed"))))),
        )
        if given
    ]
    if needs_space(problem.arm):
        raise ProblemError(
            "servo control does not support planar arms of sections that bend evenly, or on a feed axis with bodies or "
            "locked joints"
        )
    if found:
        raise ProblemError(f"servo control does not keep {', '.join(found)}; leave it out")


def _vector(value: object, size: int, what: str) -> FloatArray:
    """Return a vector of finite numbers that a command gives, shape (size,)."""
    return expect_vector(value, size, f"{what} of {size} finite numbers")
