"""The ready maps in config/inputs, each on a bag of the messages that it is for, whose types are not installed.

The definitions are the fields of the public ones; where each comes from stands in the map.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cli.info import info
from tire_dynamics.cli.main import main
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.bag_setup import bag_setup, pipeline_of
from tire_dynamics.replay.input_map import sources
from tire_dynamics.replay.parameters import PARAMETERS, complete, read_inputs
from tire_dynamics.replay.pipeline import Pipeline
from tire_dynamics.replay.replay import replay

MAPS = Path(__file__).parents[1] / "config" / "inputs"
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
RULE = "=" * 80
START = 1_700_000_000 * 10**9
OMEGA, LOAD, TRAVEL = (30.0, 31.0, 32.0, 33.0), (4100.0, 4000.0, 3600.0, 3500.0), (0.010, 0.012, -0.004, 0.006)
ANGLE, TRACTION = (0.1, 0.2, 0.3, 0.4), (10.0, -20.0, 30.0, -40.0)
FORCE, RATE = (0.5, -0.25, 9.75), (0.01, 0.02, -0.03)

TIME = f"{RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
HEADER = f"{RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{TIME}"
FOUR = "".join(f"float32 {wheel}\n" for wheel in WHEELS)
DEFINITIONS = {
    "tum_msgs/msg/TUMFloat64PerWheelStamped": (
        f"builtin_interfaces/Time stamp\ntum_msgs/TUMFloat64PerWheel data\n{RULE}\nMSG: tum_msgs/TUMFloat64PerWheel\n"
        + "".join(f"float64 {wheel}\n" for wheel in WHEELS)
        + TIME
    ),
    "raptor_dbw_msgs/msg/WheelSpeedReport": f"std_msgs/Header header\n{FOUR}{HEADER}",
    "deep_orange_msgs/msg/TireReport": "builtin_interfaces/Time stamp\n"
    + "".join(
        f"float32[] {w}_tire_temperature\nfloat32 {w}_damper_linear_potentiometer\nfloat32 {w}_tire_pressure\n"
        f"float32 {w}_tire_pressure_gauge\nfloat32 {w}_wheel_load\n"
        for w in ("fl", "fr", "rl", "rr")
    )
    + TIME,
    "ds_dbw_msgs/msg/WheelSpeeds": f"std_msgs/Header header\n{FOUR}{HEADER}",
    "ds_dbw_msgs/msg/VehicleVelocity": "std_msgs/Header header\nfloat32 vehicle_velocity_brake\n"
    "float32 vehicle_velocity_propulsion\nuint8 dir_src\nuint8 DIR_NONE=0\nuint8 DIR_PRNDL=1\nuint8 DIR_SENSOR=2\n"
    + HEADER,
    "tier4_vehicle_msgs/msg/WheelLinearSpeedReport": "builtin_interfaces/Time stamp\n"
    + "".join(f"float32 {wheel}_wheel_speed\n" for wheel in WHEELS)
    + TIME,
    "autoware_vehicle_msgs/msg/VelocityReport": "std_msgs/Header header\nfloat32 longitudinal_velocity\n"
    f"float32 lateral_velocity\nfloat32 heading_rate\n{HEADER}",
    "leo_msgs/msg/WheelStates": "builtin_interfaces/Time stamp\nfloat32[4] position\nfloat32[4] velocity\n"
    f"float32[4] torque\nfloat32[4] pwm_duty_cycle\n{TIME}",
    "racepak/msg/rp_wheel_encoders": FOUR,
    "racepak/msg/rp_shock_sensors": FOUR,
}
STORE = get_typestore(Stores.ROS2_JAZZY)
for _kind, _text in DEFINITIONS.items():
    STORE.register({n: f for n, f in get_types_from_msg(_text, _kind).items() if n not in STORE.fielddefs})


def made(kind, time=0, **fields):
    """A message; a header or stamp gets the time."""
    stamp = STORE.types["builtin_interfaces/msg/Time"](*divmod(START + time, 10**9))
    own = {name for name, _ in STORE.fielddefs[kind][1]}
    if "header" in own:
        fields["header"] = STORE.types["std_msgs/msg/Header"](stamp, "base_link")
    elif "stamp" in own:
        fields["stamp"] = stamp
    if missing := own - fields.keys():
        assert not missing, missing
    return kind, bytes(STORE.serialize_cdr(STORE.types[kind](**fields), kind))


def four(values, form="{}"):
    return {form.format(wheel): float(value) for wheel, value in zip(WHEELS, values, strict=True)}


def vector(x, y, z):
    return STORE.types["geometry_msgs/msg/Vector3"](x, y, z)


def imu(time):
    still = np.zeros(9)
    turned = STORE.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    return made(
        "sensor_msgs/msg/Imu", time, orientation=turned, orientation_covariance=still, angular_velocity=vector(*RATE),
        angular_velocity_covariance=still, linear_acceleration=vector(*FORCE), linear_acceleration_covariance=still,
    )  # fmt: skip


def joints(time):
    names = [f"{wheel}_{what}_joint" for what in ("wheel", "suspension") for wheel in reversed(WHEELS)]
    position = [*reversed(ANGLE), *(-value for value in reversed(TRAVEL))]
    velocity = [*reversed(OMEGA), 0.0, 0.0, 0.0, 0.0]
    arrays = {"position": np.array(position), "velocity": np.array(velocity), "effort": np.empty(0)}
    return made("sensor_msgs/msg/JointState", time, name=names, **arrays)


def wrench(time, z, x):
    whole = STORE.types["geometry_msgs/msg/Wrench"](vector(x, 0.0, z), vector(0.0, 0.0, 0.0))
    return made("geometry_msgs/msg/WrenchStamped", time, wrench=whole)


def per_wheel(time, values):
    data = STORE.types["tum_msgs/msg/TUMFloat64PerWheel"](**four(values))
    return made("tum_msgs/msg/TUMFloat64PerWheelStamped", time, data=data)


def array(values):
    layout = STORE.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    return made("std_msgs/msg/Float32MultiArray", layout=layout, data=np.array(values, np.float32))


def tires(time):
    fields = {}
    for k, w in enumerate(("fl", "fr", "rl", "rr")):
        fields[f"{w}_tire_temperature"] = np.full(16, 60.0, np.float32)
        fields |= {f"{w}_damper_linear_potentiometer": 1e3 * TRAVEL[k], f"{w}_tire_pressure": 1.0}
        fields |= {f"{w}_tire_pressure_gauge": 0.0, f"{w}_wheel_load": LOAD[k]}
    return made("deep_orange_msgs/msg/TireReport", time, **fields)


def leo(time):
    order = [0, 2, 1, 3]  # front left, rear left, front right, rear right
    arrays = {"position": np.array(ANGLE)[order], "velocity": np.array(OMEGA)[order], "torque": np.zeros(4)}
    arrays["pwm_duty_cycle"] = np.zeros(4)
    return made("leo_msgs/msg/WheelStates", time, **{name: a.astype(np.float32) for name, a in arrays.items()})


def velocity(time):
    speed = {"vehicle_velocity_brake": 0.0, "vehicle_velocity_propulsion": 9.5, "dir_src": 0}
    return made("ds_dbw_msgs/msg/VehicleVelocity", time, **speed)


def autoware(time):
    speed = {"longitudinal_velocity": 9.5, "lateral_velocity": 0.0, "heading_rate": 0.0}
    return made("autoware_vehicle_msgs/msg/VelocityReport", time, **speed)


RADIUS = 0.31
MESSAGES = {
    "open_car_dynamics": {
        "/simulation/sensor/wheelspeed_radps": lambda t: per_wheel(t, OMEGA),
        "/simulation/sensor/tire_force_vert": lambda t: per_wheel(t, LOAD),
        "/simulation/sensor/tire_force_long": lambda t: per_wheel(t, TRACTION),
    },
    "av21": {
        "/raptor_dbw_interface/wheel_speed_report": lambda t: made(
            "raptor_dbw_msgs/msg/WheelSpeedReport", t, **four([3.6 * RADIUS * omega for omega in OMEGA])
        ),
        "/raptor_dbw_interface/tire_report": tires,
    },
    "carla": {"/carla/telemetry": lambda t: array([*OMEGA, *LOAD])},
    "dataspeed": {
        "/vehicle/wheel_speeds": lambda t: made("ds_dbw_msgs/msg/WheelSpeeds", t, **four(OMEGA)),
        "/vehicle/vehicle_velocity": velocity,
        "/imu/data": imu,
    },
    "tier4": {
        "/vehicle/status/wheel_linear_speed": lambda t: made(
            "tier4_vehicle_msgs/msg/WheelLinearSpeedReport",
            t,
            **four([RADIUS * omega for omega in OMEGA], "{}_wheel_speed"),
        ),
        "/vehicle/status/velocity_status": autoware,
        "/sensing/imu/imu_data": imu,
    },
    "leo_rover": {"/firmware/wheel_states": leo},
    "tartan_drive": {
        "/wheel_rpm": lambda t: made("racepak/msg/rp_wheel_encoders", **four([30.0 / math.pi * o for o in OMEGA])),
        "/shock_pos": lambda t: made("racepak/msg/rp_shock_sensors", **four([value / 0.0254 for value in TRAVEL])),
        "/multisense/imu/imu_data": imu,
    },
    "ros2_control": {"/joint_states": joints, "/imu_sensor_broadcaster/imu": imu},
    "gazebo": {
        "/joint_states": joints,
        **{
            f"/{wheel}/force_torque": lambda t, k=k: wrench(t, LOAD[k], TRACTION[k]) for k, wheel in enumerate(WHEELS)
        },
    },
}  # fmt: skip
"""What each stack publishes, as a message of a time."""

STAMPED = {"av21", "open_car_dynamics", "dataspeed", "tier4", "leo_rover", "ros2_control", "gazebo"}


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """A second of each stack at 100 Hz, received 3 ms late; loads of the usual topics where it has none."""
    folder = tmp_path_factory.mktemp("bags")
    for name, topics in MESSAGES.items():
        with BagWriter(folder / name) as bag:
            handles = {}
            for topic, message in topics.items():
                kind, _ = message(0)
                handles[topic] = bag.add_topic(topic, kind, definition=DEFINITIONS.get(kind))
            loads = "inputs.load.topic" not in read(name)
            extra = {w: bag.add_topic(f"/{w}/load", "geometry_msgs/msg/WrenchStamped") for w in WHEELS if loads}
            for k in range(100):
                time = 10_000_000 * k
                for topic, message in topics.items():
                    bag.write(handles[topic], START + time + 3_000_000, START + time + 3_000_000, message(time)[1])
                for wheel, handle in extra.items():
                    data = wrench(time, LOAD[WHEELS.index(wheel)], 0.0)[1]
                    bag.write(handle, START + time + 3_000_000, START + time + 3_000_000, data)
    return folder


def read(name):
    """The parameters that a map gives, with four wheels."""
    return {"wheels": WHEELS, **read_inputs(MAPS / f"{name}.yaml")}


def test_there_is_a_map_for_each_of_the_nine():
    assert {path.stem for path in MAPS.glob("*.yaml")} == set(MESSAGES)


@pytest.mark.parametrize("name", MESSAGES)
def test_a_map_is_short_and_only_a_map(name):
    text = (MAPS / f"{name}.yaml").read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]) <= 10
    assert all(parameter.startswith("inputs.") for parameter in read_inputs(MAPS / f"{name}.yaml"))
    rows = {row.name for row in PARAMETERS}
    assert set(read_inputs(MAPS / f"{name}.yaml")) <= rows


@pytest.mark.parametrize("name", MESSAGES)
def test_a_map_reads_what_its_stack_publishes(name, bags):
    """Every number, of the bytes in the bag, by the definition in the bag."""
    reader = BagReader(bags / name)
    how = bag_setup(reader, inputs=MAPS / f"{name}.yaml")
    pipeline, got = pipeline_of(reader, how), {}
    pipeline.set_sink(lambda quantity, wheel, stamp, received, values: got.setdefault(quantity, (stamp, values)))
    relative = {full: topic for topic, full in how.names.items()}
    for topic, _, received, _, data in reader.messages(how.names[topic] for topic in pipeline.inputs):
        pipeline.receive(relative[topic], received, data)
        if received > START + 5_000_000:
            break
    single = 1e-6  # float32 holds 7 digits
    assert got["speed"][1] == pytest.approx(OMEGA, rel=single)
    assert (got["speed"][0] == START) == (name in STAMPED)
    for quantity, expected in (("travel", TRAVEL), ("imu", (*FORCE, *RATE)), ("vehicle_speed", (9.5,))):
        if f"inputs.{quantity}.topic" in read(name):
            assert got[quantity][1] == pytest.approx(expected, rel=single)
    assert not pipeline.malformed
    pipeline.tick(START + 10_000_000)
    inputs = pipeline.vehicle.inputs
    assert [each.speed for each in inputs] == pytest.approx(OMEGA, rel=single)
    assert [each.load[0] for each in inputs] == pytest.approx(LOAD, rel=single)
    if "inputs.traction.topic" in read(name) and name == "gazebo":  # of one message with the load
        assert [each.load[1] for each in inputs] == pytest.approx(TRACTION, rel=single)


@pytest.mark.parametrize("name", MESSAGES)
def test_a_bag_is_replayed_by_the_map_and_its_replay_once_more(name, bags, tmp_path):
    """The second replay takes map and definitions from the first one's output: the same bytes."""
    done = replay(bags / name, tmp_path / "one", inputs=MAPS / f"{name}.yaml")
    assert not done.without and all(done.written[f"{wheel}/axle_wrench"] > 400 for wheel in WHEELS)
    replay(tmp_path / "one", tmp_path / "two")
    one, two = ([*BagReader(tmp_path / part).messages()] for part in ("one", "two"))
    assert one == two
    for kind in DEFINITIONS:
        assert BagReader(tmp_path / "one").definition(kind) == BagReader(bags / name).definition(kind)


def test_a_map_for_another_bag_says_what_is_missing(bags, tmp_path):
    with pytest.raises(InputError, match="has no topic /carla/telemetry, which the field map names; its topics: "):
        replay(bags / "leo_rover", tmp_path / "out", inputs=MAPS / "carla.yaml")


def test_a_field_that_is_not_there_is_refused_with_those_that_are(bags, tmp_path):
    text = (MAPS / "dataspeed.yaml").read_text(encoding="utf-8")
    (tmp_path / "wrong.yaml").write_text(text.replace('"{wheel}"', '"{wheel}_speed"'), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        replay(bags / "dataspeed", tmp_path / "out", inputs=tmp_path / "wrong.yaml")
    said = str(caught.value)
    assert "/vehicle/wheel_speeds" in said and "front_left_speed" in said and "rear_right" in said and "\n" not in said


def test_what_a_bag_does_not_have_is_left_out_if_a_wheel_moves_without_it(tmp_path):
    with BagWriter(tmp_path / "in") as bag:
        handle = bag.add_topic("/wheel_rpm", "racepak/msg/rp_wheel_encoders", definition=FOUR)
        loads = [bag.add_topic(f"/{wheel}/load", "geometry_msgs/msg/WrenchStamped") for wheel in WHEELS]
        for k in range(50):
            time = 10_000_000 * k
            bag.write(handle, START + time, START + time, MESSAGES["tartan_drive"]["/wheel_rpm"](time)[1])
            for load in loads:
                bag.write(load, START + time, START + time, wrench(time, 4000.0, 0.0)[1])
    done = replay(tmp_path / "in", tmp_path / "out", inputs=MAPS / "tartan_drive.yaml")
    assert done.parameters["inputs.imu.topic"] == () and done.parameters["inputs.speed.topic"] == ("/wheel_rpm",)


def test_the_maps_take_nothing_else(bags):
    assert complete(read("carla"))["inputs.speed.unit"] == "rad/s"
    with pytest.raises(ValueError, match=r"inputs\.speed\.type is 'a_msgs/msg/B', whose definition is not there"):
        Pipeline({**read("carla"), "inputs.speed.type": "a_msgs/B", "inputs.load.type": "a_msgs/B"})


def test_a_page_about_a_mapped_drive_has_its_speeds_and_loads(bags, tmp_path):
    """As the page about the same drive in this package's own messages has them."""
    from tire_dynamics.report.gather import gather

    replay(bags / "carla", tmp_path / "log", inputs=MAPS / "carla.yaml")
    reader = BagReader(tmp_path / "log")
    drive = gather(reader, reader, replayed=True, quiet=True)
    assert [each.topic for each in drive.inputs] == ["/carla/telemetry"]
    [telemetry] = drive.inputs
    assert telemetry.messages == 100 and telemetry.rate == pytest.approx(100.0)
    for wheel, omega, load in zip(drive.wheels, OMEGA, LOAD, strict=True):
        assert wheel.numbers["speed"].mean == pytest.approx(omega)
        assert wheel.numbers["load_z"].mean == pytest.approx(load)


# -- bags of other storages -------------------------------------------------------------------------------------------


def test_a_bag_of_ros_1_with_messages_that_ros_2_does_not_have(tmp_path):
    """TartanDrive's are such: what its definitions say is what is read."""
    from rosbags.rosbag1 import Writer

    kinds = {"/wheel_rpm": "racepak/msg/rp_wheel_encoders", "/shock_pos": "racepak/msg/rp_shock_sensors"}
    one = get_typestore(Stores.ROS1_NOETIC)
    for kind in kinds.values():
        one.register(get_types_from_msg(FOUR, kind))
    loads = [f"/{wheel}/load" for wheel in WHEELS]
    with Writer(tmp_path / "tartan.bag") as bag:
        told = {topic: bag.add_connection(topic, kind, typestore=one) for topic, kind in kinds.items()}
        told |= {topic: bag.add_connection(topic, "geometry_msgs/msg/WrenchStamped", typestore=one) for topic in loads}
        for k in range(100):
            time = START + 10_000_000 * k
            four_of = {"/wheel_rpm": [30.0 / math.pi * o for o in OMEGA], "/shock_pos": [t / 0.0254 for t in TRAVEL]}
            for topic, kind in kinds.items():
                raw = one.serialize_ros1(one.types[kind](**four(four_of[topic])), kind)
                bag.write(told[topic], time, raw)
            for topic in loads:
                force, none = (one.types["geometry_msgs/msg/Vector3"](0.0, 0.0, z) for z in (4000.0, 0.0))
                stamp = one.types["builtin_interfaces/msg/Time"](*divmod(time, 10**9))
                header = one.types["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="")
                wrench_of = one.types["geometry_msgs/msg/Wrench"](force, none)
                whole = one.types["geometry_msgs/msg/WrenchStamped"](header, wrench_of)
                bag.write(told[topic], time, one.serialize_ros1(whole, "geometry_msgs/msg/WrenchStamped"))
    done = replay(tmp_path / "tartan.bag", tmp_path / "out", inputs=MAPS / "tartan_drive.yaml")
    assert not done.without and done.written["front_left/axle_wrench"] > 400
    replay(tmp_path / "out", tmp_path / "again")
    assert [*BagReader(tmp_path / "out").messages()] == [*BagReader(tmp_path / "again").messages()]


def test_a_bag_in_sqlite_with_its_definitions(tmp_path):
    """As recorders since Iron write it, in a table."""
    import sqlite3

    kind = "ds_dbw_msgs/msg/WheelSpeeds"
    database = sqlite3.connect(tmp_path / "drive.db3")
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
        " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,"
        " data BLOB NOT NULL);"
        "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,"
        " encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);"
    )
    wrenches = "geometry_msgs/msg/WrenchStamped"
    topics = {"/vehicle/wheel_speeds": kind, **{f"/{wheel}/load": wrenches for wheel in WHEELS}}
    for number, (topic, of) in enumerate(topics.items(), 1):
        database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (number, topic, of))
    database.execute("INSERT INTO message_definitions VALUES (1, ?, 'ros2msg', ?, '')", (kind, DEFINITIONS[kind]))
    for k in range(100):
        time = 10_000_000 * k
        messages = [MESSAGES["dataspeed"]["/vehicle/wheel_speeds"](time), *(wrench(time, 4000.0, 0.0) for _ in WHEELS)]
        rows = [(number, START + time, data) for number, (_, data) in enumerate(messages, 1)]
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    database.commit()
    database.close()
    done = replay(tmp_path / "drive.db3", tmp_path / "out", inputs=MAPS / "dataspeed.yaml")
    assert not done.without and done.written["rear_right/axle_wrench"] > 400
    assert done.parameters["inputs.imu.topic"] == ()  # which the bag does not have


# -- what a map takes, and why a wheel has nothing -------------------------------------------------------------------


@pytest.mark.parametrize("name", MESSAGES)
def test_info_counts_what_a_map_takes_its_rate_and_its_range(name, bags):
    taken = info(bags / name, inputs=MAPS / f"{name}.yaml")["replay"]["mapped"]
    expected = {
        "speed": dict(zip(WHEELS, OMEGA, strict=True)), "load": dict(zip(WHEELS, LOAD, strict=True)),
        "angle": dict(zip(WHEELS, ANGLE, strict=True)), "travel": dict(zip(WHEELS, TRAVEL, strict=True)),
        "traction": dict(zip(WHEELS, TRACTION, strict=True)), "vehicle_speed": {"vehicle": 9.5},
        "imu": dict(zip(("force_x", "force_y", "force_z", "rate_x", "rate_y", "rate_z"), (*FORCE, *RATE), strict=True)),
    }  # fmt: skip
    values = bag_setup(BagReader(bags / name), inputs=MAPS / f"{name}.yaml").values
    assert {each["quantity"] for each in taken} == {source.quantity for source in sources(values)}
    got: dict[str, dict] = {}
    for each in taken:
        assert (each["looked_at"], each["malformed"]) == (100, 0) and each["rate_hz"] == pytest.approx(100.0)
        got.setdefault(each["quantity"], {}).update(each["values"])
    for quantity, parts in got.items():
        assert parts.keys() == expected[quantity].keys()
        for part, of in parts.items():
            assert of["count"] == 100
            if quantity != "traction" or name == "gazebo":
                assert (of["low"], of["high"]) == pytest.approx((expected[quantity][part],) * 2, rel=1e-6)


def test_info_shows_it_to_people(bags, capsys):
    assert main(["info", str(bags / "carla"), "--inputs", str(MAPS / "carla.yaml")]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("field map")]
    assert any(
        "speed [rad/s] of /carla/telemetry: front_left 30 to 30, front_right 31 to 31" in line
        and line.endswith("; first 100 messages at 100 Hz")
        for line in lines
    )


def simulated_bag(folder, start):
    """Speeds of the by-wire kit with stamps from ``start`` on, received as everything else is now."""
    kind = "ds_dbw_msgs/msg/WheelSpeeds"
    with BagWriter(folder) as bag:
        speeds = bag.add_topic("/vehicle/wheel_speeds", kind, definition=DEFINITIONS[kind])
        loads = [bag.add_topic(f"/{wheel}/load", "geometry_msgs/msg/WrenchStamped") for wheel in WHEELS]
        for k in range(200):
            time = 10_000_000 * k
            bag.write(speeds, START + time, START + time, made(kind, start + time, **four(OMEGA))[1])
            for load in loads:
                bag.write(load, START + time, START + time, wrench(start + time, 4000.0, 0.0)[1])
    return folder


@pytest.mark.parametrize("clock", ["stamp", "log"])
def test_a_mapped_bag_of_two_clocks_is_refused_with_what_helps_and_that_helps(tmp_path, clock):
    bag = simulated_bag(tmp_path / "in", 5_000_000_000 - START)
    config = {"inputs": MAPS / "dataspeed.yaml"}
    with pytest.raises(InputError, match=r"stamps and times of receipt .*stamp 5\.000 s, .* --clock stamp") as caught:
        replay(bag, tmp_path / "out", **config)
    assert "on its speed" in str(caught.value)
    done = replay(bag, tmp_path / "out", clock=clock, **config)
    assert not done.without and done.written["rear_right/axle_wrench"] > 900


def test_a_wheel_that_the_messages_do_not_name_is_said_with_the_place_to_look(tmp_path, capsys):
    with BagWriter(tmp_path / "in") as bag:
        states = bag.add_topic("/wheels", "sensor_msgs/msg/JointState")
        loads = [bag.add_topic(f"/{wheel}/load", "geometry_msgs/msg/WrenchStamped") for wheel in WHEELS]
        for k in range(100):
            time = 10_000_000 * k
            names = {"name": ["fl", "fr", "rl"], "position": np.empty(0), "effort": np.empty(0)}
            data = made("sensor_msgs/msg/JointState", time, velocity=np.array(OMEGA[:3]), **names)[1]
            bag.write(states, START + time, START + time, data)
            for load in loads:
                bag.write(load, START + time, START + time, wrench(time, 4000.0, 0.0)[1])
    text = "/**:\n  ros__parameters:\n    joint_names: [fl, fr, rl, rr]\n"
    text += "    inputs:\n      speed: {topic: /wheels, field: velocity}\n"
    (tmp_path / "map.yaml").write_text(text, encoding="utf-8")
    why = "100 messages of its speed have no number for it where inputs.speed.field, of /wheels, says"
    wanted = {"rear_right": why}
    assert info(tmp_path / "in", inputs=tmp_path / "map.yaml")["replay"]["without"] == wanted
    done = replay(tmp_path / "in", tmp_path / "out", inputs=tmp_path / "map.yaml")
    assert done.without == wanted and done.written["rear_left/axle_wrench"] > 400


def test_values_beyond_all_bounds_are_said_of_a_mapped_wheel_too(tmp_path):
    kind = "ds_dbw_msgs/msg/WheelSpeeds"
    with BagWriter(tmp_path / "in") as bag:
        speeds = bag.add_topic("/vehicle/wheel_speeds", kind, definition=DEFINITIONS[kind])
        loads = [bag.add_topic(f"/{wheel}/load", "geometry_msgs/msg/WrenchStamped") for wheel in WHEELS]
        for k in range(100):
            time = 10_000_000 * k
            data = made(kind, time, **{**four(OMEGA), "rear_left": 1e6})[1]
            bag.write(speeds, START + time, START + time, data if k < 90 else data[:20])
            for load in loads:
                bag.write(load, START + time, START + time, wrench(time, 4000.0, 0.0)[1])
    done = replay(tmp_path / "in", tmp_path / "out", inputs=MAPS / "dataspeed.yaml")
    assert [*done.without] == ["rear_left"]
    assert re.fullmatch(r"its speed was beyond max_speed_rad_s \(\d+\) 90 times", done.without["rear_left"])
    [taken] = info(tmp_path / "in", inputs=MAPS / "dataspeed.yaml")["replay"]["mapped"]
    assert taken["malformed"] == 10 and taken["values"]["rear_left"] == {"count": 90, "low": 1e6, "high": 1e6}
