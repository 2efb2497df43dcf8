"""The frequency response: against simulate under a sweep, harmonic balance, reciprocity, limits; the command."""

import csv
import json
import math
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tire_dynamics import TireWheelUnit, simulate, wheel, write_unit
from tire_dynamics.cli.main import main

TABLE_1 = TireWheelUnit.table_1()
MODELS = ("inextensional", "complete")
DAMPINGS = ("modal", "reaction")
RPM = math.pi / 30.0


@st.composite
def units(draw, least_damping=0.01):
    """Tires around Table 1, every quantity that n = 1 depends on by a factor of up to three either way."""
    factor = st.floats(-1.5, 1.5).map(lambda x: 2.0**x)
    names = ("density", "membrane_stiffness", "radius", "width", "radial_stiffness", "tangential_stiffness")
    names += ("wheel_mass", "suspension_stiffness", "inflation_pressure")
    damping = st.floats(least_damping, 0.5)
    return TABLE_1.replace(
        **{name: getattr(TABLE_1, name) * draw(factor) for name in names},
        zeta_1=draw(damping),
        zeta_s=draw(damping),
        contact_half_angle=draw(st.sampled_from([0.0, 0.2])),
        sidewall_damping=draw(st.sampled_from(DAMPINGS)),
    )


speeds = st.floats(-400.0, 400.0)
hertz = st.floats(-300.0, 300.0)
models = st.sampled_from(MODELS)


# -- simulate under a sweep ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("damping", DAMPINGS)
@pytest.mark.parametrize("speed", [-150.0, 0.0, 150.0])
def test_a_swept_load_and_traction(model, damping, speed):
    """Sweeps from 1 to 250 Hz, begun at rest and left to decay: spectrum over spectrum is the response.

    ``simulate`` draws straight lines between samples. That multiplies the spectrum of the samples by sinc^2(f T), and
    sampling the result folds the bands around multiples of 1/T onto each other; both are exact, so that the sum of the
    bands leaves nothing but their number (the terms fall with the fourth power and more) and what has not decayed.
    """
    unit = TABLE_1.replace(zeta_1=0.1, zeta_s=0.3, sidewall_damping=damping, contact_half_angle=0.15)
    step, count = 5e-4, 8192
    t = step * np.arange(count)
    sweep = 0.8  # [s]; the rest is for the motion to decay, by exp(-10 per second) at the least
    window = np.where(t < sweep, np.sin(math.pi * t / sweep) ** 2, 0.0)
    signal = 1e3 * window * np.sin(2.0 * math.pi * (t + 0.5 * 249.0 * t**2 / sweep))
    inputs = np.fft.rfft(signal)
    f = np.fft.rfftfreq(count, step)
    inside = (f >= 3.0) & (f <= 200.0)  # where the sweep has put something
    folded = np.zeros((inside.sum(), 2, 2), dtype=complex)
    for band in range(-20, 21):
        shifted = f[inside] + band / step
        lines = np.sinc(shifted * step) ** 2
        folded += lines[:, None, None] * wheel.frequency_response(unit, speed, shifted, model)
    for entry, name in enumerate(("load", "traction")):
        forces = {"load": 0.0, "traction": 0.0, name: signal}
        seen = simulate(unit, t, speed, **forces, initial="rest", model=model).axle_force
        assert np.abs(seen[-1]).max() < 1e-9 * np.abs(seen).max()  # it has decayed
        for output in range(2):
            ratio = np.fft.rfft(seen[:, output])[inside] / inputs[inside]
            # 1e-8: the bands beyond 20, 200 Hz/(20 x 2 kHz) squared by the lines, of a response that falls with 1/f
            assert ratio == pytest.approx(folded[:, output, entry], abs=1e-8 * np.abs(folded).max())


# -- independent derivations --------------------------------------------------------------------------------------


@given(unit=units(), speed=speeds, f=hertz)
def test_harmonic_balance_on_the_ring(unit, speed, f):
    """(3.13) and (4.6): a load exp(i w t) drives the turning coordinates at w + Omega and w - Omega, and y at w."""
    unit = unit.replace(contact_half_angle=0.0)
    w, m = 2.0 * math.pi * f, unit.ring_mass
    # A(t) = A_0 + A_s sin(Omega t) + A_c cos(Omega t), read off three moments
    turn = 2.0 * math.pi / speed if abs(speed) > 1e-3 else None
    if turn is None:
        return
    at = [wheel.state_matrix(unit, speed, phase * turn) for phase in (0.0, 0.25, 0.5)]
    A_0 = 0.5 * (at[0] + at[2])
    A_c, A_s = at[0] - A_0, at[1] - A_0
    up, down = 0.5 * (A_c - 1j * A_s), 0.5 * (A_c + 1j * A_s)  # of exp(i Omega t) and exp(-i Omega t)
    for entry in range(2):
        # f_r = -load sin + ..., at theta* = 3 pi/2 - Omega t: a load (F/m)(-sin, -cos) up, a traction f_t = -F_x
        f_r, f_t = ((-1.0, 0.0), (0.0, -1.0))[entry]
        turning = np.exp(1j * 1.5 * math.pi)  # exp(i theta*) = turning exp(-i Omega t)
        # alpha: f_r cos - f_t sin; beta: f_r sin + f_t cos, with cos = (e + e*)/2, sin = (e - e*)/(2 i)
        minus = turning / (2.0 * m) * np.array([f_r + 1j * f_t, -1j * f_r + f_t, 0, 0, 0, 0])
        plus = turning.conj() / (2.0 * m) * np.array([f_r - 1j * f_t, 1j * f_r + f_t, 0, 0, 0, 0])
        eye, none = np.eye(6), np.zeros((6, 6))
        # y couples to the ring at w +- Omega and back to w: no other harmonic is driven
        balance = np.block(
            [
                [1j * (w - speed) * eye - A_0, -down, none],
                [-up, 1j * w * eye - A_0, -down],
                [none, -up, 1j * (w + speed) * eye - A_0],
            ]
        )
        z = np.linalg.solve(balance, np.concatenate([minus, np.zeros(6), plus])).reshape(3, 6)
        y, y_rate = z[1, 5], z[1, 2]
        # X = alpha cos - beta sin at w, from alpha and beta at w -+ Omega
        (a_m, b_m), (a_p, b_p) = z[0, 3:5], z[2, 3:5]
        X = 0.5 * (a_m + a_p) - (b_m - b_p) / 2j
        Y = (a_m - a_p) / 2j + 0.5 * (b_m + b_p)
        vertical = unit.suspension_stiffness * y + unit.suspension_damping * y_rate
        horizontal = -unit.sidewall_stiffness * X
        if unit.sidewall_damping == "reaction":
            c_1 = 2.0 * unit.zeta_1 * unit.rigid_mode_frequency * m
            horizontal -= c_1 * (1j * w * X + speed * (Y - y))
        H = wheel.frequency_response(unit, speed, f)
        # 1e-8: a harmonic balance of 18 rows at condition numbers up to 1e7
        assert H[0, entry] == pytest.approx(horizontal, abs=1e-8 * np.abs(H).max())
        assert H[1, entry] == pytest.approx(vertical, abs=1e-8 * np.abs(H).max())


@given(unit=units(), speed=speeds, f=hertz)
def test_reciprocity_with_a_moving_support(unit, speed, f):
    """What a load does to the support, the moving support does to the ring, with the wheel turning the other way.

    The mass, stiffness and damping of the inextensional unit are symmetric and its circulatory term is antisymmetric,
    so the dynamic stiffness at -Omega is the transpose of that at Omega. The support is held by the suspension below
    and by the wheel's bearing ahead; x_s and y_s move it.
    """
    unit = unit.replace(contact_half_angle=0.0)
    s, m, c_s, k_s = 2j * math.pi * f, unit.ring_mass, unit.suspension_damping, unit.suspension_stiffness
    k_1, c_1 = unit.sidewall_stiffness, 2.0 * unit.zeta_1 * unit.rigid_mode_frequency * unit.ring_mass
    Omega = -speed
    reacting = c_1 if unit.sidewall_damping == "reaction" else 0.0
    # sidewall on the ring per (X, Y) of the ring and of the wheel: k + c (s - Omega J), J = [[0, -1], [1, 0]]
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    ring = k_1 * np.eye(2) + c_1 * (s * np.eye(2) - Omega * J)
    coupling = k_1 * np.eye(2) + reacting * (s * np.eye(2) - Omega * J)
    wheel_side = coupling  # the wheel's own share of the sidewall; modal dashpots have none
    dynamic = np.zeros((3, 3), dtype=complex)  # of X, Y, y
    dynamic[:2, :2] = m * s * s * np.eye(2) + ring
    dynamic[:2, 2] = -coupling[:, 1]
    dynamic[2, :2] = -coupling[1]
    dynamic[2, 2] = unit.wheel_mass * s * s + c_s * s + k_s + wheel_side[1, 1]
    below = np.linalg.solve(dynamic, np.array([0.0, 0.0, k_s + c_s * s]))  # per y_s
    ahead = np.linalg.solve(dynamic, np.concatenate([coupling[:, 0], -wheel_side[1:, 0]]))  # per x_s
    H = wheel.frequency_response(unit, speed, f)
    # load acts on +Y, traction on x_ros = -X; force.x is along -X as well: two signs cancel, one does not
    expected = np.array([[-ahead[1], ahead[0]], [below[1], -below[0]]])
    assert H == pytest.approx(expected, abs=1e-9 * np.abs(H).max())  # condition numbers up to 1e6


# -- limits and symmetries ----------------------------------------------------------------------------------------


@given(unit=units(), speed=speeds)
def test_at_zero_it_is_the_transmissibility(unit, speed):
    H = wheel.frequency_response(unit, speed, 0.0)
    assert H[1, 0] == pytest.approx(wheel.transmissibility(unit, speed), rel=1e-9)
    assert H.imag.tolist() == [[0.0, 0.0], [0.0, 0.0]]
    if unit.sidewall_damping == "reaction":  # a constant load arrives whole
        assert H == pytest.approx(np.array([[0.0, 1.0], [1.0, 0.0]]), abs=1e-9)


@given(unit=units(), speed=speeds, model=models)
def test_at_zero_it_is_the_equilibrium(unit, speed, model):
    H = wheel.frequency_response(unit, speed, 0.0, model)
    for entry, forces in enumerate([(1.0, 0.0), (0.0, 1.0)]):
        state = wheel.equilibrium(unit, speed, *forces, model)
        force = wheel.axle_force(unit, speed, state, model)
        assert H[:, entry] == pytest.approx(force, abs=1e-9 * np.abs(H).max())


def test_numbers_of_the_paper():
    """K at 2000 rpm is 0.931556, and 1961.33 N of load push 3162.18 N ahead, as in test_reference_values."""
    H = wheel.frequency_response(TABLE_1, 2000.0 * RPM, 0.0)
    assert H[1, 0] == pytest.approx(0.931556, abs=5e-7)
    assert 1961.33 * H[0, 0] == pytest.approx(3162.18, abs=5e-3)


@given(unit=units(), speed=speeds, f=hertz, model=models)
def test_symmetries(unit, speed, f, model):
    """Real signals; and a mirror: a wheel that turns backward gives the same, with forward and backward exchanged."""
    H = wheel.frequency_response(unit, speed, [f, -f], model)
    size = np.abs(H).max()
    assert H[1] == pytest.approx(H[0].conj(), abs=1e-12 * size)
    mirrored = wheel.frequency_response(unit, -speed, f, model)
    assert mirrored == pytest.approx(H[0] * [[-1.0, 1.0], [1.0, -1.0]], abs=1e-9 * size)


@given(unit=units(), model=models, f=hertz)
def test_at_standstill_the_axes_do_not_mix(unit, model, f):
    H = wheel.frequency_response(unit, 0.0, f, model)
    assert abs(H[0, 0]) < 1e-12 * abs(H[0, 1]) and abs(H[1, 1]) < 1e-12 * abs(H[1, 0])


@given(unit=units(), f=st.floats(0.0, 300.0))
def test_at_standstill_it_is_two_masses_in_a_row(unit, f):
    """Load on the ring's mass, a spring to the wheel's, and that on the suspension; modal dashpots hang in the air."""
    unit = unit.replace(contact_half_angle=0.0)
    s, m, M = 2j * math.pi * f, unit.ring_mass, unit.wheel_mass
    k_1, k_s, c_s = unit.sidewall_stiffness, unit.suspension_stiffness, unit.suspension_damping
    c_1 = 2.0 * unit.zeta_1 * math.sqrt(k_1 * m)
    between = k_1 + (c_1 * s if unit.sidewall_damping == "reaction" else 0.0)
    ring, hop = m * s * s + c_1 * s + k_1, M * s * s + c_s * s + k_s + between
    vertical = (k_s + c_s * s) * between / (ring * hop - between * between)
    H = wheel.frequency_response(unit, 0.0, f)
    assert H[1, 0] == pytest.approx(vertical, rel=1e-9, abs=1e-14)
    assert H[0, 1] == pytest.approx(between / ring, rel=1e-9, abs=1e-14)


def test_stiffer_belts_tend_to_the_inextensional_model():
    f = np.geomspace(1.0, 150.0, 40)
    errors = []
    for stiffness in (1e9, 1e10):
        unit = TABLE_1.replace(membrane_stiffness=stiffness)
        H, limit = (wheel.frequency_response(unit, 200.0, f, model) for model in ("complete", "inextensional"))
        errors.append(np.abs(H - limit).max() / np.abs(limit).max())
    assert errors[0] < 1e-3
    assert errors[1] == pytest.approx(0.1 * errors[0], rel=0.05)  # the error is proportional to 1/K


# -- shapes, poles, arguments -------------------------------------------------------------------------------------


def test_shapes():
    grid = wheel.frequency_response(TABLE_1, [[0.0, 100.0, -30.0]], [1.0, 20.0], "complete")
    assert grid.shape == (1, 3, 2, 2, 2) and grid.dtype == complex
    assert np.array_equal(grid[0, 1, 1], wheel.frequency_response(TABLE_1, 100.0, 20.0, "complete"))
    assert wheel.frequency_response(TABLE_1, [], [1.0]).shape == (0, 1, 2, 2)


def test_blocks_do_not_change_a_bit(monkeypatch):
    from tire_dynamics.science import response

    f = np.geomspace(1.0, 300.0, 50)
    whole = wheel.frequency_response(TABLE_1, [0.0, 300.0], f)
    monkeypatch.setattr(response, "_BLOCK", 7)
    assert np.array_equal(wheel.frequency_response(TABLE_1, [0.0, 300.0], f), whole)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("speed", [0.0, 100.0, -300.0])
def test_an_undamped_resonance_is_refused_and_its_neighbour_is_not(model, speed):
    unit = TABLE_1.replace(zeta_1=0.0, zeta_s=0.0)
    found = wheel.whirl_frequencies(unit, speed, model)
    assert len(found) == (3 if model == "inextensional" else 5)
    for resonance in found:
        with pytest.raises(ValueError, match=rf"has {resonance:.10g} Hz, .* at {speed:g} rad/s"):
            wheel.frequency_response(unit, speed, [1.0, resonance], model)
        near = wheel.frequency_response(unit, speed, resonance * (1.0 + np.array([1e-8, 1e-7])), model)
        sizes = np.abs(near).max(axis=(1, 2))
        assert sizes[0] == pytest.approx(10.0 * sizes[1], rel=0.05)  # a pole; its frequency is known to 1e-10, about


def test_exactly_singular():
    """kappa = (2 pi f)^2 to the last bit leaves a row of zeros, on which the solver gives up."""
    from tire_dynamics.science import response

    frame = wheel.fixed_frame(TABLE_1.replace(zeta_1=0.0, zeta_s=0.0))
    system = frame._replace(constant=frame.constant.copy())
    s = 2.0j * math.pi * 8.0
    system.constant[0, 3] = (s * s).real
    with pytest.raises(ValueError, match="frequencies has 8 Hz"):
        response._solve(system, np.zeros(2), np.array([1.0, 8.0]))


@pytest.mark.slow
@settings(max_examples=200)
@given(
    unit=units(least_damping=0.0),
    speed=st.floats(allow_nan=False, allow_infinity=False),
    f=st.floats(allow_nan=False, allow_infinity=False),
    model=models,
)
def test_never_anything_but_a_finite_number_or_a_reason(unit, speed, f, model):
    try:
        assert np.isfinite(wheel.frequency_response(unit, speed, f, model)).all()
    except ValueError as error:
        assert "frequencies has" in str(error)


@pytest.mark.parametrize(
    ("speed", "frequencies", "model", "words"),
    [
        (math.nan, 1.0, "inextensional", "speed is nan; it must be finite"),
        ([0.0, math.inf], 1.0, "inextensional", "speed is inf; it must be finite"),
        (0.0, [1.0, math.nan], "inextensional", "frequencies is nan; it must be finite"),
        (0.0, 1.0, "hybrid", "model is 'hybrid'; it must be 'inextensional' or 'complete'"),
    ],
)
def test_wrong_arguments(speed, frequencies, model, words):
    with pytest.raises(ValueError, match=words):
        wheel.frequency_response(TABLE_1, speed, frequencies, model)


@pytest.mark.parametrize("model", MODELS)
def test_whirl_frequencies_are_those_of_the_exponents(model):
    exponents = np.linalg.eigvals(wheel.fixed_frame_matrix(TABLE_1, 300.0, model))
    pairs = sorted(exponents.imag[exponents.imag > 0.0] / (2.0 * math.pi))
    assert wheel.whirl_frequencies(TABLE_1, 300.0, model) == pytest.approx(pairs, rel=1e-12)
    assert len(wheel.whirl_frequencies(TABLE_1.replace(zeta_s=0.99, suspension_stiffness=36.0), 0.0)) < 4


# -- the command --------------------------------------------------------------------------------------------------


def refused(capsys, *arguments):
    assert main([str(argument) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


@pytest.mark.slow
def test_numbers_and_picture(tmp_path, capsys):
    arguments = ["response", "--speed-rpm", "0", "-2000", "--from", "2", "--to", "200", "--points", "25", "--json"]
    assert main([*arguments, "-o", str(tmp_path / "bode.png")]) == 0
    said = json.loads(capsys.readouterr().out)
    f = np.geomspace(2.0, 200.0, 25)
    H = wheel.frequency_response(TABLE_1, [0.0, -2000.0 * RPM], f)
    assert said["frequencies_Hz"] == pytest.approx(f) and said["unit"] == TABLE_1.to_mapping()
    names = {
        "load_to_force_z": H[..., 1, 0],
        "load_to_force_x": H[..., 0, 0],
        "traction_to_force_z": H[..., 1, 1],
        "traction_to_force_x": H[..., 0, 1],
    }
    for k, speed in enumerate((0.0, -2000.0)):
        each = said["speeds"][k]
        assert each["speed_rpm"] == speed and each["verdict"] == "asymptotically stable"
        assert each["whirl_frequencies_Hz"] == pytest.approx(wheel.whirl_frequencies(TABLE_1, speed * RPM))
        for name, values in names.items():
            said_values = each[name]["ratio"] * np.exp(1j * np.radians(each[name]["phase_deg"]))
            assert said_values == pytest.approx(values[k], rel=1e-12, abs=1e-300)
    with open(tmp_path / "bode.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["speed_rpm"]) for row in rows] == [0.0] * 25 + [-2000.0] * 25
    for name, values in names.items():
        ratio, phase = ([float(row[f"{name}_{what}"]) for row in rows] for what in ("ratio", "phase_deg"))
        assert ratio * np.exp(1j * np.radians(phase)) == pytest.approx(values.ravel(), rel=1e-8)  # ten digits printed
    assert (tmp_path / "bode.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bode.csv", "bode.png"]


def test_the_picture_has_the_numbers(tmp_path):
    """Every line of the figure against the response, the cross terms at standstill left out."""
    pytest.importorskip("matplotlib", reason="the extra `plot` brings it")
    from tire_dynamics.figures.bode import Bode
    from tire_dynamics.figures.response_drawing import draw

    f = np.geomspace(1.0, 300.0, 200)
    for rpm, count in (((0.0, 2000.0, 24000.0), 3), (tuple(np.linspace(0.0, 6000.0, 7)), 7), ((0.0,), 1)):
        H = wheel.frequency_response(TABLE_1, np.multiply(rpm, RPM), f)
        whirl = tuple(wheel.whirl_frequencies(TABLE_1, speed * RPM) for speed in rpm)
        verdicts = tuple(wheel.stability(TABLE_1, speed * RPM).verdict for speed in rpm)
        axes = np.array(draw(Bode(TABLE_1, "inextensional", rpm, f, H, whirl, verdicts)).axes).reshape(4, 2)
        for column, output in enumerate((1, 0)):
            for entry in range(2):
                ratios, phases = (axes[2 * entry + k, column].get_lines()[::2] for k in range(2))
                crossing = output == entry
                drawn = [k for k in range(count) if not (crossing and rpm[k] == 0.0)]
                assert len(ratios) == len(phases) == len(drawn)
                for k, ratio, phase in zip(drawn, ratios, phases, strict=True):
                    value = ratio.get_ydata() * np.exp(1j * np.radians(phase.get_ydata()))
                    assert value == pytest.approx(H[k, :, output, entry], rel=1e-9)


def test_numbers_without_a_picture_need_no_matplotlib(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    write_unit(TABLE_1.replace(zeta_1=0.5), tmp_path / "unit.yaml")
    arguments = ["response", "--speed-rpm", "6000", "--config", str(tmp_path / "unit.yaml"), "--model", "complete"]
    assert main([*arguments, "--points", "3", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["output"], said["model"], said["speeds"][0]["verdict"]) == (None, "complete", "unstable")
    assert "pip install 'tire_dynamics[plot]'" in refused(capsys, *arguments, "-o", tmp_path / "bode.png")


@pytest.mark.slow
def test_an_unstable_speed_is_said(tmp_path, capsys):
    assert main(["response", "--speed-rpm", "24000", "--points", "3", "-o", str(tmp_path / "bode.png")]) == 0
    assert "at 24000 rpm the unit is unstable" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "bode.jpg"], "--output is bode.jpg; its name must end in .png"),
        (["-o", "nowhere/bode.png"], "nowhere: no such folder"),
        ([], "needs -o PNG or --json"),
        (["--json", "--speed-rpm", "nan"], "--speed-rpm is nan; it must be between"),
        (["--json", "--speed-rpm", "1e8"], "--speed-rpm is 100000000.0; it must be between"),
        (["--json", "--speed-rpm", *["1"] * 21], "--speed-rpm has 21 speeds; it must have at most 20"),
        (["--json", "--from", "0"], "--from is 0.0; it must be from 1e-06"),
        (["--json", "--to", "inf"], "--to is inf; it must be from 1e-06"),
        (["--json", "--from", "300"], "--from is 300.0; it must be less than --to, which is 300.0"),
        (["--json", "--points", "1"], "--points is 1; it must be from 2 to"),
        (["--json", "--config", "nowhere.yaml"], "nowhere.yaml: No such file"),
    ],
)
def test_what_the_command_refuses(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert words in refused(capsys, "response", "--speed-rpm", "0", *arguments)
    assert not list(tmp_path.iterdir())


def test_an_undamped_resonance_is_one_line(tmp_path, capsys):
    unit = TABLE_1.replace(zeta_1=0.0, zeta_s=0.0)
    write_unit(unit, tmp_path / "unit.yaml")
    resonance = repr(float(wheel.whirl_frequencies(unit, 0.0)[1]))
    arguments = ("response", "--speed-rpm", "0", "--config", tmp_path / "unit.yaml", "--from", resonance, "--json")
    assert "frequencies has 78.52021319 Hz" in refused(capsys, *arguments)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["png", "csv"])
def test_files_are_replaced_only_by_force(tmp_path, capsys, suffix):
    there = tmp_path / f"bode.{suffix}"
    there.write_text("mine")
    arguments = ["response", "--speed-rpm", "0", "--points", "3", "-o", str(tmp_path / "bode.png")]
    assert f"{there}: exists already (--force replaces it)" in refused(capsys, *arguments)
    assert there.read_text() == "mine" and len(list(tmp_path.iterdir())) == 1
    assert main([*arguments, "--force"]) == 0 and there.read_bytes() != b"mine"


def test_a_failure_leaves_what_was_there(tmp_path, monkeypatch):
    from tire_dynamics.files.outputs import aside

    there = tmp_path / "bode.csv"
    there.write_text("mine")
    with pytest.raises(RuntimeError), aside(there) as part:
        part.write_text("half")
        raise RuntimeError
    assert there.read_text() == "mine" and len(list(tmp_path.iterdir())) == 1
