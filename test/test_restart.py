"""A wheel that has diverged starts again where the tire is stable; who asks for that finds out beside the ticks."""

from __future__ import annotations

import json
import math

import pytest

from tire_dynamics import TireWheelUnit
from tire_dynamics.estimator.vehicle import Vehicle, VehicleSettings
from tire_dynamics.science import wheel

MILLISECOND = 1_000_000
# zeta_1 = 0.5 loses its stability near 457 rad/s (test_faults); a second harmonic of the sidewall makes it vary.
UNSTABLE, STABLE = 480.0, 50.0
VARYING = TireWheelUnit.table_1(zeta_1=0.5, radial_nonuniformity=[(2, 0.02, 0.0)])
ROAD = TireWheelUnit.table_1(zeta_1=0.5, sprung_mass=350.0, vertical_stiffness=2e5)


def diverged(unit: TireWheelUnit, elsewhere: bool) -> tuple[Vehicle, int]:
    """A vehicle whose wheel has grown beyond all bounds at a speed at which it is unstable, and the time."""
    vehicle = Vehicle(VehicleSettings(unit=unit, input_timeout=10**9, max_speed=1e5))
    vehicle.wheels.judged_elsewhere = elsewhere
    now = 0
    for step in range(1, 20_000):
        now = step * 10 * MILLISECOND
        vehicle.wheel_speed(0, now, UNSTABLE)
        vehicle.load(0, now, now, 4000.0 + 100.0 * math.sin(step), 0.0)
        vehicle.tick(now)
        if vehicle.inputs[0].divergences:
            return vehicle, now
    pytest.fail("it did not diverge")


def goes_on(vehicle: Vehicle, now: int, speed: float, ticks: int = 20) -> tuple[int, list]:
    outputs = []
    for _ in range(ticks):
        now += 10 * MILLISECOND
        vehicle.wheel_speed(0, now, speed)
        vehicle.load(0, now, now, 4000.0, 0.0)
        outputs += vehicle.tick(now)
    return now, outputs


def test_nothing_is_analysed_in_a_tick(monkeypatch):
    """Counted, not timed: whatever the tick would have to compute is remembered, and nothing new is."""
    vehicle, now = diverged(VARYING, elsewhere=True)
    before = wheel._is_unstable.cache_info()
    now, outputs = goes_on(vehicle, now, UNSTABLE)
    now, more = goes_on(vehicle, now, STABLE)
    assert wheel._is_unstable.cache_info() == before
    assert outputs == more == []
    assert vehicle.wheels.questions() == [(0, STABLE)]
    vehicle.wheels.answer(0, STABLE)
    now, outputs = goes_on(vehicle, now, STABLE)
    assert len(outputs) == 20 and vehicle.wheels.questions() == []


def test_an_answer_holds_for_its_speed_and_its_tire_alone():
    vehicle, now = diverged(VARYING, elsewhere=True)
    now, _ = goes_on(vehicle, now, STABLE, 2)
    now, _ = goes_on(vehicle, now, UNSTABLE, 2)
    vehicle.wheels.answer(0, STABLE)  # which comes when the speed is another one again
    now, outputs = goes_on(vehicle, now, UNSTABLE, 3)
    assert outputs == [] and vehicle.wheels.questions() == [(0, UNSTABLE)]
    now, outputs = goes_on(vehicle, now, STABLE, 3)
    assert outputs == [], "an answer of before the speed changed"
    vehicle.wheels.answer(0, STABLE)
    vehicle.set_unit(VARYING.replace(zeta_s=0.2))
    assert vehicle.wheels.questions() == []
    now, outputs = goes_on(vehicle, now, STABLE, 3)
    assert outputs == [] and vehicle.wheels.questions() == [(0, STABLE)]


@pytest.mark.parametrize("unit", [VARYING, TireWheelUnit.table_1(zeta_1=0.5)], ids=["varying", "uniform"])
def test_without_that_it_finds_out_itself(unit):
    """As a replay of inputs does, which waits for nobody; and of a uniform tire always, it takes no time."""
    for elsewhere in (False, unit.is_uniform):
        vehicle, now = diverged(unit, elsewhere)
        now, outputs = goes_on(vehicle, now, UNSTABLE)
        assert outputs == [] and vehicle.wheels.questions() == []
        now, outputs = goes_on(vehicle, now, STABLE)
        assert len(outputs) == 20


def test_a_snapshot_carries_the_answer():
    first, now = diverged(VARYING, elsewhere=True)
    now, _ = goes_on(first, now, STABLE, 2)
    first.wheels.answer(0, STABLE)
    second = Vehicle(first.settings)
    second.restore(json.loads(json.dumps(first.snapshot())))
    assert goes_on(first, now, STABLE)[1] == goes_on(second, now, STABLE)[1] != []
    old = first.snapshot()
    del old["judged"]  # of a log of before
    second.restore(old)
    assert not second.wheels.judged_elsewhere
    with pytest.raises(ValueError, match="stability of 2 wheels"):
        second.restore({**first.snapshot(), "judged": {"elsewhere": True, "stable_at": [None, None]}})


@pytest.mark.slow
def test_live_it_starts_again_and_the_log_replays(bench, tmp_path):
    from geometry_msgs.msg import WrenchStamped

    from tire_dynamics.bag import BagReader
    from tire_dynamics.replay.replay import replay

    one = bench(
        "-p", "tire.zeta_1:=0.5", "-p", "tire.radial_nonuniformity:=[2.0, 0.02, 0.0]", "-p", "input_timeout_s:=5.0",
        "-p", "max_speed_rad_s:=1000.0", "-p", f"log.directory:={tmp_path / 'logs'}",
    )  # fmt: skip
    inputs = one.node._pipeline.vehicle.inputs[0]
    forces = one.messages(WrenchStamped, "/wheel/axle_wrench")
    one.feed(speed=700.0, load=4000.0)  # far above its limit: a moment of it is enough
    one.until(lambda: forces, "forces")
    one.feed(speed=700.0, load=4100.0)
    one.until(lambda: inputs.divergences, "the divergence")
    one.feed(speed=STABLE, load=4000.0)
    count = len(forces)
    one.until(lambda: inputs.running and len(forces) > count + 100, "forces again")
    one.close()
    (log,) = (tmp_path / "logs").iterdir()
    replay(log, tmp_path / "again")
    topic = "/wheel/axle_wrench"
    live, again = ([(m[3], m[4]) for m in BagReader(bag).messages([topic])] for bag in (log, tmp_path / "again"))
    assert len(live) > 100 and live == again
