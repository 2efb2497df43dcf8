"""Many events at once give the bits of the same events one by one, whatever they are, compiled and interpreted."""

from __future__ import annotations

import hashlib
import io
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC
from rosbags.typesys import Stores, get_typestore
from test_build import SOURCE_ONLY, output

from tire_dynamics.build_state import how_to_compile, is_compiled
from tire_dynamics.cdr import messages
from tire_dynamics.estimator.belt import ring_angles
from tire_dynamics.estimator.vehicle import Vehicle
from tire_dynamics.replay.pipeline import TICK, Events, Pipeline
from tire_dynamics.science.elementary import cos_sin

store = get_typestore(Stores.ROS2_JAZZY)
T = store.types

MS = 1_000_000  # ns
NOW = 1_800_000_000_000_000_000
WHEELS, JOINTS = ("left", "right", "third"), ("left", "Gelenk_ä", "third")
PARAMETERS = {
    "wheels": list(WHEELS), "joint_names": list(JOINTS), "frame_ids": ["left_axle", "Achse_ö", "third_axle"],
    "ring_samples": 7, "n_max": 5, "rate_hz": 500.0, "ring_rate_hz": 166.0, "input_timeout_s": 0.02,
    "max_speed_rad_s": 500.0, "max_load_n": 50e3, "ring_shape_scale": 3.0, "tire.sidewall_damping": "reaction",
    "tire.contact_half_angle": 0.1,
}  # fmt: skip
VARYING = {
    "tire.radial_nonuniformity": [2.0, 0.1, 0.4], "tire.tangential_nonuniformity": [2.0, 0.05, 1.0],
    "tire.imbalance_mass": 0.05, "tire.imbalance_angle": 2.0, "tire.radial_runout": [1.0, 5e-4, 0.3, 5.0, 1e-4, 1.0],
}  # fmt: skip
TIRES = {
    "uniform": {},
    "varying": VARYING,
    "longitudinally compliant": {**VARYING, "tire.longitudinal_stiffness": 2e5, "tire.longitudinal_mass": 20.0},
}
MODELS = ("inextensional", "complete")
KINDS = {"tick": 0.3, "joints": 0.15, "speed": 0.1, "load": 0.3, "load_force": 0.1, "other": 0.05}
ODD_VALUES = (np.nan, np.inf, -np.inf, 1e9, -3.0, 0.0, -0.0, 5e-324)
FOOTER = b"\x02" + (20).to_bytes(8, "little") + bytes(20) + MCAP0_MAGIC  # ends a stream of records
FRAMES = ("", "contact", "contact_2", "Reifen_ü", "x" * 300)


def parameters(tire="uniform", model="inextensional", **changes):
    return {**PARAMETERS, **TIRES[tire], "model": model, **changes}


# -- events -----------------------------------------------------------------------------------------------------


def header(stamp, frame):
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), frame)


def cdr(message, kind, little):
    return bytes(store.serialize_cdr(message, kind, little_endian=little))


def wrench(stamp, frame, x, z, little=True):
    vector = T["geometry_msgs/msg/Vector3"]
    value = T["geometry_msgs/msg/Wrench"](vector(x, 7.0, z), vector(1.0, 2.0, 3.0))
    return cdr(T[messages.WRENCH_STAMPED](header(stamp, frame), value), messages.WRENCH_STAMPED, little)


def joints(stamp, frame, names, positions, velocities, efforts, little=True):
    arrays = (np.array(values, np.float64) for values in (positions, velocities, efforts))
    return cdr(T[messages.JOINT_STATE](header(stamp, frame), list(names), *arrays), messages.JOINT_STATE, little)


def number(value, little=True):
    return cdr(T[messages.FLOAT64](value), messages.FLOAT64, little)


def damaged(rng, data):
    """What a message is not, or not quite: cut off, longer, with another byte, with a time that is none."""
    kind = rng.integers(4)
    if kind == 0:
        return data[: rng.integers(len(data) + 1)]
    if kind == 1:
        return data + bytes(rng.integers(1, 9))
    if kind == 2:
        place = rng.integers(len(data))
        return data[:place] + bytes([rng.integers(256)]) + data[place + 1 :]
    return data[:8] + b"\xff\xff\xff\xff" + data[12:]


def random_joint_state(rng, stamp, speed, odd):
    names = list(JOINTS) if not odd else [*JOINTS[::-1], "arm", JOINTS[0]][: rng.integers(0, 6)]
    if odd and rng.random() < 0.3:
        names = [f"{name}{suffix}" for name, suffix in zip(names, ("", "_2", "\x01"), strict=False)]
    velocities = (speed + np.arange(len(names))).tolist()
    positions = rng.uniform(-50.0, 50.0, len(names))
    if rng.random() < 0.2:
        positions[:2] = rng.integers(0, 2)
    if rng.random() < 0.2:
        positions = np.where(positions > 0.0, positions, np.nan) if odd else positions[:0]
    if odd and rng.random() < 0.3:
        velocities = velocities[1:]
    efforts = [0.5] * int(rng.choice([0, len(names), 1]))
    frame = str(rng.choice(FRAMES)) if odd else ""
    return joints(stamp, frame, names, positions, velocities, efforts, not odd or rng.random() < 0.5)


def random_events(seed, count, irregular):
    """Topic, time of receipt, time of publication, time to advance to and message of events in order of receipt.

    As a node gets them, but for ``irregular``, the share of odd ones.
    """
    rng = np.random.default_rng(seed)
    now, events, stamps = NOW, [], {}
    for _ in range(count):
        now += int(rng.integers(1, MS))
        kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
        wheel = int(rng.integers(len(WHEELS)))
        odd = rng.random() < irregular
        stamp = max(now - int(rng.integers(0, 3 * MS)), stamps.get((kind, wheel), 0) + 1)
        if odd:
            near = stamp - 5 * MS, stamps.get((kind, wheel), now), *(now + ms * MS for ms in (-25, 10, 30))
            stamp = int(rng.choice([*near, 0, -1, -(2**31) * 10**9, 2**31 * 10**9 - 1]))
        else:
            stamps[kind, wheel] = stamp
        value = float(rng.normal(100.0, 20.0))
        if odd and rng.random() < 0.5:
            value = float(rng.choice(ODD_VALUES))
        little = not odd or rng.random() < 0.5
        tick = 0
        if kind == "tick":
            step = -int(rng.integers(0, 5 * MS)) if odd and rng.random() < 0.2 else 0
            topic, tick, data = TICK, now + step, messages.encode_clock(now + step)
        elif kind == "joints":
            topic, data = "joint_states", random_joint_state(rng, stamp, value, odd)
        elif kind == "other":
            topic, data = str(rng.choice(["", "unknown"])), bytes(rng.integers(0, 30))
        elif kind == "load":
            frame = str(rng.choice(FRAMES)) if odd else "contact"
            traction = value if odd else 3.0 * value
            topic, data = f"{WHEELS[wheel]}/load", wrench(stamp, frame, traction, 40.0 * value, little)
        elif kind == "load_force":
            topic, data = f"{WHEELS[wheel]}/load_force", number(40.0 * value, little)
        else:
            topic, data = f"{WHEELS[wheel]}/wheel_speed", number(value, little)
        if odd and kind != "tick" and rng.random() < 0.3:
            data = damaged(rng, data)
        events.append((topic, now, tick or now - int(rng.integers(0, MS)), tick, data))
    return events


# -- the same events in three ways --------------------------------------------------------------------------------


def one_by_one(pipeline, events):
    """Each input received, each tick made: topic and message of every output, with the event's number."""
    seen = []
    for place, (topic, received, _, tick, data) in enumerate(events):
        if topic == TICK:
            seen += [(place, *output) for output in pipeline.tick(tick) + pipeline.belts()]
        elif topic in pipeline.inputs:
            pipeline.receive(topic, received, data)
    return seen


def through_the_vehicle(values, events):
    """The same by the decoders and encoders of messages around a Vehicle; with its state, and what was malformed."""
    pipeline = Pipeline(values)  # for its complete parameters
    vehicle = Vehicle(pipeline.vehicle.settings)
    samples, scale = values["ring_samples"], values["ring_shape_scale"]
    cosine, sine = cos_sin(ring_angles(samples))
    ring = messages.DeflectionEncoder(samples)
    seen, malformed = [], Counter()
    for place, (topic, received, _, tick, data) in enumerate(events):
        wheel, _, kind = topic.rpartition("/")
        try:
            if topic == TICK:
                for force in vehicle.tick(tick):
                    encoder = messages.WrenchEncoder(values["frame_ids"][force.wheel])
                    data = encoder.encode(tick, force.force_x, force.force_z)
                    seen.append((place, f"{WHEELS[force.wheel]}/axle_wrench", data))
                for belt in vehicle.belts():
                    seen.append((place, f"{WHEELS[belt.wheel]}/ring_deflection", ring.encode(belt.deflection)))
                    radial, tangential = belt.deflection
                    x = (vehicle.unit.radius + scale * radial) * -cosine + scale * tangential * sine
                    z = (vehicle.unit.radius + scale * radial) * sine + scale * tangential * cosine
                    points = np.stack([x, np.zeros(samples), z, radial, tangential], axis=1)
                    encoder = messages.RingShapeEncoder(values["frame_ids"][belt.wheel], samples)
                    seen.append((place, f"{WHEELS[belt.wheel]}/ring_shape", encoder.encode(tick, points)))
            elif topic == "joint_states":
                state = messages.JointStateDecoder().decode(data)
                vehicle.joint_states(received, state.stamp_ns, state.names, state.velocities, state.positions)
            elif kind == "load":
                force = messages.decode_wrench(data)
                vehicle.load(WHEELS.index(wheel), received, force.stamp_ns, force.fz, force.fx)
            elif kind == "load_force":
                vehicle.load(WHEELS.index(wheel), received, received, messages.decode_float64(data), 0.0)
            elif kind == "wheel_speed":
                vehicle.wheel_speed(WHEELS.index(wheel), received, messages.decode_float64(data))
        except messages.MessageError:
            malformed[topic] += 1
    return seen, state_of(vehicle), malformed


def columns_of(events, rng):
    """The events as columns, their messages among other bytes."""
    topics = tuple(dict.fromkeys(event[0] for event in events))
    data, starts = bytearray(), []
    for event in events:
        data += bytes(rng.integers(0, 256, rng.integers(0, 3), dtype=np.uint8))
        starts.append(len(data))
        data += event[4]
    places, sizes = [topics.index(event[0]) for event in events], [len(event[4]) for event in events]
    times = list(zip(*events, strict=True))[1:4]
    topic, received, published, tick, start, size = (
        np.array(column, np.int64) for column in (places, *times, starts, sizes)
    )
    return Events(topics, topic, received, published, tick, bytes(data), start, size)


def at_once(pipeline, events, rng, longest=60):
    """In stretches of random lengths: outputs as :func:`one_by_one` has them, the records looked at on the way."""
    names = [*pipeline.inputs, *pipeline.outputs, TICK, "unknown"]
    channels = {name: 3 + 7 * place for place, name in enumerate(names) if name != "right/wheel_speed"}
    name_of = {channel: name for name, channel in channels.items()}
    seen, first = [], 0
    while first < len(events):
        stretch = events[first : first + int(rng.integers(1, longest))]
        records = pipeline.run(columns_of(stretch, rng), channels)
        *found, _ = StreamReader(io.BytesIO(bytes(records.data) + FOOTER), skip_magic=True).records
        assert all(isinstance(record, Message) for record in found)
        assert np.diff([*records.starts, len(records.data)]).tolist() == [31 + len(record.data) for record in found]
        assert records.received == Counter(event[0] for event in stretch)
        outputs, at = Counter(), 0
        for place, (topic, received, published, _, data) in enumerate(stretch):
            if topic in channels:
                own = found[at]
                assert (name_of[own.channel_id], own.data) == (topic, data)
                assert (own.log_time, own.publish_time) == (received, published)
                at += 1
            while at < len(found) and name_of[found[at].channel_id] in pipeline.outputs:
                assert topic == TICK and (found[at].log_time, found[at].publish_time) == (received, published)
                outputs[name_of[found[at].channel_id]] += 1
                seen.append((first + place, name_of[found[at].channel_id], found[at].data))
                at += 1
        assert records.written == outputs and at == len(found)
        first += len(stretch)
    return seen


def state_of(vehicle):
    """What later outputs and the diagnostics depend on."""
    counts = [[dict(each.counts), each.stops, each.divergences] for each in vehicle.inputs]
    return json.dumps([vehicle.snapshot(), counts, vehicle.time, vehicle.clock_resets], sort_keys=True)


def same_in_all_ways(values, events, seed):
    """The outputs, which are the same bits in every way."""
    single, many = Pipeline(values), Pipeline(values)
    expected, state, malformed = through_the_vehicle(values, events)
    assert one_by_one(single, events) == expected
    assert at_once(many, events, np.random.default_rng(seed)) == expected
    assert state_of(single.vehicle) == state_of(many.vehicle) == state
    assert single.malformed == many.malformed == malformed
    assert single.message_counts == many.message_counts
    return expected, many


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("tire", TIRES)
@examples(6, nightly=60)
@given(seed=st.integers(0, 2**32 - 1), irregular=st.sampled_from([0.0, 0.02, 0.1, 0.5]))
def test_at_once_is_one_by_one(model, tire, seed, irregular):
    same_in_all_ways(parameters(tire, model), random_events(seed, 200, irregular), seed)


def test_the_odd_events_are_there():
    """What the comparison above is worth: every outcome, malformed messages, stops and restarts, and many outputs."""
    counted, malformed, outputs, resets, stops, no_velocity = Counter(), Counter(), Counter(), 0, 0, 0
    for seed in range(4):
        seen, pipeline = same_in_all_ways(parameters(), random_events(seed, 600, 0.2), seed)
        for each in pipeline.vehicle.inputs:
            counted.update(each.counts)
            stops += each.stops
        malformed.update(pipeline.malformed)
        resets += pipeline.vehicle.clock_resets
        no_velocity += pipeline.message_counts["no velocity"]
        outputs.update(topic.partition("/")[2] for _, topic, _ in seen)
    everything = {
        *("taken", "late", "repeated", "out of order", "not finite", "no stamp", "in the future", "speed too high"),
        *("load too high", "off the ground", "joint twice"),
    }
    assert set(counted) == everything
    assert {topic.rpartition("/")[2] for topic in malformed} == {"joint_states", "wheel_speed", "load", "load_force"}
    assert min(resets, stops, no_velocity) > 3
    assert outputs["axle_wrench"] > 300 and outputs["ring_deflection"] == outputs["ring_shape"] > 50


@pytest.mark.parametrize("missing", ["left", "all"])
def test_a_wheel_that_waits_for_an_input_holds_nobody_up(missing):
    loads = tuple(f"{wheel}/load{ending}" for wheel in WHEELS for ending in ("", "_force"))
    gone = loads if missing == "all" else loads[:2]
    events = [event for event in random_events(5, 500, 0.0) if event[0] not in gone]
    seen, _ = same_in_all_ways(parameters(), events, 5)
    moved = {topic.partition("/")[0] for _, topic, _ in seen}
    assert moved == (set() if missing == "all" else {"right", "third"})


def test_a_motion_that_diverges_is_given_up_at_the_same_tick():
    """Beyond its stability limit a wheel grows until it is given up."""
    values = parameters(
        **{"tire.zeta_s": 0.0, "tire.zeta_1": 0.5, "max_speed_rad_s": 3000.0, "ring_samples": 3, "n_max": 2}
    )
    events = []
    for k in range(400):
        now = NOW + k * 2 * MS
        for place, wheel in enumerate(WHEELS):
            events.append((f"{wheel}/wheel_speed", now, now, 0, number(2500.0 if k < 350 or place else 50.0)))
            events.append((f"{wheel}/load", now, now, 0, wrench(now, "", 0.0, 4000.0 + place + k % 7)))
        events.append((TICK, now, now, now, messages.encode_clock(now)))
    _, pipeline = same_in_all_ways(values, events, 2)
    assert [each.divergences for each in pipeline.vehicle.inputs] == [1, 1, 1]
    assert [each.running for each in pipeline.vehicle.inputs] == [True, False, False]


def test_samples_that_wait_without_number():
    """More at once than there was room for, each for its own time."""
    events = []
    for k in range(500):
        stamp = NOW + (k * 7919) % 500 * 30_000  # within the timeout, in any order
        events.append((f"{WHEELS[k % 3]}/load", NOW + k, NOW, 0, wrench(stamp, "", 0.0, 4000.0 + k)))
        if k % 5 == 0:
            events.append(("joint_states", NOW + k, NOW, 0, joints(stamp, "", JOINTS, [], [90.0 + k] * 3, [])))
    events += [(TICK, NOW + k * MS, NOW, NOW + k * MS, messages.encode_clock(NOW + k * MS)) for k in range(1, 16)]
    seen, pipeline = same_in_all_ways(parameters(), events, 1)
    assert len(seen) > 30 and sum(each.counts["taken"] for each in pipeline.vehicle.inputs) > 500


@pytest.mark.parametrize("moment", [2**31 * 10**9, -(2**31) * 10**9 - 1])
def test_a_tick_outside_ros_time_is_refused_before_anything_is_done(moment):
    pipeline, events = Pipeline(parameters()), random_events(7, 50, 0.0)
    before = state_of(pipeline.vehicle)
    events.insert(40, (TICK, NOW, NOW, moment, messages.encode_clock(0)))
    with pytest.raises(messages.MessageError, match=f"{moment} ns is outside the range"):
        channels = dict.fromkeys([*pipeline.inputs, *pipeline.outputs], 1)
        pipeline.run(columns_of(events, np.random.default_rng(1)), channels)
    with pytest.raises(messages.MessageError, match=f"{moment} ns is outside the range"):
        pipeline.tick(moment)
    assert state_of(pipeline.vehicle) == before


def test_no_events_are_nothing():
    pipeline = Pipeline(parameters())
    records = pipeline.run(columns_of(random_events(1, 3, 0.0), np.random.default_rng(1)).part(slice(0, 0)),
                         dict.fromkeys([*pipeline.inputs, *pipeline.outputs, TICK], 1))  # fmt: skip
    assert (len(records.data), len(records.starts), records.received, records.written) == (0, 0, {}, {})


# -- compiled and interpreted -------------------------------------------------------------------------------------

SEEDS = range(2)


def bits_of_everything() -> str:
    """A hash of all outputs and states of some hundred events for each model and tire, half of them odd or less."""
    bits = hashlib.sha256()
    for model in MODELS:
        for tire in TIRES:
            for seed in SEEDS:
                values = parameters(tire, model)
                events = random_events(seed, 250 if tire == "uniform" else 80, 0.1 * seed)
                pipeline = Pipeline(values)
                for place, topic, data in at_once(pipeline, events, np.random.default_rng(seed)):
                    bits.update(f"{place} {topic} ".encode() + data)
                bits.update(state_of(pipeline.vehicle).encode())
    return bits.hexdigest()


@pytest.mark.slow
def test_the_source_interpreted_has_the_bits_of_the_compiled_core():
    if not is_compiled():
        pytest.skip(how_to_compile())
    program = f"{SOURCE_ONLY}\nsys.path.insert(0, {str(Path(__file__).parent)!r})\n" + (
        "from tire_dynamics import build_state\nimport test_drive\n"
        "print(build_state.is_compiled(), test_drive.bits_of_everything())\n"
    )
    folder = str(Path(__file__).parents[1])
    assert output(sys.executable, "-c", program, PWD=folder).split() == ["False", bits_of_everything()]
