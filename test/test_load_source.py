"""Loads that the node estimates: the pipeline that it and the replay run, its parameters, and the covariance."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from simulated_car import Car, Drive, simulate_drives

from tire_dynamics import LoadFilter, TireWheelUnit, estimate_loads, read_vehicle
from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cli.main import main
from tire_dynamics.replay.parameters import complete
from tire_dynamics.replay.pipeline import Pipeline
from tire_dynamics.replay.replay import replay
from tire_dynamics.report.findings import summary
from tire_dynamics.report.gather import gather
from tire_dynamics.science.axle_variance import axle_force_covariance
from tire_dynamics.science.response import frequency_response

CAR = read_vehicle(Path(__file__).parents[1] / "config" / "car.yaml")
WHEELS = ["front_left", "front_right", "rear_left", "rear_right"]
STORE = get_typestore(Stores.ROS2_JAZZY)
MILLISECOND = 1_000_000
ARRAY, IMU = "std_msgs/msg/Float32MultiArray", "sensor_msgs/msg/Imu"
PARAMETERS = {
    "wheels": WHEELS,
    "load_source": "estimate",
    "ring_samples": 8,
    "n_max": 4,
    "tire.sidewall_damping": "reaction",
    "tire.zeta_s": 0.3,
    **{
        f"vehicle.{name}": [float(each) for each in value] if isinstance(value, list) else float(value)
        for name, value in CAR.to_mapping().items()
    },
    "inputs.imu.topic": "imu",
    "inputs.imu.type": IMU,
    "inputs.travel.topic": "travel",
    "inputs.travel.type": ARRAY,
    "inputs.travel.field": "data",
    "inputs.travel.unit": "mm",
    "inputs.hub_acceleration.topic": "hubs",
    "inputs.hub_acceleration.type": ARRAY,
    "inputs.hub_acceleration.field": "data",
}


def encode(kind, **fields):
    return bytes(STORE.serialize_cdr(STORE.types[kind](**fields), kind))


def array(values):
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return encode(ARRAY, layout=layout, data=np.asarray(values, np.float32))


def imu(stamp, force, rate):
    types = STORE.types
    vector = types["geometry_msgs/msg/Vector3"]
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    nine = np.zeros(9)
    return encode(
        IMU,
        header=types["std_msgs/msg/Header"](stamp=time, frame_id="base_link"),
        orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=nine,
        angular_velocity=vector(*rate),
        angular_velocity_covariance=nine,
        linear_acceleration=vector(*force),
        linear_acceleration_covariance=nine,
    )


@pytest.fixture(scope="module")
def recording():
    return simulate_drives(Car(), [Drive(duration=2.0, bump=0.0)], [3])[0]


def messages_of(recording, begin=10**9, late=0, names=("imu", "travel", "hub", "wheel_speed")):
    """Topic, time of receipt and bytes; an IMU's are received later than they are stamped."""
    joints, found = messages.JointStateEncoder(WHEELS), []
    for name in names:
        source = getattr(recording, name)
        for row, time in enumerate(source[0]):
            stamp = begin + round(1e9 * time)
            if name == "imu":
                found.append(("imu", stamp + late, imu(stamp, source[1][row].tolist(), source[2][row].tolist())))
            elif name == "wheel_speed":
                found.append(("joint_states", stamp, joints.encode(stamp, source[1][row].tolist())))
            else:
                topic, factor = ("travel", 1e3) if name == "travel" else ("hubs", 1.0)
                found.append((topic, stamp, array(factor * source[1][row])))
    return sorted(found, key=lambda message: message[1])


def sources_of(recording, begin=1.0):
    """What the messages carry: travel and hubs as single precision has them, the IMU's as it was."""
    travel, hub = recording.travel, recording.hub
    speeds = recording.wheel_speed
    return {
        "imu": (recording.imu[0] + begin, *recording.imu[1:]),
        "travel": (travel[0] + begin, (1e3 * travel[1]).astype(np.float32).astype(np.float64) * 1e-3),
        "hub": (hub[0] + begin, hub[1].astype(np.float32).astype(np.float64)),
        "wheel_speed": (speeds[0] + begin, speeds[1]),
    }


def drive_on(pipeline, inputs, begin, end, period=2 * MILLISECOND):
    """The outputs of the ticks after ``begin``, by topic: time of the tick and bytes."""
    outputs, waiting = {}, list(inputs)
    for now in range(begin + period, end + 1, period):
        while waiting and waiting[0][1] <= now:
            topic, received, data = waiting.pop(0)
            pipeline.receive(topic, received, data)
        for topic, data in pipeline.tick(now) + pipeline.belts():
            outputs.setdefault(topic, []).append((now, data))
    return outputs


def floats(outputs, name):
    """Times and values of four wheels."""
    decode = messages.WrenchDecoder().decode
    columns = []
    for wheel in WHEELS:
        rows = outputs[f"{wheel}/{name}"]
        columns.append([decode(data).fz for _, data in rows])
    return [now for now, _ in outputs[f"{WHEELS[0]}/{name}"]], np.array(columns).T


def test_the_estimate_is_that_of_estimate_loads_bit_for_bit_and_drives_the_wheels(recording):
    pipeline = Pipeline(PARAMETERS)
    assert "front_left/load" not in pipeline.inputs and "front_left/load_estimate" in pipeline.outputs
    outputs = drive_on(pipeline, messages_of(recording), 10**9 - 2 * MILLISECOND, 2 * 10**9)
    times, load = floats(outputs, "load_estimate")
    expected = estimate_loads(CAR, **sources_of(recording), at=np.array(times) * 1e-9)
    assert load.tobytes() == expected.load.tobytes()
    for k, wheel in enumerate(WHEELS):  # at the belts' rate, each wheel's in its turn
        deviations = outputs[f"{wheel}/load_standard_deviation"]
        assert len(deviations) == pytest.approx(len(times) / 10, abs=1)
        for now, data in deviations:
            assert messages.decode_float64(data) == expected.standard_deviation[times.index(now), k]
    # a wheel on its suspension follows a slow load: the mean axle force is that of the load
    _, force = floats(outputs, "axle_wrench")
    np.testing.assert_allclose(force[-250:].mean(0), load[-250:].mean(0), rtol=0.03)
    decoded = messages.WrenchDecoder().decode(outputs["front_left/load_estimate"][5][1])
    assert decoded.stamp_ns == times[5] and decoded.fx == 0.0


def test_a_record_goes_on_bit_for_bit(recording):
    """What a log's record has is enough to go on with: late samples, a sample of part of the wheels, all."""
    inputs = messages_of(recording, late=12 * MILLISECOND)
    cut, end = 10**9 + 300 * MILLISECOND, 10**9 + 600 * MILLISECOND
    one, two = Pipeline(PARAMETERS), Pipeline(PARAMETERS)
    before = [message for message in inputs if message[1] <= cut]
    drive_on(one, before, 10**9 - 2 * MILLISECOND, cut)
    two.restore(json.loads(messages.decode_string(one.record({}))))
    after = inputs[len(before) :]
    assert drive_on(one, after, cut, end) == drive_on(two, after, cut, end)


def test_wheels_that_have_topics_of_their_own_make_one_sample(recording):
    types, point = STORE.types, "geometry_msgs/msg/PointStamped"
    own = {"inputs.travel.topic": "{wheel}/travel", "inputs.travel.type": point, "inputs.travel.field": "point.z"}
    pipeline = Pipeline({**PARAMETERS, **own})
    direct = LoadFilter(CAR)
    for row in range(50):
        stamp = 10**9 + row * 10 * MILLISECOND
        values = (1e3 * recording.travel[1][row]).tolist()
        time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="")
        for wheel, value in zip(WHEELS, values, strict=True):
            data = encode(point, header=header, point=types["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=value))
            pipeline.receive(f"{wheel}/travel", stamp, data)
        direct.add_travel(stamp, [1e-3 * value for value in values])
        outputs = dict(pipeline.tick(stamp))
        direct.advance(stamp)
    [decode] = {messages.WrenchDecoder().decode}
    assert [decode(outputs[f"{wheel}/load_estimate"]).fz for wheel in WHEELS] == direct.load.tolist()


def test_sources_that_vanish_and_a_clock_set_back(recording):
    """Without any source there is no load, hence no force; when they come again it goes on, whatever the clock."""
    pipeline = Pipeline(PARAMETERS)
    inputs = messages_of(recording)
    middle = 10**9 + 500 * MILLISECOND
    drive_on(pipeline, [each for each in inputs if each[1] <= middle], 10**9 - 2 * MILLISECOND, middle)
    assert pipeline.loads.filter.sources == ("wheel_speed", "imu", "travel", "hub")
    gone = drive_on(pipeline, [], middle, middle + 800 * MILLISECOND)
    assert gone["front_left/load_estimate"][-1][0] <= middle + 500 * MILLISECOND
    assert gone["front_left/axle_wrench"][-1][0] <= middle + 800 * MILLISECOND
    assert not pipeline.loads.filter.running
    begin = 10**9 // 2  # before what has been
    again = drive_on(pipeline, messages_of(recording, begin), begin, begin + 300 * MILLISECOND)
    assert len(again["front_left/axle_wrench"]) > 100
    assert pipeline.vehicle.clock_resets == 1


def test_stamps_in_the_future_are_refused(recording):
    pipeline = Pipeline(PARAMETERS)
    pipeline.receive("imu", 10**9, imu(10**9 + 201 * MILLISECOND, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0)))
    assert pipeline.loads.in_the_future == {"imu": 1}
    assert pipeline.tick(2 * 10**9) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vehicle.wheelbase": 0.0, "vehicle.spring_rates": ()}, "missing: wheelbase [m], spring_rates [4 x N/m]"),
        ({"vehicle.sprung_mass": 1e-9}, "vehicle.sprung_mass is 1e-09"),
        ({"vehicle.tracks": [1.5]}, "vehicle.tracks is (1.5,); it must be a list of 2 numbers"),
        ({"wheels": ["a", "b"]}, "front left, front right, rear left, rear right"),
        ({"inputs.load.topic": "loads", "inputs.load.field": "data"}, "inputs.load.topic is given"),
    ],
)
def test_without_a_car_it_refuses(changes, message):
    with pytest.raises(ValueError) as caught:
        complete({**PARAMETERS, **changes})
    assert message in str(caught.value)


def test_without_any_vehicle_parameter_all_that_are_needed_are_listed():
    with pytest.raises(ValueError, match=r"missing: sprung_mass \[kg\], .*anti_roll_rates \[2 x N/m\]$"):
        complete({"load_source": "estimate", "wheels": WHEELS})


# --- bags ---


@pytest.fixture
def bag(tmp_path, recording):
    with BagWriter(tmp_path / "bag") as writer:
        handles = {
            "imu": writer.add_topic("/imu", IMU),
            "travel": writer.add_topic("/travel", ARRAY),
            "hubs": writer.add_topic("/hubs", ARRAY),
            "joint_states": writer.add_topic("/joint_states", messages.JOINT_STATE),
        }
        for topic, received, data in messages_of(recording):
            writer.write(handles[topic], received, received, data)
    return tmp_path / "bag"


def written(path, names):
    reader, found = BagReader(path), {name: [] for name in names}
    for message in reader.messages([f"/{name}" for name in names]):
        found[message[0].lstrip("/")].append(message[4])
    return found


def parameter_file(path, parameters):
    path.write_text(json.dumps({"/**": {"ros__parameters": nested(parameters)}}))  # JSON is YAML
    return path


def nested(parameters):
    tree = {}
    for name, value in parameters.items():
        *parts, last = name.split(".")
        branch = tree
        for part in parts:
            branch = branch.setdefault(part, {})
        branch[last] = value
    return tree


def test_a_bag_and_the_replay_of_its_log(tmp_path, recording, bag):
    config = parameter_file(tmp_path / "estimate.yaml", {**PARAMETERS, "axle_wrench_covariance": True})
    replay(bag, tmp_path / "one", config=config)
    replay(tmp_path / "one", tmp_path / "two")
    names = [f"{wheel}/{name}" for wheel in WHEELS for name in (
        "axle_wrench", "load_estimate", "load_standard_deviation", "axle_wrench_covariance", "ring_shape",
    )]  # fmt: skip
    first = written(tmp_path / "one", names)
    assert all(first.values())
    assert written(tmp_path / "two", names) == first
    decode = messages.WrenchDecoder().decode
    wrenches = [[decode(data) for data in first[f"{wheel}/load_estimate"]] for wheel in WHEELS]
    times = np.array([each.stamp_ns for each in wrenches[0]])
    expected = estimate_loads(CAR, **sources_of(recording), at=times * 1e-9)
    assert np.array([[each.fz for each in wheel] for wheel in wrenches]).T.tobytes() == expected.load.tobytes()


def test_the_command_takes_a_car_by_its_file(tmp_path, bag, capsys):
    some = {name: value for name, value in PARAMETERS.items() if not name.startswith(("vehicle", "load_", "wheels"))}
    config = parameter_file(tmp_path / "map.yaml", some)
    car = str(Path(__file__).parents[1] / "config" / "car.yaml")
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), "--config", str(config), "--vehicle", car]) == 0
    assert written(tmp_path / "out", ["rear_right/load_estimate"])["rear_right/load_estimate"]
    (tmp_path / "car.yaml").write_text("sprung_mass: 1320.0\n")
    arguments = ["replay", str(bag), "-o", str(tmp_path / "no"), "--config", str(config)]
    capsys.readouterr()  # how it went
    assert main([*arguments, "--vehicle", str(tmp_path / "car.yaml")]) == 2
    line = capsys.readouterr().err
    assert "missing: unsprung_masses" in line and line.count("\n") == 1


# --- what reads logs ---


@pytest.fixture
def log(tmp_path, bag):
    config = parameter_file(tmp_path / "estimate.yaml", PARAMETERS)
    replay(bag, tmp_path / "log", config=config, quiet=True)
    return tmp_path / "log"


def bands_are_two_deviations(drive):
    """Of the load as it was stated, of the axle's force by the covariance that the node can publish."""
    from tire_dynamics.report.charts import force_figure

    def numbers(packed):
        return np.frombuffer(base64.b64decode(packed["bdata"]), "<f4").astype(float)

    bands = [trace for trace in force_figure(drive)["data"] if trace["meta"]["group"] == "deviation"]
    places = [(trace["meta"]["wheel"], trace["yaxis"]) for trace in bands]
    assert places == [(w, axis) for w in range(4) for axis in ("y", "y2")]
    for number, wheel in enumerate(drive.wheels):
        at, deviation = wheel.deviation.curve()
        corner = math.sqrt((CAR.spring_rates[number] + CAR.tire_rates[number]) / CAR.unsprung_masses[number])
        covariance = axle_force_covariance(drive.unit, wheel.mean_speed, corner / (2.0 * math.pi))
        factors, own = (1.0, math.sqrt(covariance[1, 1])), bands[2 * number : 2 * number + 2]
        for curve, factor, band in zip(("load_z", "axle_z"), factors, own, strict=True):
            x, y = numbers(band["x"]), numbers(band["y"])
            half = x.size // 2
            assert (x[:half] == x[: half - 1 : -1]).all()
            time, value = wheel.curves[curve].curve()
            expected = 2e-3 * factor * np.interp(x[:half], at, deviation)
            upper, lower = y[:half] - expected, y[: half - 1 : -1] + expected
            assert upper.max() == pytest.approx(1e-3 * value.max(), abs=1e-5)
            assert lower.min() == pytest.approx(1e-3 * value.min(), abs=1e-5)
            assert (upper >= lower - 1e-6).all()


def test_a_report_has_the_estimated_loads_with_their_deviations(tmp_path, log, capsys):
    pytest.importorskip("plotly", reason="plotly is not installed: the extra `report` brings it")
    drive = gather(BagReader(log), BagReader(log), quiet=True)
    names = [f"{wheel}/{name}" for wheel in WHEELS for name in ("load_estimate", "load_standard_deviation")]
    outputs = written(log, names)
    decode = messages.WrenchDecoder().decode
    for wheel in drive.wheels:
        loads = [decode(data).fz for data in outputs[f"{wheel.name}/load_estimate"]]
        deviations = [messages.decode_float64(data) for data in outputs[f"{wheel.name}/load_standard_deviation"]]
        numbers = wheel.numbers["load_z"]
        assert (numbers.count, numbers.high, wheel.outputs) == (len(loads), max(loads), len(loads))
        assert numbers.mean == pytest.approx(np.mean(loads), rel=1e-12)
        assert (wheel.deviations.count, wheel.deviations.high) == (len(deviations), max(deviations))
        assert wheel.deviations.mean == pytest.approx(np.mean(deviations), rel=1e-12)
    bands_are_two_deviations(drive)
    assert drive.sources == ("wheel_speed", "imu", "travel", "hub") and drive.band_hz == 20.0
    assert {each.topic: (each.messages, each.is_sensor) for each in drive.inputs} == {
        "/joint_states": (200, False), "/imu": (400, True), "/travel": (200, True), "/hubs": (1000, True),
    }  # fmt: skip
    assert main(["report", str(log), "-o", str(tmp_path / "page.html")]) == 0
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    for words in (
        "The loads are estimated, from hub accelerations, travel, the IMU and wheel speeds, and known up to 20 Hz",
        "load z sd [N]",
        f"{round(drive.wheels[0].deviations.mean)}<small>to {round(drive.wheels[0].deviations.high)}</small>",
        "Load z, estimated [kN]",
        "under loads that were estimated",
        "of the estimated load, which is known up to 20 Hz",
    ):
        assert words in text, words


def test_a_report_says_when_a_source_was_gone(tmp_path, recording):
    """An IMU that is gone for half a second stops no wheel; one that never came is not named."""
    gone = range(10**9 + 500 * MILLISECOND, 10**9 + 1000 * MILLISECOND)
    with BagWriter(tmp_path / "bag") as writer:
        handles = {
            "imu": writer.add_topic("/imu", IMU),
            "joint_states": writer.add_topic("/joint_states", messages.JOINT_STATE),
        }
        for topic, received, data in messages_of(recording, names=("imu", "wheel_speed")):
            if topic != "imu" or received not in gone:
                writer.write(handles[topic], received, received, data)
    some = {name: value for name, value in PARAMETERS.items() if "travel" not in name and "hub" not in name}
    replay(tmp_path / "bag", tmp_path / "log", config=parameter_file(tmp_path / "car.yaml", some), quiet=True)
    drive = gather(BagReader(tmp_path / "log"), BagReader(tmp_path / "log"), quiet=True)
    found = summary(drive, None)
    text = " ".join(each.text for each in found.findings)
    assert "The loads are estimated, from the IMU and wheel speeds, and known up to 2 Hz" in text
    [gap] = [each for each in found.findings if each.text.startswith("/imu")]
    assert gap.level == "warning" and gap.text.endswith("meanwhile the loads were estimated without it.")
    assert found.covered == [1.0] * 4


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        (PARAMETERS, "its loads are estimated"),
        (
            {"wheels": WHEELS, "inputs.load.topic": "hubs", "inputs.load.type": ARRAY, "inputs.load.field": "data"},
            "load come by a field map",
        ),
    ],
)
def test_identify_refuses_loads_that_it_cannot_use(tmp_path, bag, capsys, parameters, says):
    replay(bag, tmp_path / "log", config=parameter_file(tmp_path / "node.yaml", parameters), quiet=True)
    arguments = ["identify", str(tmp_path / "log"), "--measured", "/front_left/axle_wrench", "--wheel", "front_left"]
    capsys.readouterr()
    assert main([*arguments, "-o", str(tmp_path / "unit.yaml")]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert says in err and "record" in err and "front_left/load" in err
    assert not (tmp_path / "unit.yaml").exists()


# --- the axle's force ---


@pytest.mark.parametrize("model", ["inextensional", "complete"])
@pytest.mark.parametrize("speed", [0.0, 60.0, -150.0])
def test_the_covariance_is_the_integral_of_the_spectrum(model, speed):
    """Of a load whose spectrum is (2/(pi f_c))/(1 + (f/f_c)^2), with f = f_c tan(theta): the mean over theta."""
    unit = TireWheelUnit.table_1(zeta_s=0.3, zeta_1=0.1, longitudinal_stiffness=2e5, longitudinal_damping_ratio=0.2)
    corner, count = 11.0, 20_000
    theta = (np.arange(count) + 0.5) / count * (math.pi / 2.0)
    response = frequency_response(unit, speed, corner * np.tan(theta), model)[:, :, 0]
    expected = (response[:, :, None] * response[:, None, :].conj()).real.mean(0)
    found = axle_force_covariance(unit, speed, corner, model)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-6)  # the sum has the resonances to some 1e-3


def test_a_slow_error_reaches_the_axle_as_a_constant_load_does():
    unit = TireWheelUnit.table_1(zeta_s=0.3, sidewall_damping="reaction")
    found = axle_force_covariance(unit, 60.0, 1e-4)
    np.testing.assert_allclose(found, [[0.0, 0.0], [0.0, 1.0]], atol=1e-4)


def test_a_unit_that_is_not_stable_has_no_covariance():
    assert np.isnan(axle_force_covariance(TireWheelUnit.table_1(), 3000.0, 10.0)).all()


@pytest.mark.parametrize(("arguments", "name"), [((60.0, 0.0), "corner_hz"), ((math.nan, 1.0), "speed")])
def test_what_is_no_speed_or_corner_is_named(arguments, name):
    with pytest.raises(ValueError, match=name):
        axle_force_covariance(TireWheelUnit.table_1(), *arguments)


def test_the_covariance_follows_the_deviation(recording):
    pipeline = Pipeline({**PARAMETERS, "axle_wrench_covariance": True})
    begin = 10**9
    outputs = drive_on(pipeline, messages_of(recording), begin - 2 * MILLISECOND, begin + 200 * MILLISECOND)
    deviation = messages.decode_float64(outputs["front_left/load_standard_deviation"][-1][1])
    covariances = [data for _, data in outputs["front_left/axle_wrench_covariance"]]
    message = STORE.deserialize_cdr(covariances[-1], "std_msgs/msg/Float64MultiArray")
    assert [(dim.label, dim.size, dim.stride) for dim in message.layout.dim] == [("row", 6, 36), ("column", 6, 6)]
    values = message.data.reshape(6, 6)
    assert (values == values.T).all() and np.count_nonzero(values) == 4
    unit = pipeline.vehicle.unit
    speed = 5.0 * round(pipeline.vehicle.inputs[0].speed / 5.0)
    corner = math.sqrt((26e3 + 215e3) / 42.0) / (2.0 * math.pi)
    expected = axle_force_covariance(unit, speed, corner) * deviation**2
    np.testing.assert_allclose(values[np.ix_([0, 2], [0, 2])], expected, rtol=1e-12)
