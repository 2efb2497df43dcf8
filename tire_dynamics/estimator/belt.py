"""The motion of the belt: its modes beside n = 1, and the shape that all modes make together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Integral
from types import ModuleType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..science.elementary import cos_sin
from ..science.modes import RingModes
from ..science.stepping import Room
from ..science.unit import TireWheelUnit
from ..science.wheel import Model

__all__ = ["BeltMotion", "BeltShape", "Path", "belt_numbers", "ring_angles"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]

_MOST_WAITING: Final = 4096  # steps that wait for the shape to be wanted


def ring_angles(samples: int) -> FloatArray:
    """psi_j = 2 pi j/samples, fixed in space [rad], shape (samples,)."""
    return 2.0 * math.pi * np.arange(samples) / samples


def belt_numbers(n_max: int, model: Model) -> NDArray[np.int64]:
    """The wavenumbers beside n = 1: 2..n_max, and 0 where the ring can stretch."""
    if not isinstance(n_max, Integral) or n_max < 2:
        raise ValueError(f"n_max is {n_max!r}; it must be an integer >= 2")
    numbers = np.arange(2, n_max + 1)
    return np.concatenate([[0], numbers]) if model == "complete" else numbers


class BeltShape:
    """Deflection of the belt relative to the wheel centre, at fixed angles, from the amplitudes of all modes.

    Parameters
    ----------
    psi : array_like, shape (P,)
        Angles fixed in space [rad].
    numbers : array_like of int, shape (N,)
        Wavenumbers of the modes beside n = 1.
    """

    def __init__(self, psi: ArrayLike, numbers: ArrayLike) -> None:
        angle = np.asarray(psi, dtype=np.float64)
        if angle.ndim != 1 or not np.isfinite(angle).all():
            raise ValueError("psi must be a row of finite angles")
        phase = np.multiply.outer(np.concatenate([[1.0], np.asarray(numbers, dtype=np.float64)]), angle)
        cosine, sine = cos_sin(phase)
        self._first = np.stack([cosine[0], sine[0]])
        self._rest = np.concatenate([cosine[1:], sine[1:]])
        self.basis = np.concatenate([self._first, self._rest])
        self.size = angle.size

    def deflection(self, first: FloatArray, radial: ComplexArray, tangential: ComplexArray) -> FloatArray:
        """Radial (outward) and tangential (along increasing psi) deflection [m], shape (..., 2, P).

        Parameters
        ----------
        first : ndarray, shape (..., 4)
            The n = 1 part, :func:`~tire_dynamics.science.wheel.belt_amplitudes`.
        radial, tangential : ndarray of complex, shape (..., N)
            Z_1 and Z_2 of the others: u = Re[conj(Z) exp(i n psi)].
        """
        rest = np.stack([radial, tangential], axis=-2)
        shape = np.concatenate([rest.real, rest.imag], axis=-1) @ self._rest
        shape += np.stack([first[..., :2], first[..., 2:]], axis=-2) @ self._first
        deflection: FloatArray = shape
        return deflection

    def sums(self, first: FloatArray, amplitudes: FloatArray, kernels: ModuleType) -> FloatArray:
        """As :meth:`deflection`, shape (M, 2, P), with sums in order.

        Parameters
        ----------
        first : ndarray, shape (M, 4)
        amplitudes : ndarray, shape (2, M, 2, N)
            As :meth:`BeltMotion.amplitudes` gives them.
        kernels : module
        """
        rows = np.concatenate([first.reshape(-1, 2, 2), amplitudes[0], amplitudes[1]], axis=-1)
        result: FloatArray = kernels.deflections(np.ascontiguousarray(rows), self.basis)
        return result


class Path(NamedTuple):
    """What one belt goes through: steps over which speed and force are held, and after how many of them it is wanted.

    ``length`` [ns] (I,), ``speed`` [rad/s] (I,), ``force`` [f_r, f_t] [N] (I, 2), ``ends`` (M,) ascending, 0..I.
    """

    length: IntArray
    speed: FloatArray
    force: FloatArray
    ends: IntArray


class BeltMotion:
    """The modes beside n = 1 of W belts through time, under forces that are held between changes.

    Steps are noted as they come and taken when the shape is wanted. Those of one force are taken as one; so the
    result depends on when the force and the speed change and when the shape is wanted, and on nothing else.

    Parameters
    ----------
    unit : TireWheelUnit
    n_max : int
    model : {"inextensional", "complete"}
    wheels : int
    kernels : module
        :mod:`~tire_dynamics.science.kernels` or :mod:`~tire_dynamics.science.compiled`.
    """

    def __init__(self, unit: TireWheelUnit, n_max: int, model: Model, wheels: int, kernels: ModuleType) -> None:
        self.modes = RingModes(unit, belt_numbers(n_max, model), model)
        self._kernels = kernels
        self._speeds = np.zeros(wheels)
        self._spins = self.modes.spins(self._speeds, self._kernels)
        self._own = np.zeros(self._spins.exponents.shape)
        self._waiting: list[list[tuple[int, float, float, float]]] = [[] for _ in range(wheels)]
        self._room = Room()
        self._noted: dict[int, FloatArray] = {}  # states as they were noted or given, until they change

    def set_unit(self, unit: TireWheelUnit) -> None:
        """Change the tires from now on. Positions and velocities go on as they are."""
        if unit != self.modes.unit:
            self._take_up(range(len(self._waiting)))
            states = self._spins.state(self._own)
            self.modes = RingModes(unit, self.modes.numbers, self.modes.model)
            self._spins = self.modes.spins(self._speeds, self._kernels)
            self._own = self._spins.own(states)
            self._noted = dict(enumerate(np.moveaxis(states, 1, 0)))

    def reset(self, index: int) -> None:
        """Be at rest."""
        self._waiting[index] = []
        self._turn_at(index, 0.0)
        self._own[:, index] = 0.0
        self._noted.pop(index, None)

    def start(self, index: int, speed: float, load: float, traction: float) -> None:
        """Be in the steady state of a constant speed [rad/s], load and traction [N]."""
        self._waiting[index] = []
        self._turn_at(index, speed)
        steady = self._spins.steady[:, index]
        self._own[:, index] = steady[..., 0] * -load + steady[..., 1] * -traction
        self._noted.pop(index, None)

    def _turn_at(self, index: int, speed: float) -> None:
        if speed != self._speeds[index]:
            self._speeds[index] = speed
            for all_wheels, new in zip(self._spins, self.modes.spins(np.array([speed]), self._kernels), strict=True):
                all_wheels[:, index] = new[:, 0]

    def hold(self, index: int, steps: Sequence[tuple[int, float, float, float]]) -> None:
        """Go on through steps: length [ns], speed [rad/s], load and traction [N] that are held over each."""
        self._waiting[index] += steps
        if len(self._waiting[index]) > _MOST_WAITING:
            self._follow({index: self._path(index, wanted=False)})

    def _path(self, index: int, *, wanted: bool) -> Path:
        columns = np.array(self._waiting[index], dtype=np.float64).reshape(-1, 4)
        ends = np.array([len(columns)] if wanted else [], dtype=np.int64)
        return Path(columns[:, 0].astype(np.int64), columns[:, 1], -columns[:, 2:], ends)

    def _take_up(self, indices: Sequence[int]) -> FloatArray:
        """Take all steps that wait; the wheels' states x, shape (2, len, N, k)."""
        return self._follow({index: self._path(index, wanted=True) for index in indices})

    def amplitudes(self, indices: Sequence[int]) -> FloatArray:
        """Z_1 and Z_2 of some wheels' modes [m], shape (2, len, 2, N): (real, imaginary), wheel, component, mode."""
        return self._components(self._take_up(indices))

    def deflections(self, indices: Sequence[int], first: FloatArray, shape: BeltShape) -> FloatArray:
        """Radial and tangential deflection of some belts [m], shape (len, 2, P), given their n = 1 parts, (len, 4)."""
        take_up = getattr(self._kernels, "take_up", None)
        if take_up is None or self.modes.model == "complete" or any(index in self._noted for index in indices):
            return shape.sums(first, self.amplitudes(indices), self._kernels)
        rows = np.empty((len(indices), 2, 2 + 2 * self.modes.numbers.size))
        for position, index in enumerate(indices):  # in one go, for the live node
            steps = np.array(self._waiting[index], dtype=np.float64).reshape(-1, 4)
            self._waiting[index] = []
            wheel = (*self._spins, index, self._speeds[index], *self.modes.parts)
            self._speeds[index] = take_up(self._own, *wheel, steps, first[position], rows[position])
        belts: FloatArray = self._kernels.deflections(rows, shape.basis)
        return belts

    def _components(self, states: FloatArray) -> FloatArray:
        if self.modes.model == "complete":
            return np.stack([states[..., 2], states[..., 3]], axis=-2)
        n, Z = self.modes.numbers, states[..., 1]
        return np.stack([Z, np.stack([Z[1] / n, -Z[0] / n])], axis=-2)  # Z_2 = -i Z_1/n

    def follow(self, paths: Mapping[int, Path]) -> FloatArray:
        """Take belts through paths; their amplitudes at the paths' ends, wheel after wheel.

        What each wheel was waiting to take goes before its path, what stands behind the last end of it waits.

        Returns
        -------
        ndarray, shape (2, M, 2, N)
            As :meth:`amplitudes`, M the number of all ends.
        """
        whole = {}
        for index, path in paths.items():
            before = self._path(index, wanted=False)
            whole[index] = Path(
                np.concatenate([before.length, path.length]),
                np.concatenate([before.speed, path.speed]),
                np.concatenate([before.force, path.force]),
                path.ends + before.length.size,
            )
        return self._components(self._follow(whole))

    def _follow(self, paths: Mapping[int, Path]) -> FloatArray:
        """The states x at all ends, shape (2, M, N, k). What stands behind the last end of each path waits."""
        wheels = np.array(list(paths))
        steps_of = np.cumsum([0, *(path.length.size for path in paths.values())])
        ends_of = np.cumsum([0, *(path.ends.size for path in paths.values())])
        columns = [np.concatenate(each) for each in zip(*paths.values(), strict=True)]
        length, speed, force, ends = columns
        ends += np.repeat(steps_of[:-1], np.diff(ends_of))
        before = np.empty_like(speed)
        before[1:] = speed[:-1]
        some = steps_of[1:] > steps_of[:-1]
        before[steps_of[:-1][some]] = self._speeds[wheels[some]]
        changed = np.flatnonzero(speed != before)
        whose = np.searchsorted(steps_of, changed, side="right") - 1

        if changed.size:
            speeds = np.concatenate([self._speeds[wheels], speed[changed]])
            # once more for the first few: cheaper than to join
            spins = self.modes.spins(speeds, self._kernels, self._room)
            after = wheels.size + np.arange(changed.size)
            previous = after - 1
            leads = np.append(True, whose[1:] != whose[:-1])
            previous[leads] = whose[leads]
            matrices, jumps = self.modes.changes(spins, speeds, previous, after, self._kernels)
        else:
            spins = self._spins.at(wheels)
            shape = spins.right.shape
            matrices, jumps = np.empty((2, 0, *shape[2:])), np.empty((2, 0, *shape[2:-1]))
        own = np.take(self._own, wheels, axis=1)
        outputs = np.empty((2, ends.size, *own.shape[2:]))
        modes = own, spins.exponents, spins.steady, matrices, jumps
        taken, spin = self._kernels.follow(*modes, length, force, changed, ends, steps_of, ends_of, outputs)
        self._own[:, wheels] = own
        states = spins.state(outputs, spin)
        for position, (wheel, path) in enumerate(paths.items()):
            done = int(taken[position] - steps_of[position])
            turns = np.flatnonzero(whose == position)
            if turns.size:
                self._speeds[wheel] = speed[changed[turns[-1]]]
                for all_wheels, new in zip(self._spins, spins, strict=True):
                    all_wheels[:, wheel] = new[:, wheels.size + turns[-1]]
            if wheel in self._noted:
                unmoved = np.arange(ends_of[position], ends_of[position + 1])[path.ends == 0]
                states[:, unmoved] = self._noted[wheel][:, None]
                if done or turns.size:
                    del self._noted[wheel]
            waiting = (path.length[done:], path.speed[done:], *(-path.force[done:]).T)
            self._waiting[wheel] = list(zip(*(column.tolist() for column in waiting), strict=True))
        return states

    def snapshot(self, index: int) -> dict[str, Any]:
        """Everything that later results depend on, in JSON's types; the motion goes on from what is in it."""
        state = self._take_up([index])[:, 0]
        if index not in self._noted:
            self._set(index, state)
        return {"speed": float(self._speeds[index]), "state": self._noted[index].tolist()}

    def restore(self, index: int, snapshot: Mapping[str, Any]) -> None:
        """Take over a :meth:`snapshot`."""
        self._waiting[index] = []
        self._turn_at(index, float(snapshot["speed"]))
        state = np.array(snapshot["state"], dtype=np.float64)
        expected = (2, *self._own.shape[2:])
        if state.shape != expected:
            raise ValueError(f"the belt's state has shape {state.shape}; it must be {expected}")
        self._set(index, state)

    def _set(self, index: int, state: FloatArray) -> None:
        self._noted[index] = state
        self._own[:, index] = self._spins.at(np.array([index])).own(state[:, None])[:, 0]
