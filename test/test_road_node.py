"""Wheels on the road behind their topics: bad input, logs and replays."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from tire_dynamics import TireWheelUnit, simulate, wheel, write_unit
from tire_dynamics.bag import BagReader, BagWriter
from tire_dynamics.cdr import messages
from tire_dynamics.cli.main import main
from tire_dynamics.cli.report import report
from tire_dynamics.estimator.vehicle import stability_reply
from tire_dynamics.files.errors import InputError
from tire_dynamics.replay.parameters import complete
from tire_dynamics.replay.pipeline import Pipeline
from tire_dynamics.replay.replay import replay
from tire_dynamics.report import theory
from tire_dynamics.report.gather import gather

MS = 1_000_000
TIRE = {"vertical_stiffness": 2e5, "contact_half_angle": 0.15, "sprung_mass": 350.0, "zeta_s": 0.3,
        "sidewall_damping": "reaction"}  # fmt: skip
ROAD = {
    "load_source": "road", "static_loads": [4000.0], "n_max": 5, "ring_samples": 5,
    **{f"tire.{name}": value for name, value in TIRE.items()},
}  # fmt: skip


def number(value: float) -> bytes:
    return messages.encode_float64(float(value))


def driven(pipeline, heights, speed=60.0, first=1, late=0):
    """Ticks every 2 ms, each after a speed and a height; the outputs of each tick."""
    outputs = []
    for k, height in enumerate(heights, first):
        now = 2 * MS * k
        pipeline.receive("wheel/wheel_speed", now - late, number(speed))
        if height is not None:
            pipeline.receive("wheel/road_height", now - late, number(height))
        outputs.append([*pipeline.tick(now), *pipeline.belts()])
    return outputs


def forces(outputs, topic):
    decoder = messages.WrenchDecoder()
    return [decoder.decode(data).fz for tick in outputs for name, data in tick if name == topic]


def test_a_road_of_samples_is_one_of_lines():
    """Heights that come with the ticks make what ``simulate`` makes of the same samples, joined by lines."""
    heights = 0.5 + 0.01 * np.sin(0.3 * np.arange(60))
    outputs = driven(Pipeline(ROAD), heights)
    found = simulate(
        TireWheelUnit.table_1(**TIRE), 2e-3 * np.arange(60), 60.0, road=heights, static_load=4000.0, n_max=5
    )
    assert forces(outputs, "wheel/contact_load") == pytest.approx(found.contact_force.tolist(), abs=1e-9)
    assert forces(outputs, "wheel/axle_wrench") == pytest.approx(found.axle_force[:, 1].tolist(), abs=1e-9)


def test_points_feel_the_road_one_after_the_other():
    """As ``simulate``, which has heights under the axle, a step after those that are told under the foremost edge."""
    unit = TireWheelUnit.table_1(**TIRE)
    reach = unit.radius * math.sin(unit.contact_half_angle * 4 / 5)  # of the first of five points
    speed = reach / 2e-3 / unit.radius  # so that samples lie at the edges and at the axle
    heights = np.interp(np.arange(80), [5, 6, 8, 9], [0.0, 5e-3, 5e-3, 0.0])
    outputs = driven(Pipeline({**ROAD, "contact_points": 5}), heights[1:], speed)
    found = simulate(
        unit, 2e-3 * np.arange(79), speed, road=heights[:-1], static_load=4000.0, n_max=5, contact_points=5
    )
    assert np.ptp(found.contact_force) > 300.0
    assert forces(outputs, "wheel/contact_load") == pytest.approx(found.contact_force.tolist(), abs=1e-6)


def test_the_parameters_of_the_contact_act():
    heights = 0.005 * np.sin(0.2 * np.arange(60))
    varying = {**ROAD, "tire.radial_nonuniformity": [1.0, 0.05, 0.0]}
    one, five, uneven, left_out = (
        forces(driven(Pipeline(values), heights), "wheel/contact_load")
        for values in (ROAD, {**ROAD, "contact_points": 5}, varying, {**varying, "coupled_harmonics": 0})
    )
    assert left_out == one
    assert min(np.abs(np.subtract(each, one)).max() for each in (five, uneven)) > 5.0
    unit = TireWheelUnit.table_1(**TIRE, radial_nonuniformity=[(1, 0.05, 0.0)])
    found = simulate(unit, 2e-3 * np.arange(60), 60.0, road=heights, static_load=4000.0, n_max=5)
    assert uneven == pytest.approx(found.contact_force.tolist(), abs=1e-9)


def test_the_topics_are_those_of_the_road():
    pipeline = Pipeline({**ROAD, "wheels": ["a", "b"], "static_loads": [1.0, 2.0]})
    assert list(pipeline.inputs) == ["joint_states", "a/wheel_speed", "a/road_height", "b/wheel_speed", "b/road_height"]
    assert {f"{name}/contact_load" for name in "ab"} <= set(pipeline.outputs)
    assert "wheel/contact_load" not in Pipeline({}).outputs


def test_heights_that_cannot_be_used_are_counted_and_left_out():
    """NaN, infinite, a jump of 1 m, not a Float64: the wheel goes on over the road as it was."""
    good, bad = Pipeline(ROAD), Pipeline(ROAD)
    heights = (0.005 * np.sin(0.2 * np.arange(40))).tolist()
    expected = driven(good, heights)
    found = driven(bad, heights[:20])
    for data in (number(math.nan), number(math.inf), number(heights[19] + 1.0), number(1e300), b"\0\1\0\0\0"):
        bad.receive("wheel/road_height", 40 * MS, data)
    found += driven(bad, heights[20:], first=21)
    assert found == expected
    counts = bad.vehicle.inputs[0].counts
    assert counts["not finite"] == 1 and counts["road jumps"] == 3  # an infinite one is beyond every bound, too
    assert bad.malformed == {"wheel/road_height": 1}


def test_a_road_that_stops_stops_the_wheel_and_starts_it_anew():
    """After the timeout there is no output; the first height then is a new road, however far from the old one."""
    pipeline = Pipeline(ROAD)
    first = driven(pipeline, [0.0] * 10)
    silent = driven(pipeline, [None] * 150, first=11)
    assert all(any(name == "wheel/axle_wrench" for name, _ in tick) for tick in first)
    assert not silent[-1] and pipeline.vehicle.inputs[0].stops == 1
    again = driven(pipeline, [7.0] * 5, first=161)
    assert forces(again, "wheel/contact_load") == pytest.approx([4000.0] * 5, rel=1e-12)


def test_a_road_that_jumps_for_good_is_a_new_one_after_the_timeout():
    pipeline = Pipeline(ROAD)
    driven(pipeline, [0.0] * 10)
    after = driven(pipeline, [3.0] * 150, first=11)
    inputs = pipeline.vehicle.inputs[0]
    assert inputs.stops == 1 and inputs.counts["road jumps"] > 90
    assert forces(after[-5:], "wheel/contact_load") == pytest.approx([4000.0] * 5, rel=1e-12)


def test_a_unit_that_diverges_is_given_up_and_counted():
    """Above the critical speed on the road: no NaN comes out, and it stays silent while it is unstable."""
    values = {**ROAD, "max_speed_rad_s": 4000.0, "tire.zeta_s": 0.0, "tire.zeta_n": 0.0, "tire.sprung_mass": 0.0}
    pipeline = Pipeline(values)
    unit = TireWheelUnit.table_1(**{**TIRE, "zeta_s": 0.0, "zeta_n": 0.0, "sprung_mass": 0.0})
    speed = 3500.0
    assert wheel.stability(unit, speed, contact=True, n_max=5).verdict == "unstable"
    outputs = driven(pipeline, np.random.default_rng(0).normal(0.0, 0.01, 3000), speed)
    assert np.isfinite(forces(outputs, "wheel/axle_wrench") + forces(outputs, "wheel/contact_load")).all()
    assert pipeline.vehicle.inputs[0].divergences == 1 and not outputs[-1]


@pytest.mark.parametrize(
    "changes", [{}, {"contact_points": 5}, {"tire.radial_nonuniformity": [1.0, 0.05, 0.3], "model": "complete"}]
)
def test_a_restored_vehicle_goes_on_bit_for_bit(changes):
    values = {**ROAD, **changes}
    first = Pipeline(values)
    heights = np.random.default_rng(1).normal(0.0, 0.02, 60).tolist()
    driven(first, heights[:30])
    second = Pipeline(values)
    second.vehicle.restore(json.loads(json.dumps(first.vehicle.snapshot())))
    expected, found = (driven(each, heights[30:], first=31, late=300_000) for each in (first, second))
    assert found == expected
    assert first.vehicle.snapshot() == second.vehicle.snapshot()


def test_a_record_of_an_earlier_build_is_read():
    """A record that says ``told`` and ``held``, as records did; on several contact points, speeds from a field map."""
    mapped = {"topic": "wheel/wheel_speed", "type": "std_msgs/msg/Float64", "field": "data"}
    values = {**ROAD, **{f"inputs.speed.{name}": value for name, value in mapped.items()}, "contact_points": 5}
    first, second = Pipeline(values), Pipeline(values)
    heights = np.random.default_rng(2).normal(0.0, 0.02, 40).tolist()
    driven(first, heights[:20])
    new = messages.decode_string(first.record({}))
    old = new.replace('"edge_height"', '"told"').replace('"last_values"', '"held"')
    assert len(old) == len(new) - len("edge_height") + len("told") - len("last_values") + len("held")
    second.restore(json.loads(old))
    assert second.record({}) == first.record({})
    assert driven(second, heights[20:], first=21) == driven(first, heights[20:], first=21)


@pytest.mark.parametrize("varying", [[], [1.0, 0.05, 0.0]])
def test_vehicle_library_and_command_give_one_reply(varying, tmp_path, capsys):
    values = {**ROAD, "n_max": 3, "tire.radial_nonuniformity": varying}
    vehicle = Pipeline(values).vehicle
    vehicle.wheel_speed(0, 0, 100.0)
    vehicle.tick(0)
    reply = vehicle.stability(0)
    unit = vehicle.unit
    assert reply == stability_reply("wheel", unit, 100.0, n_max=3, contact=True)
    assert reply.keys() == stability_reply("wheel", unit, 100.0).keys()
    assert reply["periodicity"] == ("irreducible" if varying else "reducible")
    write_unit(unit, tmp_path / "tire.yaml")
    rpm = str(100.0 * 30.0 / math.pi)
    main(["stability", "--contact", "--speed-rpm", rpm, "--n-max", "3", "--config", str(tmp_path / "tire.yaml")])
    said = json.loads(capsys.readouterr().out)
    assert said.keys() == reply.keys()
    assert {name: said[name] for name in ("contact", "verdict", "n_max", "periodicity")} == {
        name: reply[name] for name in ("contact", "verdict", "n_max", "periodicity")
    }
    assert np.array(said["multipliers"]) == pytest.approx(np.array(reply["multipliers"]), abs=1e-9)


def test_the_stability_says_that_it_is_of_the_road():
    vehicle = Pipeline({**ROAD, "n_max": 3}).vehicle
    reply = vehicle.stability(0)
    assert reply["contact"] is True
    assert reply["verdict"] == "asymptotically stable"
    assert len(reply["exponents_1_s"]) == 6 + 2 + 2 * 2 * 2  # n = 1 and wheel, body, two harmonics
    assert Pipeline({}).vehicle.stability(0)["contact"] is False


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"static_loads": []}, "static_loads has 0 entries"),
        ({"static_loads": [0.0]}, "static_loads has 0.0"),
        ({"tire.vertical_stiffness": 4e5}, r"tire.vertical_stiffness is 400000.0; it must be <"),
        ({"load_source": "guess"}, "load_source is 'guess'"),
        ({"contact_points": 0}, "contact_points is 0; it must be at least 1"),
        ({"contact_points": 3, "tire.contact_half_angle": 0.0}, "contact_points is 3; it must be 1 where contact_half"),
        ({"coupled_harmonics": -1}, "coupled_harmonics is -1; it must be at least 0"),
    ],
)
def test_parameters_that_are_refused(values, word):
    with pytest.raises(ValueError, match=word):
        complete({**ROAD, **values})


def bag_of_a_road(path, seconds=1.0):
    with BagWriter(path) as writer:
        speeds = writer.add_topic("/wheel/wheel_speed", messages.FLOAT64)
        heights = writer.add_topic("/wheel/road_height", messages.FLOAT64)
        random, height = np.random.default_rng(2), 0.0
        for k in range(round(seconds * 500)):
            now = 10**9 + 2 * MS * k
            height += float(random.normal(0.0, 1e-3))
            writer.write(speeds, now, now, number(60.0 + 5.0 * math.sin(0.01 * k)))
            writer.write(heights, now, now, number(height))
    return path


def outputs_of(folder):
    """The data of each output, by topic."""
    found = {}
    for topic, _, _, _, data in BagReader(folder).messages():
        if topic.endswith(("axle_wrench", "contact_load", "ring_deflection", "ring_shape")):
            found.setdefault(topic, []).append(bytes(data))
    return found


def test_a_bag_of_a_road_is_replayed_and_its_replay_again_bit_for_bit(tmp_path):
    config = tmp_path / "road.yaml"
    others = {name: value for name, value in ROAD.items() if not name.startswith("tire.")}
    lines = "\n".join(f"    {name}: {json.dumps(value)}" for name, value in others.items())
    tire = "\n".join(f"      {name}: {json.dumps(value)}" for name, value in TIRE.items())
    config.write_text(f"/**:\n  ros__parameters:\n{lines}\n    tire:\n{tire}\n")
    bag = bag_of_a_road(tmp_path / "in")
    first = replay(bag, tmp_path / "first", config=config, quiet=True)
    assert first.written["wheel/contact_load"] == first.written["wheel/axle_wrench"] > 450
    replay(tmp_path / "first", tmp_path / "second", quiet=True)
    assert outputs_of(tmp_path / "first") == outputs_of(tmp_path / "second")
    with pytest.raises(InputError, match="no topic wheel/load"):
        replay(bag, tmp_path / "third", quiet=True)


def test_a_report_of_a_road(tmp_path):
    """Its loads are the contact's, its critical speed that in contact, and it says whose force variation it shows."""
    pytest.importorskip("plotly")
    log = tmp_path / "log"
    config = tmp_path / "road.yaml"
    config.write_text(json.dumps({"/**": {"ros__parameters": {**ROAD, "n_max": 4}}}))
    replay(bag_of_a_road(tmp_path / "bag", 4.0), log, config=config, quiet=True)
    drive = gather(BagReader(log), BagReader(log), quiet=True)
    contact = [messages.WrenchDecoder().decode(data).fz for data in outputs_of(log)["/wheel/contact_load"]]
    numbers = drive.wheels[0].numbers["load_z"]
    assert (numbers.count, numbers.high) == (len(contact), max(contact))
    heights = next(each for each in drive.inputs if each.topic == "/wheel/road_height")
    assert heights.messages == 2000
    headline = report(log, tmp_path / "road.html", quiet=True)
    text = (tmp_path / "road.html").read_text(encoding="utf-8")
    assert headline.startswith("The rotating tire was stable at every speed driven")
    unit = TireWheelUnit.table_1(**TIRE)
    rpm = round(wheel.critical_speed(unit, contact=True, n_max=4) * 30.0 / math.pi)
    assert f"{rpm:,}".replace(",", "\u202f") in text
    assert "The tires stand on a road" in text and "on the road, in this car" in text
    for title in ("From road to axle, in contact", "Campbell diagram, in contact", "Stability, in contact"):
        assert f"<h2>{title}</h2>" in text
    assert "under a given load</h2>" not in text and "K, the steady share" not in text
    with pytest.raises(InputError, match="stand on a road; errors of parameters"):
        report(log, tmp_path / "errors.html", error=["zeta_1=0.01"], quiet=True)


@pytest.mark.parametrize("points", [1, 5])
def test_the_response_in_a_report_is_that_of_the_road_to_the_axle(tmp_path, points):
    """White heights: Welch's estimate of what was replayed lies on the closed form in contact, phase and all.

    Sampling folds the bands around multiples of the rate onto each other, each by sinc^2; of several points the closed
    form has the delays alone, which is right for waves that are longer than the patch: a few percent.
    """
    config = tmp_path / "road.yaml"
    changes = {"n_max": 8, "contact_points": points, "tire.zeta_s": 0.3, "tire.zeta_1": 0.1, "tire.zeta_n": 0.1}
    config.write_text(json.dumps({"/**": {"ros__parameters": {**ROAD, **changes}}}))
    with BagWriter(tmp_path / "bag") as writer:
        speeds = writer.add_topic("/wheel/wheel_speed", messages.FLOAT64)
        heights = writer.add_topic("/wheel/road_height", messages.FLOAT64)
        for k, height in enumerate(np.random.default_rng(3).normal(0.0, 2e-4, 10_000).tolist()):
            now = 10**9 + 2 * MS * k
            writer.write(speeds, now, now, number(60.0))
            writer.write(heights, now, now, number(height))
    replay(tmp_path / "bag", tmp_path / "log", config=config, quiet=True)
    drive = gather(BagReader(tmp_path / "log"), BagReader(tmp_path / "log"), quiet=True)
    seen = drive.wheels[0].spectra.transfer()
    band = (seen.frequency > 5.0) & (seen.frequency < (120.0 if points == 1 else 60.0))  # 60 Hz: four patches long
    assert (seen.coherence[band] > 0.9).mean() > 0.95
    expected = theory.road_to_force(drive.unit, 60.0, seen.frequency[band], n_max=8, points=points)
    error = np.abs(seen.response[band] - expected) / np.abs(expected)
    assert np.median(error) < 0.03, error
