"""The sample bag of the repository: its script makes it, from the road and the car that the script names."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import csd, welch
from scipy.special import k1

from tire_dynamics.bag import BagReader
from tire_dynamics.cdr.messages import JOINT_STATE, WRENCH_STAMPED, JointStateDecoder, decode_wrench

BAGS = Path(__file__).parents[1] / "bags"
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")

spec = importlib.util.spec_from_file_location("make_sample", BAGS / "make_sample.py")
make_sample = importlib.util.module_from_spec(spec)
spec.loader.exec_module(make_sample)


def decoded(folder: Path) -> dict[str, np.ndarray]:
    """Rows of stamp and values by topic: speeds of the four wheels, or force.x and force.z."""
    rows: dict[str, list[tuple]] = {}
    decode = JointStateDecoder().decode
    for topic, msgtype, log_time, publish_time, data in BagReader(folder).messages():
        if msgtype == JOINT_STATE:
            state = decode(data)
            assert state.names == WHEELS
            row = (state.stamp_ns, *state.velocities)
        else:
            wrench = decode_wrench(data)
            assert wrench.fy == 0.0 and f"/{wrench.frame_id.removesuffix('_axle')}/load" == topic
            row = (wrench.stamp_ns, wrench.fx, wrench.fz)
        assert log_time == publish_time == row[0]
        rows.setdefault(topic, []).append(row)
    return {topic: np.array(values) for topic, values in rows.items()}


@pytest.fixture(scope="module")
def sample() -> dict[str, np.ndarray]:
    return decoded(BAGS / "sample")


def test_topics_rates_and_size(sample):
    reader = BagReader(BAGS / "sample")
    loads = {f"/{wheel}/load": WRENCH_STAMPED for wheel in WHEELS}
    assert reader.complete and reader.topics == {"/joint_states": JOINT_STATE, **loads}
    for topic, rows in sample.items():
        period = 10_000_000 if topic == "/joint_states" else 2_000_000
        assert len(rows) * period == 20 * 10**9
        stamps = [log_time for name, _, log_time, _, _ in reader.messages([topic])]
        assert set(np.diff(stamps)) == {period} and stamps[0] == reader.start_ns
    assert sum(file.stat().st_size for file in (BAGS / "sample").iterdir()) <= 3_000_000


@pytest.mark.slow
def test_the_script_makes_it_again(sample, tmp_path):
    assert make_sample.main(["-o", str(tmp_path / "again")]) == 0
    again = decoded(tmp_path / "again")
    assert again.keys() == sample.keys()
    for topic, rows in sample.items():
        # One step of the instruments: another libm or FFT may put a value on the other side of a rounding.
        step = make_sample.SPEED_STEP if topic == "/joint_states" else make_sample.FORCE_STEP
        np.testing.assert_allclose(again[topic], rows, rtol=0, atol=step)


@pytest.mark.slow
def test_an_existing_output_is_kept(tmp_path, capsys):
    (tmp_path / "out").mkdir()
    assert make_sample.main(["-o", str(tmp_path / "out")]) == 2
    assert "exists already" in capsys.readouterr().err


def test_the_road_is_class_b():
    """Octave by octave, the mean square of each track is the integral of the standard's spectrum."""
    for track in make_sample.road():
        n, density = welch(track, 1 / make_sample.ROAD_STEP, window="hann", nperseg=8000)  # 80 m
        for low in 0.05 * 2.0 ** np.arange(7):  # 0.05 to 6.4 cycles/m
            octave = (n >= low) & (n < 2 * low)
            measured = density[octave].sum() * n[1]
            edges = n[octave][0] - n[1] / 2, n[octave][-1] + n[1] / 2
            expected = 64e-6 * 0.1**2 * (1 / edges[0] - 1 / edges[1])
            # The mean of 9 windows scatters by 1/sqrt(9) in a line and by less in a sum of lines: four times
            # that. The neighbouring classes are a factor of 4 away.
            assert measured / expected == pytest.approx(1.0, abs=4 / 3 / np.sqrt(np.count_nonzero(octave)))


def test_the_tracks_have_the_coherence_of_an_isotropic_road():
    left, right = make_sample.road()
    options = {"fs": 1 / make_sample.ROAD_STEP, "nperseg": 4000}  # 40 m
    n, cross = csd(left, right, **options)
    _, density = welch(left, **options)
    for low, high in ((0.025, 0.075), (0.1, 0.2), (0.4, 0.8), (2.0, 4.0)):
        band = (n >= low) & (n <= high)
        kappa = 2 * np.pi * make_sample.TRACK * n[band]
        expected = np.sum(kappa * k1(kappa) * density[band]) / np.sum(density[band])
        measured = np.sum(cross.real[band]) / np.sum(density[band])
        # 19 half-overlapped windows: the coherence of independent tracks scatters by about 1/sqrt(10), less
        # where a band has many lines.
        assert measured == pytest.approx(expected, abs=0.3)


@pytest.mark.slow
def test_the_quarter_car_answers_a_sine_as_its_transfer_function_says():
    """The tire force, solved here from the two equations of motion in the frequency domain."""
    static, rate = 3500.0, 2000
    sprung = static / 9.81 / 1.15
    for f in (1.0, 4.0, 11.0):
        time = np.arange(20 * rate) / rate
        road = 0.002 * np.sin(2 * np.pi * f * time)
        load = make_sample.quarter_car(time, road, static, np.zeros_like(time))
        s = 2j * np.pi * f
        strut, tire = (6.0 * s + 63.3) * sprung, 653.0 * sprung
        matrix = [[sprung * s**2 + strut, -strut], [-strut, 0.15 * sprung * s**2 + strut + tire]]
        wheel = np.linalg.solve(matrix, [0.0, tire])[1]
        expected = static + np.imag(tire * (1 - wheel) * 0.002 * np.exp(s * time))
        # The transient dies out with exp(-2 t) or faster; straight lines between samples of a sine at 2 kHz
        # err by (pi f/2000)^2/3 of it, 1e-4 at most.
        late = time > 10
        np.testing.assert_allclose(load[late], expected[late], atol=2e-4 * np.ptp(expected))


@pytest.mark.slow
def test_the_loads_vary_as_class_b_at_20_m_s_makes_them():
    """Standard deviation of the load on the whole road, against the integral of |H|^2 Gd."""
    static, v, rate = 3500.0, 20.0, 2000
    n = np.arange(4, 4001) / 400.0  # cycles/m, 0.01 to 10
    s = 2j * np.pi * n * v
    strut = 6.0 * s + 63.3
    # The wheel's motion per road height, with the body eliminated from the two equations of motion.
    wheel = 653.0 / (0.15 * s**2 + 653.0 + strut - strut**2 / (s**2 + strut))
    patch = np.sinc(n * make_sample.CONTACT_LENGTH)
    response = np.abs(static / 9.81 / 1.15 * 653.0 * (1 - wheel) * patch) ** 2
    expected = np.sqrt(np.sum(response * 64e-6 * (n / 0.1) ** -2) / 400.0)

    time = np.arange(2 * 20 * rate) / rate  # twice round the periodic road: the first to settle
    for track in make_sample.road():
        smooth = make_sample.uniform_filter1d(track, round(0.11 / make_sample.ROAD_STEP), mode="wrap")
        road = np.interp(v * time, np.arange(track.size) * 0.01, smooth, period=400.0)
        load = make_sample.quarter_car(time, road - road[0], static, np.zeros_like(time))
        # Every harmonic is there with its own amplitude in the left track, and in the right one up to the
        # scatter of two random phases, which some hundred harmonics near the wheel's resonance average out.
        assert np.std(load[time >= 20]) == pytest.approx(expected, rel=0.1)


def test_the_story(sample):
    time = np.arange(10_000) / 500
    loads = {wheel: sample[f"/{wheel}/load"] for wheel in WHEELS}
    speed = sample["/joint_states"]
    seconds = np.arange(2000) / 100
    fz = np.column_stack([loads[wheel][:, 2] for wheel in WHEELS])
    fx = np.column_stack([loads[wheel][:, 1] for wheel in WHEELS])

    standing = (time < 2.0) | (time > 18.6)
    assert (speed[(seconds < 2.0) | (seconds > 18.6), 1:] == 0.0).all() and (fx[standing] == 0.0).all()
    assert (speed[:, 1:] >= 0.0).all()
    weight = fz[time < 2.0]
    assert (weight == weight[0]).all() and (3500 < weight[0]).all() and (weight[0] < 4000).all()
    # The weight of 1520 kg, to the rounding of four forces.
    assert weight[0].sum() == pytest.approx(1520 * 9.81, abs=4 * make_sample.FORCE_STEP)

    # Free-rolling rear wheels at cruise turn as the ground goes by, but for the slip of their own rolling
    # resistance, 0.012/20.
    assert speed[seconds == 12.0, 3] * 0.305 == pytest.approx(20.0, rel=1e-3)

    # No wheel lifts, and no force along the road that a dry one could not take.
    assert fz.min() > 0.0 and np.abs(fx / fz).max() < 1.0

    # m a of the car, from the speed of the free-rolling wheels, is what the tires push less the air's drag.
    for begin, end in ((3.0, 9.0), (15.0, 18.0)):
        v0, v1 = (np.mean(speed[seconds == t, 3:]) * 0.305 for t in (begin, end))
        inside = (time >= begin) & (time < end)
        drag = 0.39 * np.mean(np.interp(time[inside], seconds, speed[:, 3] * 0.305) ** 2)
        push = fx[inside].sum(axis=1).mean()
        # 3 %: braked rear wheels slip by up to 1.5 %.
        assert push - drag == pytest.approx(1520 * (v1 - v0) / (end - begin), rel=0.03)

    # Braking puts m a h/l onto the front axle; the road adds its scatter to a mean of 3 s.
    braking = (time >= 15.0) & (time < 18.0)
    shift = fz[braking][:, :2].sum(axis=1).mean() - weight[0][:2].sum()
    assert shift == pytest.approx(-1520 * (v1 - v0) / 3.0 * 0.55 / 2.70, rel=0.1)

    # The cleat: the highest peak of the cruise on each left wheel, the rear one a wheelbase later.
    cruise = (time > 10.5) & (time < 13.5)
    front, rear = (time[cruise][np.argmax(fz[cruise, corner])] for corner in (0, 2))
    # Two samples for each of the two times.
    assert front == pytest.approx(12.0, abs=0.004) and rear - front == pytest.approx(2.70 / 20, abs=0.008)
