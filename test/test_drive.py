"""Many events at once give the bits of the same events one by one, whatever they are, on both kernels."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit
from tire_dynamics.estimator.vehicle import Events, Vehicle, VehicleSettings
from tire_dynamics.science import kernels

MS = 1_000_000  # ns
NOW = 1_800_000_000_000_000_000
UNIT = TireWheelUnit.table_1(sidewall_damping="reaction", contact_half_angle=0.1)
VARYING = UNIT.replace(
    radial_nonuniformity=[(2, 0.1, 0.4)], tangential_nonuniformity=[(2, 0.05, 1.0)], imbalance_mass=0.05,
    imbalance_angle=2.0, radial_runout=[(1, 5e-4, 0.3), (5, 1e-4, 1.0)],
)  # fmt: skip
TIRES = {
    "uniform": UNIT,
    "varying": VARYING,
    "gives fore and aft": VARYING.replace(longitudinal_stiffness=2e5, longitudinal_mass=20.0),
}
NAMES = ("left", "right", "third")


def kernel_modules():
    yield "numpy", kernels
    try:
        from tire_dynamics.science import compiled
    except ImportError:
        return
    yield "compiled", compiled


KERNELS = dict(kernel_modules())


def settings_of(model="inextensional", unit=UNIT, **changes):
    return VehicleSettings(
        unit, NAMES, NAMES, period=2 * MS, ring_period=6 * MS, ring_samples=7, n_max=5, model=model,
        input_timeout=20 * MS, max_speed=500.0, max_load=50e3, **changes,
    )  # fmt: skip


# An event: kind, and what it takes. Times of receipt are those of the last tick plus something below a period.
def random_events(rng, number, *, irregular):
    """Ticks, speeds and loads as a node gets them, in order of receipt; ``irregular`` is the share of odd ones."""
    now, events, stamp = NOW, [], {}
    for _ in range(number):
        now += int(rng.integers(1, MS))
        kind = rng.choice(["tick", "joints", "speed", "load"], p=[0.3, 0.15, 0.15, 0.4])
        wheel = int(rng.integers(len(NAMES)))
        odd = rng.random() < irregular
        s = now - int(rng.integers(0, 3 * MS))
        s = max(s, stamp.get((kind, wheel), 0) + 1)
        if odd:
            s = int(rng.choice([0, now + 30 * MS, s - 5 * MS, stamp.get((kind, wheel), now), now - 25 * MS]))
        stamp[kind, wheel] = s
        value = float(rng.normal(100.0, 20.0))
        if odd and rng.random() < 0.5:
            value = float(rng.choice([np.nan, np.inf, -np.inf, 1e9, -3.0, 0.0, -0.0]))
        if kind == "tick":
            step = -int(rng.integers(0, 5 * MS)) if odd and rng.random() < 0.1 else 0
            events.append(("tick", now + step))
        elif kind == "joints":
            names = NAMES if not odd else (*NAMES[::-1], "arm", NAMES[0])[: int(rng.integers(1, 6))]
            count = len(names) - (odd and rng.random() < 0.3)
            positions = rng.uniform(-50.0, 50.0, len(names))
            if rng.random() < 0.2:
                positions[:2] = rng.integers(0, 2)
            if rng.random() < 0.2:
                positions = np.where(positions > 0.0, positions, np.nan) if odd else positions[:0]
            events.append(("joints", now, s, tuple(names), (value + np.arange(count)).tolist(), positions.tolist()))
        elif kind == "speed":
            events.append(("speed", wheel, now, value))
        else:
            events.append(("load", wheel, now, s, 40.0 * value, 3.0 * value if not odd else value))
    return events


def one_by_one(vehicle, events):
    seen = []
    for number, (kind, *values) in enumerate(events):
        if kind == "tick":
            outputs = vehicle.tick(values[0])
            seen += [(number, "force", *output) for output in outputs]
            seen += [(number, "belt", belt.wheel, belt.deflection.tobytes()) for belt in vehicle.belts()]
        elif kind == "joints":
            vehicle.joint_states(*values)
        elif kind == "speed":
            vehicle.wheel_speed(*values)
        else:
            vehicle.load(*values)
    return seen


def columns_of(events, first):
    """The same events as the columns that ``Vehicle.drive`` takes."""
    rows = [(first + number, *event) for number, event in enumerate(events)]
    ints = lambda values: np.array(list(values), np.int64)  # noqa: E731
    ticks = [row for row in rows if row[1] == "tick"]
    groups = {}
    for row in rows:
        if row[1] == "joints":
            groups.setdefault((row[4], len(row[5]), len(row[6]) == len(row[5])), []).append(row)
    joints = [
        (names, ints(r[0] for r in group), ints(r[2] for r in group), ints(r[3] for r in group),
         *(np.array([r[k] for r in group], float).reshape(len(group), count) if k == 5 or known else None
           for k in (5, 6)))
        for (names, count, known), group in groups.items()
    ]  # fmt: skip
    speeds, loads = [], []
    for wheel in range(len(NAMES)):
        mine = [row for row in rows if row[1] == "speed" and row[2] == wheel]
        speeds.append((ints(r[0] for r in mine), ints(r[3] for r in mine), np.array([r[4] for r in mine], float)))
        mine = [row for row in rows if row[1] == "load" and row[2] == wheel]
        values = np.array([r[5:7] for r in mine], float).reshape(-1, 2)
        loads.append((ints(r[0] for r in mine), ints(r[3] for r in mine), ints(r[4] for r in mine), values))
    return Events(ints(r[0] for r in ticks), ints(r[2] for r in ticks), joints, speeds, loads)


def at_once(vehicle, events, rng, tally=None):
    """In stretches of random lengths; those that cannot be taken at once one by one."""
    seen, first = [], 0
    while first < len(events):
        stretch = events[first : first + int(rng.integers(1, 60))]
        columns = columns_of(stretch, first)
        before = state_of(vehicle)
        outputs = vehicle.drive(columns)
        if tally is not None:
            tally[outputs is not None] += 1
        if outputs is None:
            assert state_of(vehicle) == before
            seen += [(first + number, *rest) for number, *rest in one_by_one(vehicle, stretch)]
        else:
            belts = {}
            for wheel, shown, mine in zip(outputs.wheels, outputs.shown, outputs.belts, strict=True):
                for tick, belt in zip(shown.tolist(), mine, strict=True):
                    belts.setdefault(tick, []).append((wheel, belt.tobytes()))
            for tick, place in enumerate(columns.tick_place.tolist()):
                for wheel, force in zip(outputs.wheels, outputs.forces[tick].tolist(), strict=True):
                    seen.append((place, "force", wheel, *force))
                seen += [(place, "belt", *belt) for belt in belts.get(tick, [])]
        first += len(stretch)
    return seen


def state_of(vehicle):
    """What later outputs and the diagnostics depend on, without taking up the steps that wait."""
    return json.dumps(
        [
            [schedule.snapshot(), schedule.counts, schedule.stops, schedule.divergences]
            for schedule in vehicle.schedules
        ]
        + [vehicle.time, vehicle.message_counts],
        sort_keys=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("tire", TIRES)
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), irregular=st.sampled_from([0.0, 0.0, 0.01, 0.1]))
def test_at_once_is_one_by_one(model, kernel, tire, seed, irregular):
    rng = np.random.default_rng(seed)
    events = random_events(rng, 300 if tire == "uniform" else 100, irregular=irregular)
    wanted = settings_of(model, TIRES[tire])
    single, many = Vehicle(wanted, kernels), Vehicle(wanted, KERNELS[kernel])
    expected = one_by_one(single, events)
    assert at_once(many, events, rng) == expected
    assert state_of(many) == state_of(single)
    assert many.snapshot() == single.snapshot()


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["left", "all loads"])
def test_a_wheel_that_waits_for_an_input_holds_nobody_up(missing):
    """The others are driven at once beside it."""
    rng = np.random.default_rng(5)
    events = [
        event
        for event in random_events(rng, 2000, irregular=0.0)
        if not (event[0] == "load" and (missing == "all loads" or event[1] == 0))
    ]
    single, many, tally = Vehicle(settings_of(), kernels), Vehicle(settings_of(), kernels), [0, 0]
    assert at_once(many, events, rng, tally) == one_by_one(single, events)
    assert state_of(many) == state_of(single)
    assert tally[True] > 3 * tally[False]


def test_regular_events_are_driven_at_once():
    rng = np.random.default_rng(11)
    tally = [0, 0]
    at_once(Vehicle(settings_of(), kernels), random_events(rng, 3000, irregular=0.0), rng, tally)
    # the others: the start, stretches of a few events without a tick, and wheels whose inputs are stale by chance
    assert tally[True] > 3 * tally[False]


def test_a_motion_that_diverges_is_left_to_the_single_calls():
    """Beyond its stability limit a wheel grows until it is given up, at the same tick either way."""
    unit = TireWheelUnit.table_1(sidewall_damping="reaction", zeta_s=0.0)
    rng = np.random.default_rng(2)
    events = []
    for k in range(1500):
        now = NOW + k * 2 * MS
        events += [("speed", wheel, now, 2500.0) for wheel in range(3)]
        events += [("load", wheel, now, now, 4000.0 + wheel + k % 7, 0.0) for wheel in range(3)]
        events.append(("tick", now))
    wild = VehicleSettings(unit, NAMES, NAMES, ring_samples=7, n_max=3, max_speed=3000.0)
    single, many = Vehicle(wild, kernels), Vehicle(wild, kernels)
    assert at_once(many, events, rng) == one_by_one(single, events)
    assert single.schedules[0].divergences > 0
    assert state_of(many) == state_of(single)


@pytest.mark.slow
@pytest.mark.skipif(len(KERNELS) == 1, reason="Numba is not installed: the extra `fast` brings it")
@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), complete=st.booleans())
def test_compiled_kernels_have_the_same_bits(seed, complete):
    """Random numbers through each of them, sizes and signs mixed."""
    rng = np.random.default_rng(seed)
    compiled = KERNELS["compiled"]
    n, m, J, W, T = (10 if complete else 6), 2, 5, 3, 6
    table = rng.normal(size=(J, 4, (n + m) * n))
    table[0] = 0.0
    table[0, 0, : n * n] = np.eye(n).ravel()  # a step of no length changes nothing
    speeds = rng.uniform(-1.0, 1.0, 9)
    found = [np.empty((9, J, table.shape[2])) for _ in range(2)]
    for module, result in zip((kernels, compiled), found, strict=True):
        module.series(table, speeds, result)
    assert np.array_equal(*found)

    counts = rng.integers(0, 4, (T, W))
    begin = np.concatenate([[0], np.cumsum(counts.sum(axis=0))[:-1]])
    stop = begin + np.cumsum(counts, axis=0)
    steps = int(counts.sum())
    columns = [rng.integers(1, 10**7, steps), rng.normal(0.0, 400.0, steps), *rng.normal(size=(m, steps))]
    arrays = (
        found[0].reshape(9, J, n + m, n), 2e-3, 300.0, np.stack(columns, axis=1), rng.integers(0, 9, steps),
        rng.normal(size=steps) * complete, np.where(rng.random(steps) < 0.2, rng.normal(size=steps), np.nan),
        begin, stop,
    )  # fmt: skip
    states, phases = [rng.normal(size=(W, n))] * 2, [rng.uniform(0.0, 6.0, W)] * 2
    states, phases = [each.copy() for each in states], [each.copy() for each in phases]
    found = [
        module.advance_first(state, phase, *arrays)
        for module, state, phase in zip((kernels, compiled), states, phases, strict=True)
    ]
    assert np.array_equal(*found) and np.array_equal(*states) and np.array_equal(*phases)

    p = 1 + complete
    wide = n + 2 * p
    sizes = rng.uniform(0.0, 1.0, 3) * [1e3, 1.0, 1e2]
    runout = rng.normal(size=(rng.integers(0, 7), 2))
    parts = (
        rng.normal(size=(wide, wide)) * 100.0, rng.normal(size=(wide, wide)) * 0.1, rng.normal(size=(wide, m)),
        rng.normal(size=(2 * p, n)), rng.normal(size=(p, 2)) * rng.integers(0, 2), rng.normal(size=(wide, 2)), runout,
        sizes, max(4, len(runout)),
    )  # fmt: skip
    durations = rng.choice([1e-4, 2e-3, 1e-2], steps)
    turning = np.stack([durations, *columns[1:]], axis=1), rng.normal(size=(steps, m)) * rng.integers(0, 2)
    found = [
        module.advance_turning(state, phase, *parts, *turning, *arrays[5:])
        for module, state, phase in zip((kernels, compiled), states, phases, strict=True)
    ]
    assert np.isfinite(found[0][0]).any() and np.array_equal(*states, equal_nan=True) and np.array_equal(*phases)
    assert all(np.array_equal(*pair, equal_nan=True) for pair in zip(*found, strict=True))
    states = [rng.normal(size=(W, n))] * 2
    wheel_x = rng.normal(size=2 * p)
    pulls = [module.axle_pull(states[0], phases[0], *parts[3:5], wheel_x) for module in (kernels, compiled)]
    assert np.array_equal(*pulls)
    output = rng.normal(size=(W, n, 2))
    read = [module.read(states[0], output) for module in (kernels, compiled)]
    assert np.array_equal(read[0][0], read[1][0]) and np.array_equal(read[0][1], read[1][1])

    N, k, C = 4, (4 if complete else 2), 5
    steps_of = np.cumsum([0, *rng.integers(0, 12, W)])
    total = int(steps_of[-1])
    changed = np.sort(rng.choice(total, min(C, total), replace=False))
    C = changed.size
    ends = [np.sort(rng.integers(a, b + 1, rng.integers(0, 4))) for a, b in itertools.pairwise(steps_of)]
    ends_of = np.cumsum([0, *(each.size for each in ends)])
    ends = np.concatenate(ends)
    exponents = rng.normal(size=(2, W + C, N, k)) * 10.0 ** rng.integers(-3, 4)
    exponents[0] = -np.abs(exponents[0])  # decaying, or the numbers grow beyond all bounds
    arrays = (
        exponents, rng.normal(size=(2, W + C, N, k, 2)), rng.normal(size=(2, C, N, k, k)),
        rng.normal(size=(2, C, N, k)),
        rng.integers(1, 10**10, total), rng.integers(0, 3, (total, 2)).astype(float), changed, ends, steps_of, ends_of,
    )  # fmt: skip
    own = rng.normal(size=(2, W, N, k))
    owns, outputs = [own.copy(), own.copy()], [np.zeros((2, ends.size, N, k)) for _ in range(2)]
    found = [
        module.follow(one, *arrays, output)
        for module, one, output in zip((kernels, compiled), owns, outputs, strict=True)
    ]
    assert all(np.array_equal(*pair) for pair in (owns, outputs, *zip(*found, strict=True)))

    amplitudes, basis = rng.normal(size=(5, 2, 8)), rng.normal(size=(8, 7))
    assert np.array_equal(kernels.deflections(amplitudes, basis), compiled.deflections(amplitudes, basis))
