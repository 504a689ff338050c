"""The closed loop step by step in numpy, the same as ``simulation.c``; ``controller`` says what both compute."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.algorithms.arm_model import ArmModel
from ccm_opt.dynamics.simulation.controller import stiffened

from .interpreted_function import DrivenFunction, InterpretedFunction


def with_feed(numbers: Mapping[str, Any], model: ArmModel, gains: tuple[float, float], limit: float) -> dict[str, Any]:
    """Numbers of a loop of which those of a feed axis stand last: its gains, limit and the mass that it moves."""
    of_feed = {"kp": gains[0], "kd": gains[1], "limit": limit}
    mass = float(np.sum(model.bodies[:, 0]) + model.world[3])
    return {**numbers, **{name: np.append(numbers[name], last) for name, last in of_feed.items()}, "carried": [mass]}


class InterpretedLoop:
    """The closed loop of a plant and of the model its controller has; see ``simulation.controller``.

    Args:
        plant: what moves.
        model: what the controller believes.
        numbers: gains, limits and step, see ``controller.loop_numbers``.
    """

    def __init__(self, plant: ArmModel, model: ArmModel, numbers: Mapping[str, Any]) -> None:
        function = InterpretedFunction if plant.coupling is None else DrivenFunction
        self._forward = function("forward_dynamics", plant)
        self._inverse = function("inverse_dynamics", model)
        self.bending = plant.coordinates
        self._step = numbers["step"]
        self._computed = numbers["computed"]
        self._limit = numbers["limit"]
        self._mass = numbers["carried"][0]
        self._proportional = numbers["kp"]
        self._derivative = numbers["kd"]
        if not self._computed:
            self._predicted = function("forward_dynamics", stiffened(model, self._step, numbers["kd"]))

    def run(
        self, state: FloatArray, reference: FloatArray, noise: FloatArray, held: int
    ) -> tuple[FloatArray, FloatArray]:
        """Steps from a state on; see ``CompiledLoop``."""
        count, _, width = reference.shape
        states = np.empty((count, 2, width))
        efforts = np.zeros((count, width))
        x = np.array(state, dtype=np.float64)
        for s in range(count):
            if s >= held:
                measured = x + np.pad(noise[s], ((0, 0), (0, 1)))  # the feed axis is measured exactly
                efforts[s] = self._control(measured, reference[s])
                x = self._advance(x, efforts[s])
            states[s] = x
        return states, efforts

    def _control(self, x: FloatArray, reference: FloatArray) -> FloatArray:
        """The efforts that are held over a step."""
        feedback = self._proportional * (reference[0] - x[0]) + self._derivative * (reference[1] - x[1])
        if self._computed:
            effort = self._computed_torque(x, reference[2] + feedback)
        else:
            effort = self._proportional_derivative(x, reference, feedback)
        return np.clip(effort, -self._limit, self._limit)

    def _computed_torque(self, x: FloatArray, a: FloatArray) -> FloatArray:
        """The efforts that make the acceleration a at the middle of the step."""
        half = 0.5 * self._step
        # Held over a step, an effort acts as if at its middle; so the model is evaluated there.
        middle_q = (x[0] + half * x[1])[:-1]
        middle_qd = (x[1] + half * a)[:-1]
        effort = self._inverse.both(middle_q, middle_qd, a[:-1], a[-1])
        # A thrust that saturates moves the base less than wanted, and the joints must be driven for what it does.
        lacking = float(np.clip(effort[-1], -self._limit[-1], self._limit[-1]) - effort[-1])
        if lacking == 0.0:
            return effort
        return self._inverse.both(middle_q, middle_qd, a[:-1], a[-1] + lacking / self._mass)

    def _proportional_derivative(self, x: FloatArray, reference: FloatArray, feedback: FloatArray) -> FloatArray:
        """The efforts of PD whose errors are those at the end of the step, as the believed arm would make them."""
        rest = np.zeros(len(feedback) - 1)
        effort = feedback + self._inverse.both(x[0, :-1], rest, rest)
        effort[-1] = np.clip(effort[-1], -self._limit[-1], self._limit[-1])
        joints = slice(None, -1)
        h = self._step
        effort[joints] += h * (self._proportional * (reference[1] - x[1]) + self._derivative * reference[2])[joints]
        # What is left of the errors' change is that of the accelerations which these efforts make.
        made = self._predicted.both(x[0, joints], x[1, joints], effort[joints], effort[-1])
        effort[joints] -= h * (self._derivative * made)[joints]
        return effort

    def _advance(self, x: FloatArray, effort: FloatArray) -> FloatArray:
        """One classical Runge–Kutta step under held efforts."""
        h = self._step
        k1 = self._slope(x, effort)
        k2 = self._slope(x + 0.5 * h * k1, effort)
        k3 = self._slope(x + 0.5 * h * k2, effort)
        k4 = self._slope(x + h * k3, effort)
        return np.asarray(x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))

    def _slope(self, x: FloatArray, effort: FloatArray) -> FloatArray:
        return np.stack((x[1], self._forward.both(x[0, :-1], x[1, :-1], effort[:-1], effort[-1])))
