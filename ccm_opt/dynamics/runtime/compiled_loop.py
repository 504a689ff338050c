"""The compiled control loop and its law.

Positions x = (q, x_b) and speeds ẋ are those of all revolutes and, last, of the base on its feed axis; the efforts are
their torques and the thrust, u = (τ, F). Each step of length h does three things.

1. *Measure.* q and q̇ with noise, x_b and ẋ_b without. With the reference x_r at the start of the step, the errors are
   e = x_r − x and ė = ẋ_r − ẋ, and the feedback is Kp e + Kd ė, the feed axis with gains of its own.

2. *Control*, held over the step. While the brakes hold the arm, u = 0 and nothing moves. Else

   - computed torque: a = ẍ_r + Kp e + Kd ė, u = ID(q + ½ h q̇, q̇ + ½ h a, a), the efforts that make the acceleration a
     at the middle of the step. Where F passes its limit, a_b is changed to what the base can do,
     a_b + (clamp(F) − F) / m with m the mass of arm and payload, and u is computed once more, so that the joints'
     torques fit a base that lags;
   - PD: τ = Kp e⁺ + Kd ė⁺ + ID(q, 0, 0), the gravity torques of the measured pose added (Takegaki and Arimoto, 1981),
     with the errors at the end of the step, e⁺ = e + h ė and ė⁺ = ė + h (q̈_r − q̈): drives close their loops many times
     in a step, and errors of its start, held so long, would shake a light link under gains that hold a heavy arm. The
     q̈ that this makes is FD of the believed arm with rotors heavier by h Kd, under Kp e⁺ + Kd (ė + h q̈_r) + ID(q, 0, 0)
     (stable PD; Tan, Liu and Turk, 2011). The feed axis has F = Kp e + Kd ė + ID(q, 0, 0).

   Both saturate, |τ| ≤ limit and |F| ≤ feed_limit. ID is inverse dynamics (``rnea``) of what the controller believes
   in, which need not be the plant.

3. *Move.* One classical Runge–Kutta step of ẍ = FD(x, ẋ, u), the plant's forward dynamics (``aba``), u held.
"""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.native import NativeCall, native_constant
from ccm_opt.dynamics.algorithms.arm_model import ArmModel
from ccm_opt.dynamics.runtime.inverse_dynamics import arm_for_c


@dataclass(frozen=True)
class LoopParameters:
    """Numbers of a closed loop.

    Attributes:
        step: h [s].
        computed: whether the law is computed torque, else PD.
        proportional: Kp of every joint, shape (3 * links,), [1/s²] under computed torque, [N m/rad] under PD.
        derivative: Kd of every joint, shape (3 * links,), [1/s] or [N m s/rad].
        feed_proportional: Kp of the feed axis, [1/s²] or [N/m].
        feed_derivative: Kd of the feed axis, [1/s] or [N s/m].
        limit: bound on torques, shape (3 * links,) [N m].
        feed_limit: bound on the thrust of the feed axis [N].
    """

    step: float
    computed: bool
    proportional: FloatArray
    derivative: FloatArray
    feed_proportional: float
    feed_derivative: float
    limit: FloatArray
    feed_limit: float


def stiffened(model: ArmModel, parameters: LoopParameters) -> ArmModel:
    """The arm that a controller believes in, with rotors heavier by h Kd: what PD moves by the end of a step."""
    drives = model.drives.copy()
    drives[:, :3] += parameters.step * parameters.derivative.reshape(-1, 3)
    return replace(model, drives=drives)


class CompiledLoop:
    """A plant under its controller, as ``control_law`` says.

    Arrays end with the feed axis, W = 3 * links + 1, at rest when there is none.

    Args:
        plant: what moves.
        model: what the controller believes.
        parameters: gains, limits and step.
    """

    def __init__(self, plant: ArmModel, model: ArmModel, parameters: LoopParameters) -> None:
        p = parameters
        believed = arm_for_c(model)
        self._width = plant.structure.joints + 1
        variant = plant.structure.variant
        self._call = NativeCall(
            f"simulate__{variant}",
            plant=arm_for_c(plant), model=believed,
            stiffened=believed if p.computed else arm_for_c(stiffened(model, p)),
            computed=p.computed, step=p.step, kp=p.proportional, kd=p.derivative, limit=p.limit,
            feed_kp=p.feed_proportional, feed_kd=p.feed_derivative, feed_limit=p.feed_limit,
            work=np.zeros((native_constant(f"loop_rows__{variant}"), plant.structure.joints + 1)),
        )  # fmt: skip

    def run(
        self, state: FloatArray, reference: FloatArray, noise: FloatArray, held: int
    ) -> tuple[FloatArray, FloatArray]:
        """Make some steps.

        Args:
            state: positions and velocities before the first step, shape (2, W).
            reference: positions, velocities and accelerations of every step, shape (N, 3, W).
            noise: added to what is measured of the joints' angles and speeds, shape (N, 2, W - 1).
            held: number of steps from the first on in which brakes hold the arm.

        Returns:
            States at the ends of the steps, shape (N, 2, W), and efforts held over them, shape (N, W).
        """
        count, _, width = reference.shape
        if width != self._width or reference.shape[1] != 3 or np.shape(state) != (2, width):
            raise ValueError(f"got shapes {np.shape(state)} and {reference.shape}; expected (N, 3, {self._width})")
        if noise.shape != (count, 2, width - 1):
            raise ValueError(f"noise has the shape {noise.shape}; expected {(count, 2, width - 1)}")
        states = np.empty((count, 2, width))
        efforts = np.empty((count, width))
        self._call.set(
            count=count, held=min(max(held, 0), count), reference=reference, noise=noise,
            x=np.array(state, dtype=np.float64, order="C"),  # a copy: C moves it on
            states=states, efforts=efforts,
        )  # fmt: skip
        self._call()
        return states, efforts
