"""Exact steps against a matrix exponential in long integers, against DOP853, and against themselves elsewhere."""

from __future__ import annotations

import functools
import json
import math
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.science.stepping import ExactStepper, solve_in_order

UNITS = {
    (damping, model): (TireWheelUnit.table_1(sidewall_damping=damping), model)
    for damping in ("modal", "reaction")
    for model in ("inextensional", "complete")
}
both = pytest.mark.parametrize("case", UNITS, ids="-".join)

BITS = 320  # of the reference's fraction; a double has 53


def exact_transition(F, B, h):
    """[Phi, G_0, G_1] of z' = F z + B (u + du t/h), rounded once, to double.

    The exponential of the system augmented by its inputs, by Taylor's series and squaring, in integers of unit
    2^-BITS. (A double-precision expm of a matrix with entries from 1 to 10^5 is the less accurate of the two.)
    """
    n, m = B.shape
    M = np.full((n + 2 * m, n + 2 * m), Fraction(0), dtype=object)
    for (i, j), value in np.ndenumerate(np.hstack([F, B])):
        M[i, j] = Fraction(float(value)) * Fraction(h)
    for k in range(m):
        M[n + k, n + m + k] = Fraction(1)
    norm = max(1.0, float(max(sum(abs(entry) for entry in row) for row in M)))
    squarings = math.ceil(math.log2(norm)) + 8
    small = np.vectorize(lambda entry: int(entry * 2 ** (BITS - squarings)), otypes=[object])(M)
    one = np.full(M.shape, 0, dtype=object)
    np.fill_diagonal(one, 1 << BITS)
    total, term = one.copy(), one
    for k in range(1, 41):  # terms of 2^-8k/k!
        term = (term.dot(small) >> BITS) // k
        total = total + term
    for _ in range(squarings):
        total = total.dot(total) >> BITS
    return np.vectorize(lambda entry: float(Fraction(int(entry), 1 << BITS)))(total[:n])


def state_scale(F):
    """Velocities count as they are, displacements times the highest frequency: one size for both."""
    half = len(F) // 2
    return np.repeat([1.0, math.sqrt(np.abs(F[:half, half:]).max())], half)


def error_of(transition, exact, F):
    """Worst errors of [Phi G_0 G_1], each beside the largest element that it has, states scaled."""
    n = len(F)
    scale = state_scale(F)
    balance = np.hstack([scale[:, None] / scale, np.tile(scale[:, None], exact.shape[1] - n)])
    difference, size = np.abs(transition - exact) * balance, np.abs(exact) * balance
    m = (exact.shape[1] - n) // 2
    blocks = [slice(0, n), slice(n, n + m), slice(n + m, n + 2 * m)]
    return max(difference[:, block].max() / max(size[:, block].max(), 1e-30) for block in blocks)


# -- one transition ---------------------------------------------------------------------------------------------

LENGTHS = [1e-7, 1e-5, 1e-4, 1e-3, 2e-3, 5e-3, 20e-3, 0.1, 1.0, 10.0]
SPEEDS = [0.0, 1e-3, 209.4, -209.4, 511.9, 512.1, -5000.0, 5000.0]

# Doubling k times squares the rounding of a short step k times over: 2^k of them, beside Phi's own decay. Up to
# 20 ms k is 5 at most; at 10 s and 5000 rad/s it is 15, and what is left of Phi is small beside its past.
SHORT, LONG = 1e-13, 1e-10


@both
@pytest.mark.parametrize("length", LENGTHS)
def test_transition_is_exact(case, length):
    unit, model = UNITS[case]
    system, stepper = wheel.fixed_frame(unit, model), wheel.stepper(unit, model)
    for speed in SPEEDS:
        F = wheel.fixed_frame_matrix(unit, speed, model)
        if length == 10.0 and abs(speed) > 1000.0:
            continue  # unstable there: growth by exp(1300), which no double holds
        exact = exact_transition(F, system.input, length)
        assert error_of(stepper.at(speed).transition(length).T, exact, F) < (SHORT if length <= 20e-3 else LONG)


@both
def test_batch_is_the_same_transition(case):
    """`transitions` may add in another order, and double as often as its longest step needs."""
    unit, model = UNITS[case]
    system, stepper = wheel.fixed_frame(unit, model), wheel.stepper(unit, model)
    rng = np.random.default_rng(1)
    steps, speeds = rng.uniform(1e-4, 20e-3, 40), rng.uniform(-800.0, 800.0, 40)
    for h, w in [(steps, speeds), (steps[0], speeds), (steps, speeds[0]), (steps[0], speeds[0])]:
        batch = stepper.transitions(np.asarray(h), np.asarray(w))
        steps_w = np.broadcast_arrays(np.atleast_1d(h), np.atleast_1d(w))
        assert len(batch) == len(steps_w[0])
        for transition, length, speed in zip(batch, *steps_w, strict=True):
            F = wheel.fixed_frame_matrix(unit, speed, model)
            single = stepper.at(speed).transition(length)
            assert error_of(transition.T, single.T, F) < 2.0 * SHORT  # each is that far from the exact one
    exact = exact_transition(wheel.fixed_frame_matrix(unit, speeds[3], model), system.input, steps[3])
    assert error_of(stepper.transitions(steps, speeds)[3].T, exact, F) < SHORT


def test_a_short_step_beside_a_long_one():
    """One long gap in a recording makes its whole block double more often; the short steps keep their digits."""
    unit, model = UNITS["modal", "inextensional"]
    stepper, F = wheel.stepper(unit, model), wheel.fixed_frame_matrix(unit, 100.0)
    batch = stepper.transitions(np.array([1e-3, 10.0]), np.array([100.0, 100.0]))
    exact = exact_transition(F, wheel.fixed_frame(unit).input, 1e-3)
    assert error_of(batch[0].T, exact, F) < LONG


@settings(max_examples=40)
@given(
    case=st.sampled_from(list(UNITS)),
    lengths=st.tuples(*[st.floats(-7.0, 1.0).map(lambda x: 10.0**x)] * 2),
    speed=st.floats(-1000.0, 1000.0),
)
def test_transitions_compose(case, lengths, speed):
    """Phi(h_1 + h_2) = Phi(h_2) Phi(h_1), and the same for a constant input."""
    unit, model = UNITS[case]
    F, at = wheel.fixed_frame_matrix(unit, speed, model), wheel.stepper(unit, model).at(speed)
    n = len(F)
    m = 2
    first, second, whole = (at.transition(h).T for h in (*lengths, sum(lengths)))
    composed = second[:, :n] @ first[:, : n + m]
    composed[:, n:] += second[:, n : n + m]
    # measured beside the largest element that Phi has on the way: a decayed Phi has only absolute digits left
    scale = state_scale(F)
    balance = np.hstack([scale[:, None] / scale, np.tile(scale[:, None], m)])
    size = np.abs(first * np.hstack([balance, balance[:, n:]])).max()
    assert (np.abs(composed - whole[:, : n + m]) * balance).max() <= LONG * max(size, 1.0) * max(
        np.abs(second[:, :n] * balance[:, :n]).max(), 1.0
    )


def test_step_of_no_length_changes_nothing():
    for unit, model in UNITS.values():
        stepper = wheel.stepper(unit, model)
        z = np.arange(1.0, stepper.states + 5.0)
        assert np.array_equal(stepper.at(123.0).step(0.0, z), z[: stepper.states])


def test_speeds_that_differ_by_a_hair_give_transitions_that_do():
    """No seam where the speed passes the tabulated range or the step is doubled once more."""
    unit, model = UNITS["modal", "inextensional"]
    stepper = wheel.stepper(unit, model)
    for speed in (0.0, stepper.top_speed, 2.0 * stepper.top_speed):
        F = wheel.fixed_frame_matrix(unit, speed)
        for length in (stepper.longest_step, 2.0 * stepper.longest_step, 1e-3):
            sides = [
                stepper.at(w).transition(h).T
                for w in (np.nextafter(speed, -np.inf), np.nextafter(speed, np.inf))
                for h in (np.nextafter(length, 0.0), np.nextafter(length, 1.0))
            ]
            assert max(error_of(side, sides[0], F) for side in sides[1:]) < SHORT


# -- inputs that are linear in time -----------------------------------------------------------------------------


@both
@pytest.mark.parametrize("speed", [0.0, 150.0, -400.0])
def test_linear_inputs(case, speed):
    """Load and traction linear over one step of 20 ms, against DOP853."""
    unit, model = UNITS[case]
    system, F = wheel.fixed_frame(unit, model), wheel.fixed_frame_matrix(unit, speed, model)
    n, h = len(F), 20e-3
    rng = np.random.default_rng(7)
    z0 = rng.normal(size=n) / state_scale(F)
    u, du = np.array([3000.0, -200.0]), np.array([-1500.0, 900.0])
    reference = solve_ivp(
        lambda t, z: F @ z + system.input @ (u + du * (t / h)),
        (0.0, h),
        z0,
        method="DOP853",
        rtol=1e-12,
        atol=1e-15 / state_scale(F),
    ).y[:, -1]
    found = wheel.stepper(unit, model).at(speed).step(h, np.concatenate([z0, u, du]))
    error = np.abs(found - reference) * state_scale(F)
    assert error.max() <= 1e-10 * np.abs(reference * state_scale(F)).max()  # 100 times the integrator's rtol


# -- any system, not only the wheel's ---------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.0, 50.0, -100.0, 150.0, 400.0, -1000.0])
def test_speed_squared(speed):
    """F_0 + Omega F_1 + Omega^2 F_2, at speeds in and far beyond the tabulated range."""
    rng = np.random.default_rng(0)
    terms = [size * rng.normal(size=(3, 3)) for size in (10.0, 0.1, 1e-3)]
    inputs = rng.normal(size=(3, 1))
    stepper = ExactStepper(terms, inputs, np.ones(3), top_speed=100.0)
    F = sum(term * speed**k for k, term in enumerate(terms))
    for length in (1e-3, 1e-2, 0.1):
        exact = exact_transition(F, inputs, length)
        found = stepper.at(speed).transition(length).T
        batch = stepper.transitions(np.array(length), np.array(speed))[0].T
        # F itself, rounded, moves exp(h F) by h |F| 2^-53 of it; the sums and the doublings do so some tens of times
        allowed = 2.0**-53 * 30.0 * (1.0 + length * np.abs(F).sum(axis=1).max())
        assert np.abs(found - exact).max() <= allowed * np.abs(exact).max()
        assert np.abs(batch - exact).max() <= allowed * np.abs(exact).max()


@pytest.mark.parametrize("terms", [1, 2, 3])
def test_limit(terms):
    """The longest step summed directly: all of the table's range up to the top speed, and beyond it less and less."""
    stepper = ExactStepper([np.eye(2)] * terms, np.zeros((2, 1)), np.ones(2), top_speed=64.0)
    assert stepper.limit(0.0) == stepper.limit(64.0) == stepper.longest_step
    for speed in (65.0, 128.0, 1e4):
        # norm of h F at most, F growing as Omega^(terms - 1)
        assert stepper.limit(speed) == pytest.approx(stepper.longest_step * (64.0 / speed) ** (terms - 1), rel=1e-15)


def test_undamped_rotation_keeps_its_radius():
    """z' = Omega J z turns and nothing else: ten thousand steps lose no more than their rounding."""
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    stepper = ExactStepper([np.zeros((2, 2)), J], np.zeros((2, 1)), np.ones(2))
    at = stepper.at(300.0)
    z = np.array([1.0, 0.0, 0.0, 0.0])
    for _ in range(10_000):
        z[:2] = at.step(1e-3, z)
    angle = 10_000 * 300.0 * 1e-3
    # one rounding of 2^-53 per element and doubling, all to one side at worst
    assert np.abs(z[:2] - [math.cos(angle), math.sin(angle)]).max() < 10_000 * 20 * 2.0**-53


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6))
def test_solve_in_order(seed, n):
    rng = np.random.default_rng(seed)
    matrix, right = rng.normal(size=(n, n)), rng.normal(size=n)
    x = solve_in_order(matrix, right)
    # backward stable: the residual is rounding beside |A| |x|, times n for its sums and a growth of 2^(n-1) at most
    assert np.abs(matrix @ x - right).max() <= 64 * n * 2.0**-53 * (np.abs(matrix) @ np.abs(x)).max()


def test_solve_in_order_pivots():
    assert solve_in_order(np.array([[0.0, 2.0], [4.0, 0.0]]), np.array([2.0, 8.0])).tolist() == [2.0, 1.0]


# -- the same bits everywhere -----------------------------------------------------------------------------------

COMPUTATION = """
import hashlib, json
import numpy as np
from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.estimator.belt import BeltShape, belt_numbers, ring_angles
from tire_dynamics.estimator.wheel_estimator import WheelEstimator

forces, states, belts = hashlib.sha256(), hashlib.sha256(), hashlib.sha256()
stretching = []
modal = TireWheelUnit.table_1(contact_half_angle=0.1)
varying = modal.replace(
    radial_nonuniformity=[(2, 0.1, 0.4)], tangential_nonuniformity=[(2, 0.05, 1.0)], imbalance_mass=0.03,
    imbalance_angle=0.7, radial_runout=[(1, 3e-4, 0.3), (7, 1e-4, 1.0)],
)
for unit in (modal, modal.replace(sidewall_damping="reaction"), varying, varying.replace(longitudinal_stiffness=2e5)):
    for model in ("inextensional", "complete"):
        estimator = WheelEstimator(unit, model=model, n_max=30)
        shape = BeltShape(ring_angles(72), belt_numbers(30, model))
        for tick in range(300):
            stamp = 1_800_000_000_000_000_000 + 2_000_000 * tick
            if tick % 5 == 0:
                estimator.add_speed(stamp - 300_000, 0.37 * tick - 40.0, 0.1 * tick)
            estimator.add_load(stamp - 700_000, 4000.0 + 17.0 * (tick % 29) ** 2, 31.0 * (tick % 7))
            if estimator.advance(stamp):
                forces.update(np.array(estimator.axle_force).tobytes())
                states.update(estimator.state.tobytes())
                if tick % 10 == 0 and model == "inextensional":
                    belts.update(estimator.belt(shape).tobytes())
                elif tick % 10 == 0:
                    stretching.append(estimator.belt(shape).ravel().tolist())
        for speed in (0.0, 77.7, -333.3, 1234.5):
            for length in (1.7e-4, 2e-3, 0.0123, 1.1):
                states.update(wheel.stepper(unit, model).at(speed).transition(length).tobytes())
print(json.dumps([forces.hexdigest(), states.hexdigest(), belts.hexdigest(), stretching]))
"""


def digests(**environment):
    """Hashes of axle forces, of states and transitions, and of belts, and belts that stretch, from another process."""
    result = subprocess.run(
        [sys.executable, "-c", COMPUTATION],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def dispatched_features():
    """The CPU features that this NumPy found here and could do without."""
    try:
        from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
    except ImportError:  # NumPy 1
        from numpy.core._multiarray_umath import __cpu_dispatch__, __cpu_features__
    return [name for name in __cpu_dispatch__ if __cpu_features__[name]]


@functools.cache
def digests_of(machine):
    return digests(**MACHINES[machine])


def machines():
    features = dispatched_features()
    yield "this one", {}
    yield "one BLAS thread", {"OPENBLAS_NUM_THREADS": "1"}
    yield "BLAS for Prescott", {"OPENBLAS_CORETYPE": "Prescott"}
    yield "BLAS for Haswell, two threads", {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "2"}
    if features:
        yield f"NumPy without {features[-1]}", {"NPY_DISABLE_CPU_FEATURES": features[-1]}
        yield "NumPy without any", {"NPY_DISABLE_CPU_FEATURES": " ".join(features), "OPENBLAS_CORETYPE": "Prescott"}
    # glibc chooses its sin, cos, exp and pow by the processor; other C libraries take no notice of this
    yield "C library without FMA", {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable"}


MACHINES = dict(machines())
elsewhere = pytest.mark.parametrize("machine", list(MACHINES)[1:])


@pytest.mark.slow
@elsewhere
def test_forces_have_the_same_bits(machine):
    """A log replays bit for bit on a machine with another processor: axle forces, states, transitions, belts."""
    assert digests_of(machine)[:3] == digests_of("this one")[:3]


@pytest.mark.slow
def test_another_process_has_the_same_bits():
    """Forces, states and belts, those that stretch too, with LAPACK in between: the same machine gives the same."""
    assert digests(PYTHONHASHSEED="1") == digests_of("this one")


@elsewhere
def test_a_belt_that_stretches_is_the_same_but_for_rounding(machine):
    """The complete model's modes come from LAPACK: on another kind of machine they differ in their last bits."""
    found, expected = (np.array(digests_of(name)[3]) for name in (machine, "this one"))
    # eigenvectors of 4x4 matrices, of condition 100 or so: some hundred roundings of 2^-53
    assert np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()
