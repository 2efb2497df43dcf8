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
from exact_stepper import ExactStepper
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.estimator.motion import Motion
from tire_dynamics.science.rotating_excitation import rotating_excitation
from tire_dynamics.science.stepping import solve_in_order

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


def transition(unit, model, speed, length):
    """[Phi G_0 G_1], column by column from a step that begins in each unit vector, or at rest under each input."""
    motion = Motion(unit, model, 1)
    n = motion.state_of(0).size
    columns = []
    for k in range(n + 4):
        motion.put(0, np.eye(n)[k] if k < n else np.zeros(n), speed, 0.0)
        load, traction, load_change, traction_change = (float(k == n + j) for j in range(4))
        motion.advance(0, length, speed, load, traction, 0.0, load_change, traction_change)
        columns.append(motion.state_of(0))
    return np.stack(columns, axis=1)


@both
@pytest.mark.parametrize("length", LENGTHS)
def test_transition_is_exact(case, length):
    unit, model = UNITS[case]
    system = wheel.fixed_frame(unit, model)
    for speed in SPEEDS:
        F = wheel.fixed_frame_matrix(unit, speed, model)
        if length == 10.0 and abs(speed) > 1000.0:
            continue  # unstable there: growth by exp(1300), which no double holds
        exact = exact_transition(F, system.input, length)
        assert error_of(transition(unit, model, speed, length), exact, F) < (SHORT if length <= 20e-3 else LONG)


@settings(max_examples=40)
@given(
    case=st.sampled_from(list(UNITS)),
    lengths=st.tuples(*[st.floats(-7.0, 1.0).map(lambda x: 10.0**x)] * 2),
    speed=st.floats(-1000.0, 1000.0),
)
def test_transitions_compose(case, lengths, speed):
    """Phi(h_1 + h_2) = Phi(h_2) Phi(h_1), and the same for a constant input."""
    unit, model = UNITS[case]
    F = wheel.fixed_frame_matrix(unit, speed, model)
    n = len(F)
    m = 2
    first, second, whole = (transition(unit, model, speed, h) for h in (*lengths, sum(lengths)))
    composed = second[:, :n] @ first[:, : n + m]
    composed[:, n:] += second[:, n : n + m]
    # measured beside the largest element that Phi has on the way: a decayed Phi has only absolute digits left
    scale = state_scale(F)
    balance = np.hstack([scale[:, None] / scale, np.tile(scale[:, None], m)])
    size = np.abs(first[:, : n + m] * balance).max()
    assert (np.abs(composed - whole[:, : n + m]) * balance).max() <= LONG * max(size, 1.0) * max(
        np.abs(second[:, :n] * balance[:, :n]).max(), 1.0
    )


VARYING = TireWheelUnit.table_1(
    radial_nonuniformity=[(2, 0.1, 0.4)], tangential_nonuniformity=[(2, 0.05, 1.0)], imbalance_mass=0.03,
    imbalance_angle=0.7, radial_runout=[(1, 3e-4, 0.3), (7, 1e-4, 1.0)],
)  # fmt: skip


@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("unit", [TireWheelUnit.table_1(), VARYING], ids=["uniform", "varying"])
def test_step_of_no_length_changes_nothing(unit, model):
    motion = Motion(unit, model, 2)
    z = np.arange(1.0, wheel.states(unit, model) + 1.0)
    motion.put(1, z, 123.0, 0.4)
    motion.advance(1, 0.0, 123.0, 4000.0, 500.0, 0.0, 100.0, 30.0)
    assert np.array_equal(motion.state_of(1), z)
    assert motion.phase_of(1) == 0.4 and not motion.state_of(0).any()


def norm_at(unit, model, speed):
    """What the length of a step is measured by: over 3 of it a step is taken in pieces."""
    parts = rotating_excitation(unit, model)
    turning_with_it = parts.highest if parts.is_rotating else 0.0
    return parts.sizes[0] + abs(speed) * (parts.sizes[1] + turning_with_it) + parts.sizes[2]


@pytest.mark.parametrize("pieces", [1, 2, 3, 24, 48, 96])
def test_lengths_that_differ_by_a_hair_give_transitions_that_do(pieces):
    """No seam where a step is taken in one piece more, from 24 on is doubled up, or is once more."""
    for (damping, model), (unit, _) in UNITS.items():
        for speed in (0.0, 300.0):
            F = wheel.fixed_frame_matrix(unit, speed, model)
            length = 3.0 * pieces / norm_at(unit, model, speed)
            hairs = length * (1.0 - 1e-15), length, length * (1.0 + 1e-15)
            sides = [transition(unit, model, speed, h) for h in hairs]
            # each is that far from the exact one, and a hair moves that by 1e-15 of norm times length
            allowed = 3.0 * SHORT if pieces <= 24 else LONG
            assert max(error_of(side, sides[1], F) for side in sides) < allowed, damping


def test_a_long_step_has_the_wheels_angle():
    """An hour at 97.3 rad/s in one step: 2 pi is rounded by 2.4e-16 a turn, of 56 thousand."""
    motion = Motion(UNITS["modal", "inextensional"][0], "inextensional", 1)
    motion.advance(0, 3600.0, 97.3, 4000.0)
    turned = float(Fraction(97.3) * 3600 % (2 * (Fraction(math.pi) + Fraction(1.2246467991473532e-16))))
    assert math.remainder(motion.phase_of(0) - turned, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("seconds", [0.5, 30.0, 3600.0])
@pytest.mark.parametrize("unit", [TireWheelUnit.table_1(), VARYING], ids=["uniform", "varying"])
def test_a_long_step_is_many_short_ones(unit, model, seconds):
    """As long as the longest timeout: the same state and force, from a motion that has not come to rest.

    Half a second keeps some of the start; behind an hour nothing is left of it, but what turns with the tire goes on.
    """
    if unit is VARYING and seconds > 1.0:
        seconds = 3.0  # taken in pieces, however long: 3 s are some thousand
    long, short = Motion(unit, model, 1), Motion(unit, model, 1)
    start = np.random.default_rng(3).normal(size=wheel.states(unit, model)) * 1e-3
    for motion in (long, short):
        motion.put(0, start, 120.0, 0.3)
    count = round(seconds / 0.01) if seconds < 100.0 else 1000
    long.advance(0, seconds, 120.0, 3500.0, 200.0)
    for _ in range(count):
        short.advance(0, seconds / count, 120.0, 3500.0, 200.0)
    scale = state_scale(wheel.fixed_frame_matrix(unit, 120.0, model))
    difference = np.abs(long.state_of(0) - short.state_of(0)) * scale
    # the angles differ by the rounding of an hour's, which only what turns with the tire feels
    assert difference.max() <= LONG * np.abs(short.state_of(0) * scale).max()
    assert long.axle_force(0, 120.0) == pytest.approx(short.axle_force(0, 120.0), abs=1e-10 * 40.0 * 3500.0)


def test_a_long_step_under_forces_that_change():
    """A ramp of load and traction over an hour in one step, or in two, or in thousand."""
    unit, model = UNITS["reaction", "complete"]
    ends = []
    for count in (1, 2, 1000):
        motion = Motion(unit, model, 1)
        motion.put(0, np.full(10, 1e-3), 80.0, 0.0)
        for k in range(count):
            share = k / count
            force = 3000.0 + 1000.0 * share, 500.0 * share
            motion.advance(0, 3600.0 / count, 80.0, *force, 0.0, 1000.0 / count, 500.0 / count)
        ends.append(motion.state_of(0))
    scale = state_scale(wheel.fixed_frame_matrix(unit, 80.0, model))
    for end in ends[1:]:
        assert (np.abs(end - ends[0]) * scale).max() <= LONG * np.abs(end * scale).max()


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
    motion = Motion(unit, model, 1)
    motion.put(0, z0, speed, 0.0)
    motion.advance(0, h, speed, *u, 0.0, *du)
    error = np.abs(motion.state_of(0) - reference) * state_scale(F)
    assert error.max() <= 1e-10 * np.abs(reference * state_scale(F)).max()  # 100 times the integrator's rtol


# -- the transitions of the contact's reference ----------------------------------------------------------------------


def stepper_of(unit, model):
    frame = wheel.fixed_frame(unit, model)
    return ExactStepper([frame.constant, frame.spin], frame.input, 1.0 / state_scale(frame.constant))


@both
def test_tabulated_transitions_are_exact(case):
    """`transitions` doubles as often as its longest step needs."""
    unit, model = UNITS[case]
    system, stepper = wheel.fixed_frame(unit, model), stepper_of(unit, model)
    rng = np.random.default_rng(1)
    steps, speeds = rng.uniform(1e-4, 20e-3, 4), rng.uniform(-800.0, 800.0, 4)
    for h, w in [(steps, speeds), (steps[0], speeds), (steps, speeds[0]), (steps[0], speeds[0])]:
        batch = stepper.transitions(np.asarray(h), np.asarray(w))
        pairs = np.broadcast_arrays(np.atleast_1d(h), np.atleast_1d(w))
        assert len(batch) == len(pairs[0])
        for found, length, speed in zip(batch, *pairs, strict=True):
            F = wheel.fixed_frame_matrix(unit, speed, model)
            assert error_of(found.T, exact_transition(F, system.input, length), F) < SHORT


def test_a_short_step_beside_a_long_one():
    """One long gap makes its whole block double more often; the short steps keep their digits."""
    unit, model = UNITS["modal", "inextensional"]
    F = wheel.fixed_frame_matrix(unit, 100.0, model)
    batch = stepper_of(unit, model).transitions(np.array([1e-3, 10.0]), np.array([100.0, 100.0]))
    exact = exact_transition(F, wheel.fixed_frame(unit).input, 1e-3)
    assert error_of(batch[0].T, exact, F) < LONG


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
        found = stepper.transitions(np.array(length), np.array(speed))[0].T
        # F itself, rounded, moves exp(h F) by h |F| 2^-53 of it; the sums and the doublings do so some tens of times
        allowed = 2.0**-53 * 30.0 * (1.0 + length * np.abs(F).sum(axis=1).max())
        assert np.abs(found - exact).max() <= allowed * np.abs(exact).max()


@pytest.mark.parametrize("terms", [1, 2, 3])
def test_limit(terms):
    """The longest step summed directly: all of the table's range up to the top speed, and beyond it less and less."""
    stepper = ExactStepper([np.eye(2)] * terms, np.zeros((2, 1)), np.ones(2), top_speed=64.0)
    assert stepper.limit(0.0) == stepper.limit(64.0) == stepper.longest_step
    for speed in (65.0, 128.0, 1e4):
        # norm of h F at most, F growing as Omega^(terms - 1)
        assert stepper.limit(speed) == pytest.approx(stepper.longest_step * (64.0 / speed) ** (terms - 1), rel=1e-15)


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
from tire_dynamics import TireWheelUnit, simulate, wheel
from tire_dynamics.estimator.motion import Motion
from tire_dynamics.estimator.vehicle import Vehicle, VehicleSettings

forces, states, belts = hashlib.sha256(), hashlib.sha256(), hashlib.sha256()
stretching = []
modal = TireWheelUnit.table_1(contact_half_angle=0.1)
varying = modal.replace(
    radial_nonuniformity=[(2, 0.1, 0.4)], tangential_nonuniformity=[(2, 0.05, 1.0)], imbalance_mass=0.03,
    imbalance_angle=0.7, radial_runout=[(1, 3e-4, 0.3), (7, 1e-4, 1.0)],
)
for unit in (modal, modal.replace(sidewall_damping="reaction"), varying, varying.replace(longitudinal_stiffness=2e5)):
    for model in ("inextensional", "complete"):
        vehicle = Vehicle(VehicleSettings(unit, model=model, ring_samples=72, n_max=30))
        for tick in range(300):
            stamp = 1_800_000_000_000_000_000 + 2_000_000 * tick
            if tick % 5 == 0:
                vehicle.joint_states(stamp, stamp - 300_000, ["wheel"], [0.37 * tick - 40.0], [0.1 * tick])
            vehicle.load(0, stamp, stamp - 700_000, 4000.0 + 17.0 * (tick % 29) ** 2, 31.0 * (tick % 7))
            for output in vehicle.tick(stamp):
                forces.update(np.array(output[1:]).tobytes())
                states.update(vehicle.wheels.motion.state_of(0).tobytes())
            for _, belt in vehicle.belts():
                if model == "inextensional":
                    belts.update(belt.tobytes())
                else:
                    stretching.append(belt.ravel().tolist())
        motion = Motion(unit, model, 1)
        for speed in (0.0, 77.7, -333.3, 1234.5):
            for length in (1.7e-4, 2e-3, 0.0123, 1.1):
                motion.put(0, np.full(wheel.states(unit, model), 1e-3), speed, 0.3)
                motion.advance(0, length, speed, 4000.0, 300.0, -20.0, 1e3, -2e2)
                states.update(motion.state_of(0).tobytes())
        time = 2e-3 * np.arange(50)
        found = simulate(unit, time, 90.0 - 3e3 * time, 3e3 + 5e4 * time, 1e3 * time, model=model, angle=0.2)
        forces.update(found.axle_force.tobytes())
print(json.dumps([forces.hexdigest(), states.hexdigest(), belts.hexdigest(), stretching]))
"""


def digests(**environment):
    """Hashes of axle forces, of states and steps, and of belts, and belts that stretch, from another process."""
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
    """A log replays bit for bit on a machine with another processor: axle forces, states, steps, belts."""
    assert digests_of(machine)[:3] == digests_of("this one")[:3]


@pytest.mark.slow
def test_another_process_has_the_same_bits():
    """Forces, states and belts, those that stretch too, with LAPACK in between: the same machine gives the same."""
    assert digests(PYTHONHASHSEED="1") == digests_of("this one")


@pytest.mark.slow
@elsewhere
def test_a_belt_that_stretches_is_the_same_but_for_rounding(machine):
    """The complete model's modes come from LAPACK: on another kind of machine they differ in their last bits."""
    found, expected = (np.array(digests_of(name)[3]) for name in (machine, "this one"))
    # eigenvectors of 4x4 matrices, of condition 100 or so: some hundred roundings of 2^-53
    assert np.abs(found - expected).max() <= 1e-13 * np.abs(expected).max()
