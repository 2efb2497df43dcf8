"""Maps: every point against the analysis of one unit, the boundary against the critical speed, the files."""

from __future__ import annotations

import json
import math
import random
import sys
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_cli import called, refused
from test_wheel import STABLE_AGAIN, TABLE_1, units

from tire_dynamics import floquet, wheel, write_unit
from tire_dynamics.science import maps, nonuniform

RPM = math.pi / 30.0
MODELS = ("inextensional", "complete")
FIELDS = [name for name in maps.AXES if name != "speed"]
UNSTABLE = floquet.VERDICTS.index("unstable")


def unit_at(unit, grid, i, j):
    """The unit at column i and row j, and its speed if that is an axis."""
    values = {grid.x_name: float(grid.x[i]), grid.y_name: float(grid.y[j])}
    speed = values.pop("speed", None)
    return unit.replace(**values), speed


def arrays_of(result):
    return {name: getattr(result, name) for name in type(result).__slots__}


def same_bits(one, other):
    for name, value in arrays_of(one).items():
        assert np.asarray(value).tobytes() == np.asarray(getattr(other, name)).tobytes(), name


@st.composite
def axes(draw, unit):
    """Two axes around a unit's own values, in bounds: damping ratios from 0, the thickness less than any radius."""
    names = draw(st.lists(st.sampled_from(maps.AXES), min_size=2, max_size=2, unique=True))
    made = []
    for name in names:
        count = draw(st.integers(2, 4))
        if name == "speed":
            values = np.linspace(draw(st.sampled_from([-700.0, 0.0])), draw(st.floats(100.0, 3000.0)), count)
        elif name.startswith("zeta_") or name == "longitudinal_damping_ratio":
            values = np.linspace(0.0, draw(st.floats(0.1, 0.9)), count)
        elif name == "contact_half_angle":
            values = np.linspace(0.0, 1.5, count)
        elif name in ("longitudinal_stiffness", "longitudinal_mass"):
            values = np.linspace(0.0, 100.0, count) + (1e5 if name == "longitudinal_stiffness" else 0.0)
        elif name in ("vertical_stiffness", "residual_damping", "sprung_mass"):  # softer than any tire here
            values = np.linspace(1.0, 100.0, count)
        else:
            values = getattr(unit, name) * np.linspace(0.5, 2.0, count)
        made.append((name, values))
    return made


# -- every point ------------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=40)
@given(
    data=st.data(),
    unit=units(),
    model=st.sampled_from(MODELS),
    speed=st.sampled_from([-900.0, 0.0, 1e-3, 50.0, 1500.0]),
)
def test_every_point_is_that_of_one_unit(data, unit, model, speed):
    x, y = data.draw(axes(unit))
    if "speed" in (x[0], y[0]):
        speed = None
    grid = wheel.stability_map(unit, x, y, speed=speed, model=model)
    assert grid.abscissa.shape == grid.spectral_radius.shape == grid.verdict.shape == (len(y[1]), len(x[1]))
    for j, i in np.ndindex(grid.verdict.shape):
        one, own_speed = unit_at(unit, grid, i, j)
        own_speed = speed if own_speed is None else own_speed
        alone = wheel.stability(one, own_speed, model)
        assert floquet.VERDICTS[grid.verdict[j, i]] == alone.verdict
        F = wheel.fixed_frame_matrix(one, own_speed, model)
        exponents = floquet.analyze_constant(F)  # whose bound is one on exponents
        # once for either of the two, which balance the matrix in two ways
        assert abs(grid.abscissa[j, i] - exponents.exponents.real.max()) <= 2.0 * exponents.error_estimate
        if alone.period is None:
            assert math.isnan(grid.spectral_radius[j, i])
        else:
            assert abs(grid.spectral_radius[j, i] - alone.spectral_radius) <= 2.0 * alone.error_estimate


@given(unit=units(), model=st.sampled_from(MODELS))
@settings(max_examples=20)
def test_matrices_of_many_units_have_the_bits_of_one(unit, model):
    changes = {name: getattr(unit, name) * np.array([0.6, 1.0, 1.3]) for name in FIELDS}
    stack = wheel.stacked_frames(maps._Units(unit, **changes), (3,), model)
    for k in range(3):
        one = wheel.fixed_frame(unit.replace(**{name: float(values[k]) for name, values in changes.items()}), model)
        for part in ("constant", "spin", "output", "output_spin"):
            assert getattr(stack, part)[k].tobytes() == getattr(one, part).tobytes()


@pytest.mark.parametrize("model", MODELS)
def test_undamped_units_are_marginal(model):
    undamped = TABLE_1.replace(zeta_1=0.0, zeta_s=0.0)
    grid = wheel.stability_map(
        undamped, ("speed", np.linspace(-500.0, 500.0, 5)), ("wheel_mass", [2.0, 8.0, 40.0]), model=model
    )
    assert (grid.verdict == floquet.VERDICTS.index("marginally stable")).all()
    assert len(grid.boundary) == len(grid.segments) == 0
    assert np.nanmax(np.abs(grid.spectral_radius - 1.0)) < 1e-9


def test_no_turn_at_standstill():
    grid = wheel.stability_map(TABLE_1, ("speed", [-1.0, 0.0, 1e-305, 1.0]), ("zeta_s", [0.1]))
    assert np.isnan(grid.spectral_radius).tolist() == [[False, True, True, False]]
    assert (grid.verdict == 0).all()


@pytest.mark.parametrize("model", MODELS)
def test_verdicts_of_many_matrices_are_those_of_each(model):
    """The quick certificate against the analysis of single matrices, at and near the boundary as well."""
    unit = TABLE_1.replace(zeta_1=0.3)
    critical = wheel.critical_speed(unit, model)
    offsets = np.array([-0.5, -1e-3, -1e-6, -1e-9, -1e-12, 0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.5])
    F = np.stack([wheel.fixed_frame_matrix(unit, critical * (1.0 + x), model) for x in offsets])
    undamped = unit.replace(zeta_1=0.0, zeta_s=0.0)
    defective = np.kron(np.eye(len(F[0]) // 2), [[0.0, 0.0], [1.0, 0.0]])
    F = np.concatenate([F, wheel.fixed_frame_matrix(undamped, 1.0, model)[None], defective[None], 0.0 * F[:1]])
    sizes = np.ones(F.shape[:2])
    sizes[:, len(F[0]) // 2 :] = 2.0**-10  # 1/1024 rad/s
    exponents, codes = floquet.constant_verdicts(F, sizes)
    alone = [floquet.analyze_constant(matrix) for matrix in F]
    assert [floquet.VERDICTS[code] for code in codes] == [one.verdict for one in alone]
    assert set(codes.tolist()) == {0, 1, 2}
    for values, one in zip(exponents, alone, strict=True):
        assert abs(values.real.max() - one.exponents.real.max()) <= 2.0 * one.error_estimate


# -- the boundary -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("damping", ["modal", "reaction"])
@pytest.mark.parametrize("flipped", [False, True])
def test_boundary_is_the_critical_speed(model, damping, flipped):
    """To 0.1 %, as is asked, and in fact far better, with the speed along either axis."""
    unit = TABLE_1.replace(sidewall_damping=damping)
    names = ("zeta_1", np.linspace(0.05, 0.6, 12)), ("speed", np.linspace(10.0, 3000.0, 31))
    x, y = names[::-1] if flipped else names
    grid = wheel.stability_map(unit, x, y, model=model)
    zeta, speed = (grid.boundary[:, k] for k in ((1, 0) if flipped else (0, 1)))
    assert len(zeta) > 15
    critical = [wheel.critical_speed(unit.replace(zeta_1=float(z)), model) for z in zeta]
    assert speed == pytest.approx(critical, rel=1e-5)  # a millionth along zeta_1 is a few along the speed
    on_line = np.isin(zeta, names[0][1])
    assert on_line.any() and not on_line.all()
    assert np.isin(speed[~on_line], names[1][1]).all()


@given(data=st.data(), unit=units(), speed=st.floats(200.0, 2500.0))
@settings(max_examples=20)
@example(data=None, unit=TABLE_1, speed=800.0)
def test_boundary_parts_stable_from_unstable(data, unit, speed):
    """A step of 0.1 % to both sides along the grid's line changes the verdict."""
    if data is None:
        x, y = ("zeta_1", np.linspace(0.01, 0.9, 8)), ("suspension_stiffness", np.geomspace(1e4, 1e7, 8))
    else:
        x, y = data.draw(axes(unit))
    speed = None if "speed" in (x[0], y[0]) else speed
    grid = wheel.stability_map(unit, x, y, speed=speed)
    unstable = grid.verdict == UNSTABLE
    for point in grid.boundary:
        values = dict(zip((grid.x_name, grid.y_name), point.tolist(), strict=True))
        along = grid.x_name if point[1] in grid.y and point[0] not in grid.x else grid.y_name
        verdicts = []
        for factor in (0.999, 1.001):
            there = {**values, along: values[along] * factor}
            if along.startswith("zeta_") and there[along] >= 1.0:
                break
            at = there.pop("speed", speed)
            verdicts.append(wheel.stability(unit.replace(**there), at).verdict == "unstable")
        else:
            assert verdicts[0] != verdicts[1]
    # each edge of the grid whose ends differ has one
    edges = (unstable[:, 1:] != unstable[:, :-1]).sum() + (unstable[1:] != unstable[:-1]).sum()
    assert len(grid.boundary) >= edges if "speed" in values_of(grid) else len(grid.boundary) == edges


def values_of(grid):
    return (grid.x_name, grid.y_name)


def test_crossings_between_two_points_of_the_grid_are_found():
    """Unstable from 690 to 1550 rad/s, between two speeds of the grid that are both stable."""
    speeds = [speed for speed, _ in wheel.crossings(STABLE_AGAIN, "complete")]
    assert [lost for _, lost in wheel.crossings(STABLE_AGAIN, "complete")] == [True, False, True]
    grid = wheel.stability_map(
        STABLE_AGAIN,
        ("wheel_mass", [STABLE_AGAIN.wheel_mass]),
        ("speed", [-2000.0, 0.0, 100.0, 2000.0]),
        model="complete",
    )
    assert not (grid.verdict == UNSTABLE).any()
    found = sorted([-speed for speed in speeds[:2]] + speeds[:2])
    assert np.sort(grid.boundary[:, 1]) == pytest.approx(found)
    assert len(grid.segments) == 0


def test_segments_follow_the_boundary():
    """One curve from edge to edge of the map: a chain, each piece of which lies in one cell."""
    grid = wheel.stability_map(
        TABLE_1, ("zeta_1", np.linspace(0.1, 0.6, 20)), ("speed", np.linspace(100.0, 2000.0, 25))
    )
    assert len(grid.segments) == len(grid.boundary) - 1
    uses = np.bincount(grid.segments.ravel(), minlength=len(grid.boundary))
    assert sorted(uses)[:3] == [1, 1, 2] and uses.max() == 2
    spans = np.abs(grid.boundary[grid.segments[:, 0]] - grid.boundary[grid.segments[:, 1]])
    assert (spans <= np.array([np.diff(grid.x)[0], np.diff(grid.y)[0]]) * (1 + 1e-9)).all()


@pytest.mark.parametrize(("diagonal", "middle"), [(False, -1.0), (False, 1.0), (True, -1.0), (True, 1.0)])
def test_a_cell_that_is_crossed_four_times(diagonal, middle, monkeypatch):
    """Two opposite corners are unstable; whether the boundary cuts off these or the others, the middle says."""
    unstable = np.array([[True, False], [False, True]]) ^ diagonal
    monkeypatch.setattr(maps, "_judge", lambda grid, x, y: (x, np.full(x.shape, UNSTABLE)))
    grid = maps._Grid(TABLE_1, "zeta_1", "zeta_s", np.array([0.1, 0.2]), np.array([0.1, 0.2]), 1.0, "inextensional")
    boundary, segments = maps._boundary(grid, np.where(unstable, 1.0, -1.0) + 0.5 * middle, unstable, map)
    assert len(boundary) == 4 and sorted(segments.ravel()) == [0, 1, 2, 3]
    corner_joined = unstable[0, 0] == (middle > 0.0)  # with the opposite one: not cut off on its own
    below, left = 0, 2  # points along x come first, then those along y, by rows
    assert ({below, left} in [set(pair) for pair in segments.tolist()]) != corner_joined


# -- splitting --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("names", [("zeta_1", "speed"), ("speed", "zeta_1"), ("zeta_1", "zeta_s")])
def test_bits_do_not_depend_on_the_splitting(names, model, monkeypatch):
    """Other blocks, in another order, in other processes: damped, undamped and near the boundary."""
    ranges = {
        "zeta_1": np.linspace(0.0, 0.5, 23),
        "zeta_s": np.linspace(0.0, 0.5, 19),
        "speed": np.linspace(0, 2e3, 19),
    }
    x, y = ((name, ranges[name]) for name in names)
    speed = None if "speed" in names else 700.0
    whole = wheel.stability_map(TABLE_1, x, y, speed=speed, model=model)
    monkeypatch.setattr(maps, "BLOCK", 7)
    monkeypatch.setattr(maps, "LINES", 3)

    def shuffled(function, items):
        items = list(items)
        order = random.Random(1).sample(range(len(items)), len(items))
        results = {k: function(items[k]) for k in order}
        return [results[k] for k in range(len(items))]

    same_bits(whole, wheel.stability_map(TABLE_1, x, y, speed=speed, model=model, over=shuffled))
    if model == "inextensional":
        monkeypatch.undo()
        with ProcessPoolExecutor(2) as pool:
            same_bits(whole, wheel.stability_map(TABLE_1, x, y, speed=speed, model=model, over=pool.map))


# -- transmissibility -------------------------------------------------------------------------------------------


@given(data=st.data(), unit=units(), speed=st.floats(-800.0, 800.0))
def test_transmissibility_map(data, unit, speed):
    x, y = data.draw(axes(unit))
    grid = wheel.transmissibility_map(unit, x, y, speed=None if "speed" in (x[0], y[0]) else speed)
    assert grid.transmissibility.shape == (len(y[1]), len(x[1]))
    for j, i in np.ndindex(grid.transmissibility.shape):
        one, own_speed = unit_at(unit, grid, i, j)
        K = wheel.transmissibility(one, speed if own_speed is None else own_speed)
        assert grid.transmissibility[j, i] == K  # the same operations in the same order


# -- arguments --------------------------------------------------------------------------------------------------

ZETA = ("zeta_1", [0.1, 0.2])


@pytest.mark.parametrize(
    ("x", "y", "speed", "words"),
    [
        (("zeta_1", [0.1, 1.0]), ("speed", [1.0]), None, r"zeta_1 is 1\.0; a damping ratio must be in \[0, 1\)"),
        (("radius", [0.0, 1.0]), ("speed", [1.0]), None, r"radius is 0\.0; it must be > 0"),
        (("radius", [0.1, 0.3]), ("thickness", [0.05, 0.2]), 1.0, r"thickness is 0\.2; a thin ring needs .* 0\.1"),
        (("wheel_mass", [1.0, 1e308]), ("suspension_stiffness", [1e-300, 1.0]), 1.0, "beyond what numbers"),
        (("zeta_1", [0.1, math.nan]), ("speed", [1.0]), None, "zeta_1 is nan; it must be finite"),
        (("speed", [0.1, math.inf]), ZETA, None, "speed is inf; it must be finite"),
        (("speed", [1.0, 1.0]), ZETA, None, r"speed is 1\.0 and then 1\.0; its values must increase"),
        (("speed", [[1.0]]), ZETA, None, r"speed has values of shape \(1, 1\)"),
        (("speed", []), ZETA, None, r"speed has values of shape \(0,\)"),
        (("speed_rpm", [1.0]), ZETA, None, "'speed_rpm' cannot be an axis; the axes are density, "),
        (("sidewall_damping", [1.0]), ZETA, 1.0, "'sidewall_damping' cannot be an axis"),
        (ZETA, ZETA, 1.0, "both axes are 'zeta_1'"),
        (ZETA, ("zeta_s", [0.1]), None, "speed is missing"),
        (ZETA, ("zeta_s", [0.1]), math.nan, "speed is nan; it must be finite"),
        (ZETA, ("speed", [0.1]), 1.0, r"speed is 1\.0; it must not be given"),
    ],
)
def test_wrong_arguments(x, y, speed, words):
    for function in (wheel.stability_map, wheel.transmissibility_map):
        with pytest.raises(ValueError, match=words):
            function(TABLE_1, x, y, speed=speed)


def test_wrong_model():
    with pytest.raises(ValueError, match="model is 'rigid'"):
        wheel.stability_map(TABLE_1, ZETA, ("speed", [1.0]), model="rigid")


# -- the command ------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_files(tmp_path):
    """What is in the .npz, and that a second run writes the same bytes."""
    arguments = ("map", "--x", "zeta_1=0.1:0.5:9", "--y", "speed_rpm=-9000:9000:13", "-o")
    done = called(*arguments, tmp_path / "a.png")
    assert done.returncode == 0 and "9 x 13 points" in done.stderr and done.stdout == ""
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file)
    assert (str(arrays["x_name"]), str(arrays["y_name"]), str(arrays["model"])) == ("zeta_1", "speed_rpm", MODELS[0])
    rpm = np.linspace(-9000.0, 9000.0, 13)
    assert np.array_equal(arrays["y"], rpm) and np.array_equal(arrays["x"], np.linspace(0.1, 0.5, 9))
    grid = wheel.stability_map(TABLE_1, ("zeta_1", arrays["x"]), ("speed", rpm * RPM))
    assert np.array_equal(arrays["spectral_abscissa_1_s"], grid.abscissa)
    assert np.array_equal(arrays["spectral_radius"], grid.spectral_radius, equal_nan=True)
    assert np.array_equal(arrays["verdict"], grid.verdict) and tuple(arrays["verdicts"]) == floquet.VERDICTS
    assert arrays["boundary"] == pytest.approx(grid.boundary / [1.0, RPM], rel=1e-15)
    assert np.array_equal(arrays["segments"], grid.segments)
    assert json.loads(str(arrays["unit"])) == TABLE_1.to_mapping() and math.isnan(arrays["speed_rad_s"])
    assert called(*arguments, tmp_path / "b.png").returncode == 0
    for suffix in ("png", "npz"):
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()


VARYING = TABLE_1.replace(
    zeta_1=0.02, zeta_s=0.02,
    radial_nonuniformity=[(2, 0.2, 0.3)], tangential_nonuniformity=[(2, 0.2, 0.3 + math.pi / 2)],
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("axes", ["xy", "yx"])
def test_tongues_over_the_amplitudes(tmp_path, axes):
    """Point by point; the boundary lies where growth begins, to a cell of the grid, a tongue where its tip is said."""
    write_unit(VARYING, tmp_path / "unit.yaml")
    along = {axes[0]: "speed_rpm=4000:7000:31", axes[1]: "nonuniformity=0:1.5:16"}
    arguments = [text for axis, value in along.items() for text in (f"--{axis}", value)]
    done = called("map", *arguments, "--config", tmp_path / "unit.yaml", "-o", tmp_path / "m.png")
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "m.npz") as file:
        arrays = dict(file)
    speeds, scales = (arrays[axis] for axis in axes)
    verdict = arrays["verdict"] if axes == "xy" else arrays["verdict"].T
    growth = arrays["spectral_abscissa_1_s"] if axes == "xy" else arrays["spectral_abscissa_1_s"].T
    for i, j in ((3, 7), (10, 7), (15, 21), (0, 4)):
        alone = nonuniform.stability(VARYING, nonuniform.Nonuniformity.of(VARYING).scaled(scales[i]), speeds[j] * RPM)
        assert floquet.VERDICTS[verdict[i, j]] == alone.verdict
        assert growth[i, j] == pytest.approx(alone.exponents.real.max(), rel=1e-6, abs=1e-6)
    boundary = arrays["boundary"] if axes == "xy" else arrays["boundary"][:, ::-1]
    assert len(boundary) > 20 and arrays["segments"].max() == len(boundary) - 1
    for tip in nonuniform.combination_resonances(VARYING, nonuniform.Nonuniformity.of(VARYING)):
        if 4000.0 < tip.speed / RPM < 7000.0:
            near = boundary[np.abs(boundary[:, 0] - tip.speed / RPM) < 100.0]  # the grid's step
            assert near[:, 1].min() == pytest.approx(tip.threshold, abs=0.15)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--x", "speed=1:2:2", "--y", "zeta_1=0.1:0.2:2"), "not uniform"),
        (("--x", "nonuniformity=0:1:2", "--y", "zeta_1=0.1:0.2:2", "--speed-rpm", "9"), "beside speed"),
        (("--x", "speed=0:2:2", "--y", "nonuniformity=0:1:2"), "not zero"),
        (("--x", "speed=1:2:2", "--y", "nonuniformity=0:6:2"), "must be > 0"),
        (("--x", "speed=1:2:2", "--y", "nonuniformity=-1:1:2"), ">= 0"),
        (("--x", "speed=1:2:2", "--y", "nonuniformity=0:1:2", "--quantity", "transmissibility"), "map of stability"),
    ],
)
def test_maps_that_a_varying_unit_cannot_have(tmp_path, arguments, words):
    write_unit(VARYING, tmp_path / "unit.yaml")
    assert words in refused("map", *arguments, "--config", tmp_path / "unit.yaml", "-o", tmp_path / "m.png")


def test_a_uniform_unit_has_no_amplitudes_to_map(tmp_path):
    said = refused("map", "--x", "speed=1:2:2", "--y", "nonuniformity=0:1:2", "-o", tmp_path / "m.png")
    assert "is uniform" in said


def test_transmissibility_with_a_unit_of_ones_own(tmp_path):
    unit = TABLE_1.replace(zeta_1=0.3)
    write_unit(unit, tmp_path / "unit.yaml")
    done = called(
        *("map", "--x", "suspension_stiffness=1e4:1e6:5", "--log-x", "--y", "wheel_mass=2:20:4", "--speed-rpm", 3000),
        *("--quantity", "transmissibility", "--config", tmp_path / "unit.yaml", "-o", tmp_path / "K.png"),
    )
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "K.npz") as arrays:
        assert arrays["x"] == pytest.approx([1e4, 10**4.5, 1e5, 10**5.5, 1e6])
        expected = [wheel.transmissibility(unit.replace(suspension_stiffness=k), 3000 * RPM) for k in arrays["x"]]
        assert arrays["transmissibility"].tolist() == [expected] * 4
        assert arrays["speed_rad_s"] == 3000 * RPM


@pytest.mark.parametrize("quantity", ["stability", "transmissibility"])
@pytest.mark.parametrize("zeta_1", [0.0, 0.5])
def test_a_picture_of_anything(tmp_path, quantity, zeta_1):
    """All marginal or all of one sign; K = 1 everywhere; two points along an axis."""
    write_unit(TABLE_1.replace(zeta_1=zeta_1, zeta_s=0.0), tmp_path / "unit.yaml")
    done = called(
        *("map", "--x", "speed_rpm=-1:1:2", "--y", "wheel_mass=1:2:3", "--quantity", quantity),
        *("--config", tmp_path / "unit.yaml", "-o", tmp_path / "map.png"),
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "map.png").stat().st_size > 10_000


@pytest.mark.slow
def test_model_of_the_configuration(tmp_path):
    path = tmp_path / "vehicle.yaml"
    path.write_text("/**:\n  ros__parameters:\n    model: complete\n")
    arguments = ("map", "--x", "zeta_1=0.1:0.5:2", "--y", "speed=0:900:3", "--config", path, "-o", tmp_path / "m.png")
    assert called(*arguments).returncode == 0
    with np.load(tmp_path / "m.npz") as arrays:
        assert str(arrays["model"]) == "complete"
        expected = wheel.stability_map(
            TABLE_1, ("zeta_1", [0.1, 0.5]), ("speed", [0.0, 450.0, 900.0]), model="complete"
        )
        assert np.array_equal(arrays["spectral_abscissa_1_s"], expected.abscissa)
    words = refused(*arguments, "--force", "--quantity", "transmissibility")
    assert "--quantity transmissibility is for --model inextensional" in words
    assert called(*arguments, "--force", "--quantity", "transmissibility", "--model", "inextensional").returncode == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--x", "zeta_1=0.1"], "--x is 'zeta_1=0.1'; it must be FIELD=LOW:HIGH"),
        (["--x", "zeta_1=a:1"], "--x is 'zeta_1=a:1'"),
        (["--x", "zeta_1=0:0.5:2.5"], "--x is 'zeta_1=0:0.5:2.5'"),
        (["--x", "zeta_1=0:0.5:3:4"], "--x is 'zeta_1=0:0.5:3:4'"),
        (["--x", "zeta=0:0.5"], "--x: 'zeta' cannot be an axis; the axes are density,"),
        (["--x", "zeta_1=0.5:0.1"], "--x: zeta_1 runs from 0.5 to 0.1"),
        (["--x", "zeta_1=0:nan"], "--x: zeta_1 runs from 0.0 to nan"),
        (["--x", "zeta_1=0:0.5:1"], "--x: N is 1; it must be from 2 to"),
        (["--x", "zeta_1=0:0.5:99999"], "--x: N is 99999"),
        (["--x", "zeta_1=0:0.5", "--log-x"], "--x: LOW is 0.0; for equal ratios it must be > 0"),
        (["--x", "zeta_1=0:1:5"], "zeta_1 is 1.0; a damping ratio must be in [0, 1)"),
        (["--y", "speed_rpm=0:1e8"], "--y: speed_rpm runs from 0.0 to 100000000.0; it must be between"),
        (["--y", "zeta_s=0:0.1"], "one of --x, --y and --speed-rpm must say the speed; none does"),
        (["--speed-rpm", "100"], "must say the speed; more than one does"),
        (["--x", "speed=0:10"], "must say the speed; more than one does"),
        (["--y", "zeta_s=0:0.1", "--speed-rpm", "nan"], "--speed-rpm is nan"),
        (["--y", "zeta_1=0:0.1", "--speed-rpm", "1"], "both axes are 'zeta_1'"),
        (["--config", "nowhere.yaml"], "nowhere.yaml: No such file"),
        (["--quantity", "noise"], "invalid choice: 'noise'"),
        (["-o", "map.jpg"], "--output is map.jpg; its name must end in .png"),
        (["-o", "nowhere/map.png"], "nowhere: no such folder"),
    ],
)
def test_what_the_command_refuses(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    whole = ("map", "--x", "zeta_1=0.1:0.5:3", "--y", "speed_rpm=0:100:3", "-o", "map.png", *arguments)
    assert words in refused(*whole)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["png", "npz"])
def test_files_are_replaced_only_by_force(tmp_path, suffix):
    there = tmp_path / f"map.{suffix}"
    there.write_text("mine")
    arguments = ("map", "--x", "zeta_1=0.1:0.5:3", "--y", "speed_rpm=0:100:3", "-o", tmp_path / "map.png")
    assert f"{there}: exists already (--force replaces it)" in refused(*arguments)
    assert there.read_text() == "mine" and len(list(tmp_path.iterdir())) == 1
    assert called(*arguments, "--force").returncode == 0
    assert there.read_bytes() != b"mine"


def test_without_matplotlib_it_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    arguments = ("map", "--x", "zeta_1=0.1:0.5", "--y", "speed_rpm=0:100", "-o", tmp_path / "map.png")
    assert "pip install 'tire_dynamics[plot]'" in refused(*arguments)
