"""Roads: spectra against ISO 8608, tracks against one another, profiles against integrals; the command and its bag."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy import signal

from tire_dynamics import TireWheelUnit, wheel
from tire_dynamics.bag import BagReader
from tire_dynamics.cdr.messages import JointStateDecoder, WrenchDecoder, decode_float64
from tire_dynamics.cli.main import main
from tire_dynamics.figures.road_drive import RoadForces, draw
from tire_dynamics.science import road


def test_classes_are_those_of_the_standard():
    """ISO 8608:2016, degree of roughness at n_0 = 0.1 cycles/m, geometric means in 1e-6 m^3."""
    means = [16, 64, 256, 1024, 4096, 16384, 65536, 262144]
    assert [road.CLASSES[name] for name in "ABCDEFGH"] == pytest.approx([1e-6 * mean for mean in means], rel=1e-15)
    # w = 2: a tenth of the wavenumber has a hundred times the density
    assert road.spectrum("C", [0.1, 0.01, 1.0]) == pytest.approx([256e-6, 256e-4, 256e-8], rel=1e-12)


@pytest.mark.parametrize("road_class", ["A", "C", "H"])
def test_spectrum_of_a_random_road(road_class):
    """Welch's estimate over 20 km, in octaves: 2000 waves in the widest band, 50 in the lowest, 3 sigma of each."""
    left, _ = road.random_tracks(road_class, 20_000.0, seed=5)
    n, density = signal.welch(left.height, fs=20.0, nperseg=8192)
    for low in (0.02, 0.1, 0.4, 1.6, 3.2):
        band = (n >= low) & (n < 2.0 * low)
        ratio = (density[band] / road.spectrum(road_class, n[band])).mean()
        assert ratio == pytest.approx(1.0, abs=3.0 / math.sqrt(20_000.0 * low))
    slope = np.polyfit(np.log(n[(n > 0.1) & (n < 5)]), np.log(density[(n > 0.1) & (n < 5)]), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.05)


def test_variance_is_the_spectrums_integral():
    """sum G_d dn from 0.01 cycles/m to half the sampling rate, of a road of many waves: 1 % of it in ten of them."""
    left, right = road.random_tracks("B", 50_000.0, 1.5, seed=2)
    expected = 64e-6 * 0.1**2 * (1.0 / 0.01 - 1.0 / 10.0)
    for track in (left, right):
        assert track.height.var() == pytest.approx(expected, rel=0.15)  # 700 independent waves at the lowest octave


def test_coherence_of_the_tracks():
    """Long waves lift both sides, short ones each by itself, as an isotropic road does."""
    left, right = road.random_tracks("C", 20_000.0, 1.5, seed=7)
    n, cross = signal.csd(left.height, right.height, fs=20.0, nperseg=8192)
    density = road.spectrum("C", np.maximum(n, 1e-9))
    for low in (0.02, 0.05, 0.1, 0.2, 0.5, 2.0):
        band = (n >= low) & (n < 1.5 * low)
        found = (cross[band] / density[band]).mean()
        expected = road.coherence(n[band], 1.5).mean()
        assert abs(found - expected) < 3.0 / math.sqrt(20_000.0 * 0.5 * low)
    assert road.coherence([0.0, 1e-20, 10.0], 1.5) == pytest.approx([1.0, 1.0, 0.0], abs=1e-12)
    one, other = road.random_tracks("C", 100.0, 0.0, seed=7)
    assert np.array_equal(one.height, other.height)


def test_isotropy():
    """x K_1(x) is the integral across an isotropic plane: of (k_x^2 + k_y^2)^(-3/2) cos(k_y t) over k_y."""
    for n, track in ((0.1, 1.5), (0.4, 1.2)):
        k = 2.0 * math.pi * n
        y = np.linspace(-40.0, 40.0, 400_001) * k
        plane = (k * k + y * y) ** -1.5
        expected = (plane * np.cos(y * track)).sum() / plane.sum()
        assert road.coherence(n, track) == pytest.approx(expected, abs=1e-3)  # what lies beyond 40 k


def test_the_same_seed_is_the_same_road():
    one, other, third = (road.random_tracks("D", 300.0, 1.5, seed=seed)[1] for seed in (3, 3, 4))
    assert np.array_equal(one.height, other.height) and not np.array_equal(one.height, third.height)
    assert one.distance[-1] >= 300.0


def test_profile_means_are_integrals():
    profile = road.Profile([0.0, 0.5, 2.0, 2.1], [0.0, 0.1, -0.2, 0.3])
    for begin, end in ((-1.0, 3.0), (0.2, 0.3), (1.9, 2.05), (-3.0, -1.0), (5.0, 4.0), (2.5, 0.1)):
        s = np.linspace(begin, end, 400_001)
        middles = profile.at(0.5 * (s[1:] + s[:-1]))
        assert profile.mean(begin, end) == pytest.approx(middles.mean(), abs=1e-6)  # kinks of 1e-5 m
    assert profile.mean(0.7, 0.7) == profile.at(0.7)
    felt = profile.averaged(0.4)
    places = np.array([0.3, 1.0, 2.05])
    assert felt.at(places) == pytest.approx(profile.mean(places - 0.2, places + 0.2), abs=2e-3)


def test_bumps():
    cleat = road.bump(0.01, 5.0, 0.02)
    assert cleat.at([0.0, 5.0, 5.01, 5.02, 9.0]).tolist() == [0.0, 0.0, 0.01, 0.0, 0.0]
    assert road.bump(-0.05, 1.0).at([0.5, 2.0, 100.0]).tolist() == [0.0, -0.05, -0.05]


def test_distance():
    assert road.travelled([0.0, 1.0, 3.0], [0.0, 10.0, 10.0]).tolist() == [0.0, 5.0, 25.0]
    assert road.travelled([0.0, 2.0], 3.0).tolist() == [0.0, 6.0]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: road.spectrum("I", 0.1), "road_class is 'I'"),
        (lambda: road.random_tracks("A", 0.0), "length is 0.0"),
        (lambda: road.random_tracks("A", 10.0, -1.0), "track is -1.0"),
        (lambda: road.random_tracks("A", 1e9), "length over spacing"),
        (lambda: road.bump(math.nan, 1.0), "height is nan"),
        (lambda: road.bump(0.1, 1.0, 0.001), "length is 0.001"),
        (lambda: road.Profile([0.0, 0.0], [0.0, 1.0]), "does not increase after"),
        (lambda: road.Profile([0.0, 1.0], [0.0, math.inf]), "not finite"),
        (lambda: road.Profile([0.0], [0.0, 1.0]), "shapes"),
    ],
)
def test_bad_roads(call, words):
    with pytest.raises(ValueError, match=words.replace("(", "[(]")):
        call()


# -- the command --------------------------------------------------------------------------------------------------


def recorded(bag):
    """Times [s] and values of every topic of a bag."""
    found, decoder = {}, JointStateDecoder()
    for topic, _, stamp, _, data in BagReader(bag).messages():
        values = decoder.decode(data).velocities if topic == "/joint_states" else [decode_float64(data)]
        found.setdefault(topic, []).append((stamp * 1e-9 - 1.0, *values))
    return {topic: np.array(rows) for topic, rows in found.items()}


def test_a_car_over_a_cleat_at_a_speed_that_grows(tmp_path):
    """The rear finds it a wheelbase later, whatever the speed; both sides at once."""
    (tmp_path / "speed.csv").write_text("time,speed\n0,5\n2,15\n")
    call = ["road", "--cleat", "0.01:0.5@10", "--speed", str(tmp_path / "speed.csv"), "--rate", "1000"]
    assert main([*call, "--wheelbase", "2.5", "--rolling-radius", "0.3", "-o", str(tmp_path / "bag"), "--quiet"]) == 0
    found = recorded(tmp_path / "bag")
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    assert set(found) == {"/joint_states", *(f"/{wheel}/road_height" for wheel in wheels)}
    time, wheel = found["/joint_states"][:, 0], found["/joint_states"][:, 1]
    assert wheel == pytest.approx((5.0 + 5.0 * time) / 0.3, rel=1e-12)
    distance = 5.0 * time + 2.5 * time**2
    for name, ahead in (("front", 2.5), ("rear", 0.0)):  # the road begins under the rear axle
        left, right = (found[f"/{name}_{side}/road_height"][:, 1] for side in ("left", "right"))
        assert np.array_equal(left, right) and left.max() == pytest.approx(0.01)
        up = distance[left > 0.005] + ahead
        assert [up[0], up[-1]] == pytest.approx([10.0, 10.5], abs=0.03)  # a sample at 15 m/s is 15 mm


def test_a_random_road_under_a_car(tmp_path, capsys):
    """One seed, one bag; at a constant speed the rear is the front by wheelbase over speed; the sides differ."""
    call = ["road", "--class", "c", "--speed-kmh", "72", "--duration", "10", "--wheelbase", "2.6", "--json"]
    assert main([*call, "-o", str(tmp_path / "one")]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["distance_m"] == pytest.approx(200.0) and content["road"]["random"].startswith("ISO 8608 class C")
    found = recorded(tmp_path / "one")
    late = round(2.6 / 20.0 * 500)
    for side in ("left", "right"):
        front, rear = (found[f"/{axle}_{side}/road_height"][:, 1] for axle in ("front", "rear"))
        assert rear[late:] == pytest.approx(front[:-late], abs=1e-12)
    left, right = (found[f"/front_{side}/road_height"][:, 1] for side in ("left", "right"))
    assert 0.5 < np.corrcoef(left, right)[0, 1] < 1.0
    assert main([*call, "-o", str(tmp_path / "two")]) == 0
    assert np.array_equal(recorded(tmp_path / "two")["/rear_left/road_height"], found["/rear_left/road_height"])


def test_a_profile_and_a_patch(tmp_path):
    """Two tracks from a file; a patch takes the mean of what is under it."""
    (tmp_path / "lane.csv").write_text("distance,left,right\n0,0,0\n5,0,0\n5.001,0.02,-0.02\n20,0.02,-0.02\n")
    (tmp_path / "tire.yaml").write_text("contact_half_angle: 0.2\n" + "".join(
        f"{name}: {value}\n" for name, value in TireWheelUnit.table_1().to_mapping().items()
        if name != "contact_half_angle"
    ))  # fmt: skip
    call = ["road", "--profile", str(tmp_path / "lane.csv"), "--speed-kmh", "36", "--duration", "1", "--quiet"]
    call += ["--wheels", "left", "right", "--config", str(tmp_path / "tire.yaml")]
    assert main([*call, "-o", str(tmp_path / "bag")]) == 0
    found = recorded(tmp_path / "bag")
    left, right = (found[f"/{side}/road_height"][:, 1] for side in ("left", "right"))
    assert left == pytest.approx(-right, abs=1e-15)
    patch = 2.0 * 0.305 * math.sin(0.2)
    s = 10.0 * found["/left/road_height"][:, 0]
    ramp = 0.02 * np.clip((s - 5.0005 + 0.5 * patch) / patch, 0.0, 1.0)
    assert left == pytest.approx(ramp, abs=2e-4)  # the edge takes 1 mm of 121


TIRE = """/**:
  ros__parameters:
    wheels: [{wheels}]
    joint_names: [{joints}]
    static_loads: [{loads}]
    ring_rate_hz: 10.0
    ring_samples: 8
    n_max: 8
    contact_points: {points}
    tire: {{vertical_stiffness: 2.0e+5, contact_half_angle: 0.15, sprung_mass: 350.0, zeta_s: 0.3,
           sidewall_damping: reaction}}
"""


def a_tire(path, *, wheels=2, points=1):
    names, loads = ["left", "right"][:wheels], ["4000.0", "3500.0"][:wheels]
    joints = [f"{name}_joint" for name in names]
    path.write_text(
        TIRE.format(wheels=", ".join(names), joints=", ".join(joints), loads=", ".join(loads), points=points)
    )
    return str(path)


def wrenches(bag):
    """Of each topic with forces of the wheels: rows of time [s], fx, fz, and all messages as they are."""
    decoder, found, raw = WrenchDecoder(), {}, {}
    for topic, _, _, _, data in BagReader(bag).messages():
        if topic.endswith(("/axle_wrench", "/contact_load")):
            wrench = decoder.decode(data)
            found.setdefault(topic, []).append((wrench.stamp_ns * 1e-9 - 1.0, wrench.fx, wrench.fz))
            raw.setdefault(topic, []).append(data)
    return {topic: np.array(rows) for topic, rows in found.items()}, raw


@pytest.mark.parametrize("points", [1, 3])
def test_forces_are_those_of_the_bags_replay(tmp_path, capsys, points):
    """Straight into a log, or by the bag and its replay: the same messages; the table has their numbers in full."""
    config = a_tire(tmp_path / "tire.yaml", points=points)
    call = ["road", "--class", "D", "--cleat", "0.04:0.3@6", "--speed-kmh", "72", "--duration", "0.6", "--quiet"]
    call += ["--config", config]
    assert main([*call, "-o", str(tmp_path / "bag"), "--forces", str(tmp_path / "log")]) == 0
    own = (tmp_path / "tire.yaml").read_text().replace("wheels:", "load_source: road\n    wheels:")
    (tmp_path / "road.yaml").write_text(own)
    replayed = ["replay", str(tmp_path / "bag"), "-o", str(tmp_path / "replayed"), "--quiet"]
    assert main([*replayed, "--config", str(tmp_path / "road.yaml")]) == 0
    found, raw = wrenches(tmp_path / "log")
    assert raw == wrenches(tmp_path / "replayed")[1]
    assert set(found) == {f"/{side}/{name}" for side in ("left", "right") for name in ("axle_wrench", "contact_load")}
    capsys.readouterr()
    table = tmp_path / "forces.csv"
    call[-3] = "--json"
    assert main([*call, "--forces", str(table)]) == 0
    said = json.loads(capsys.readouterr().out)["forces_of"]
    columns = np.genfromtxt(table, delimiter=",", names=True)
    for k, side in enumerate(("left", "right")):
        axle, contact = found[f"/{side}/axle_wrench"], found[f"/{side}/contact_load"]
        assert columns["time_s"] == pytest.approx(axle[:, 0], abs=1e-9)
        assert columns[f"{side}_force_x_n"].tolist() == axle[:, 1].tolist()
        assert columns[f"{side}_force_z_n"].tolist() == axle[:, 2].tolist()
        assert columns[f"{side}_contact_load_n"].tolist() == contact[:, 2].tolist()
        assert said[k]["contact_most_n"] == contact[:, 2].max() and said[k]["axle_least_n"] == axle[:, 2].min()
        assert said[k]["off_the_road_s"] == pytest.approx(0.002 * (contact[:, 2] == 0.0).sum())
        told = recorded(tmp_path / "bag")[f"/{side}/road_height"]
        assert columns[f"{side}_road_height_m"].tolist() == told[:, 1].tolist()
    assert columns["distance_m"] == pytest.approx(20.0 * columns["time_s"], abs=1e-9)
    assert np.ptp(columns["left_contact_load_n"]) > 1000.0


def test_several_points_are_told_what_is_under_the_foremost(tmp_path):
    """A step rises there, by its part of the patch; behind, once the wheel has turned round."""
    config = a_tire(tmp_path / "tire.yaml", wheels=1, points=5)
    (tmp_path / "speed.csv").write_text("time,speed\n0,4\n1,4\n1.001,-4\n2,-4\n")
    call = ["road", "--step", "0.01@2", "--speed", str(tmp_path / "speed.csv"), "--rate", "5000", "--quiet"]
    assert main([*call, "--config", config, "-o", str(tmp_path / "bag")]) == 0
    time, height = recorded(tmp_path / "bag")["/left/road_height"].T
    reach, part = 0.305 * math.sin(0.15 * 4 / 5), 2.0 * 0.305 * math.sin(0.15 / 5)
    up, down = (np.flatnonzero(np.diff(np.sign(height - 0.005)))[k] for k in (0, -1))
    assert 4.0 * time[up] == pytest.approx(2.0 - reach, abs=2e-3)
    assert 8.0 - 4.0 * time[down] == pytest.approx(2.0 + reach, abs=4e-3)  # it turns within 4 mm
    rising = time[:5000][np.abs(height[:5000] - 0.005) < 0.0049]
    assert 4.0 * np.ptp(rising) == pytest.approx(part, abs=3e-3)  # the edge takes 1 mm, a sample 0.8


def test_the_picture_has_every_wheel(tmp_path, capsys):
    """Road, contact and axle force; the horizontal one where the wheel gives or there are several points."""
    n = 9000
    time = np.arange(n) * 0.002
    contact = 4000.0 + 0.0 * time[:, None] * np.ones(4)
    contact[4321, 2] = 9000.0  # one sample of many, which the picture must not lose
    forces = RoadForces(
        ("a", "b", "c", "d"), time, 20.0 * time, 0.0 * time + 60.0, 0.01 * np.ones((n, 4)), contact, np.zeros((n, 4, 2))
    )
    figure = draw(forces, fore_aft=True)
    rows = [ax.get_ylabel() for ax in figure.axes[::2]]
    assert [row.split()[0] for row in rows] == ["Road", "Contact", "Axle", "Axle"] and len(figure.axes) == 8
    lines = {line.get_label(): line.get_ydata() for line in figure.axes[3].get_lines()}
    assert {"c", "d"} <= set(lines) and lines["c"].size < n and lines["c"].max() == pytest.approx(9.0)
    assert figure.axes[-1].get_xlabel() == "Distance driven [m]"
    back = dataclasses.replace(forces, distance=np.abs(forces.distance - 100.0), wheels=("a",))
    figure = draw(back, fore_aft=False)
    assert len(figure.axes) == 3 and figure.axes[-1].get_xlabel() == "Time [s]"
    plain = ["road", "--cleat", "0.01:0.1@1", "--speed-kmh", "36", "--duration", "0.2"]
    assert main([*plain, "--static-load", "4000", "--forces", str(tmp_path / "paper.csv")]) == 0
    said = "vertical_stiffness is 0: the tread is rigid, sprung_mass is 0: the body is held"
    assert said in capsys.readouterr().err
    call = [*plain, "--config", a_tire(tmp_path / "tire.yaml", wheels=1), "--quiet"]
    assert main([*call, "--plot", str(tmp_path / "road.png")]) == 0
    assert (tmp_path / "road.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert main([*call, "--plot", str(tmp_path / "road.png")]) == 2


@pytest.mark.slow
def test_a_motion_that_diverges_is_said(tmp_path, capsys):
    """By `road` and by `replay`; the table ends where the last wheel has diverged, and has no other numbers."""
    config, bag, table = tmp_path / "unstable.yaml", tmp_path / "bag", tmp_path / "forces.csv"
    config.write_text(
        "/**:\n  ros__parameters: {wheels: [a], load_source: road, static_loads: [4000.0], tire.zeta_1: 0.9}\n"
    )
    unit, speed = TireWheelUnit.table_1(zeta_1=0.9), 150.0 / 0.305
    assert wheel.stability(unit, speed, contact=True, n_max=5).verdict == "unstable"
    drive = ["--class", "C", "--speed-kmh", "540", "--duration", "2", "--config", str(config)]
    assert main(["road", *drive, "-o", str(bag), "--forces", str(table)]) == 0
    said = "a: its motion grew beyond all bounds"
    assert said in capsys.readouterr().err
    rows = [row.split(",") for row in table.read_text().splitlines()[1:]]
    assert 10 < len(rows) < 990 and all(math.isfinite(float(each)) for row in rows for each in row)
    assert main(["replay", str(bag), "-o", str(tmp_path / "out"), "--config", str(config)]) == 0
    assert said in capsys.readouterr().err
    assert main(["report", str(tmp_path / "out"), "-o", str(tmp_path / "page.html")]) == 0
    assert "unstable" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--forces", "{out}"], "forces need what the wheels carry at rest: --static-load"),
        (["--forces", "{out}", "--static-load", "1", "2", "3"], "--static-load has 3 values"),
        (["--forces", "{out}", "--static-load", "-5"], "static_loads has -5.0"),
        (["--plot", "{out}", "--static-load", "4000"], "its name must end in .png"),
        (["-o", "{out}", "--forces", "{out}", "--static-load", "4000"], "two outputs have one name"),
        (["--forces", "{there}", "--static-load", "4000"], "exists already"),
        (["--forces", "{out}", "--static-load", "4000", "--step", "0.3@2"], "the road jumps by 0.3 m"),
        ([], "needs an output: -o, --forces or --plot"),
    ],
)
def test_forces_that_cannot_be(tmp_path, capsys, arguments, words):
    (tmp_path / "there.csv").write_text("mine")
    given = [each.format(out=tmp_path / "out", there=tmp_path / "there.csv") for each in arguments]
    assert main(["road", "--cleat", "0.01:0.1@1", "--speed-kmh", "36", "--duration", "1", *given]) == 2
    out, err = capsys.readouterr()
    assert out == "" and words in err and err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"there.csv"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--speed-kmh", "50"], "needs a road"),
        (["--class", "C"], "needs one of --speed-kmh and --speed"),
        (["--class", "X", "--speed-kmh", "50"], "road_class is 'X'"),
        (["--class", "C", "--speed-kmh", "nan"], "--speed-kmh is nan"),
        (["--class", "C", "--speed-kmh", "50", "--rate", "0"], "--rate is 0"),
        (["--class", "C", "--speed-kmh", "50", "--wheels", "a", "b", "c"], "there are 3 wheels"),
        (["--class", "C", "--speed-kmh", "50", "--wheels", "a b"], "no ROS name"),
        (["--cleat", "0.01@5", "--speed-kmh", "50"], "--cleat is '0.01@5'"),
        (["--step", "0.01:2@5", "--speed-kmh", "50"], "--step is"),
        (["--cleat", "0.01:0.001@5", "--speed-kmh", "50"], "length is 0.001"),
        (["--profile", "none.csv", "--speed-kmh", "50"], "none.csv"),
        (["--profile", "{bad}", "--speed-kmh", "50"], "line 3: distance is 1 after 2"),
        (["--profile", "{nan}", "--speed-kmh", "50"], "not finite"),
        (["--profile", "{other}", "--speed-kmh", "50"], "no column height or left and right"),
        (["--class", "C", "--speed", "{bad}"], "0 columns 'time'"),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path, capsys, arguments, words):
    files = {"bad": "distance,height\n2,0\n1,0\n", "nan": "distance,height\n1,0\n2,nan\n", "other": "a,b\n1,2\n3,4\n"}
    for name, text in files.items():
        (tmp_path / f"{name}.csv").write_text(text)
    arguments = [each.format(**{name: tmp_path / f"{name}.csv" for name in files}) for each in arguments]
    assert main(["road", *arguments, "-o", str(tmp_path / "out")]) == 2
    out, err = capsys.readouterr()
    assert out == "" and words in err and err.count("\n") == 1
    assert not (tmp_path / "out").exists()
