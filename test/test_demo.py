"""``make run``: what it does when something goes wrong. That it works is seen by running it, as `.ci/run` does."""

from __future__ import annotations

import pytest

from tire_dynamics.replay.parameters import complete, read_config
from tire_dynamics.ros import demo


def test_a_node_that_dies_is_noticed_and_its_last_words_are_shown(ros_domain, capfd):
    with demo._Process("node", "--ros-args", "-p", "rate_hz:=-1.0") as node, demo._Listener(["wheel"]) as listener:
        with pytest.raises(demo._FailureError) as caught:
            listener.wait("the node to be active", listener.is_active, node)
    said = str(caught.value)
    assert said.startswith("node ended with status 2 while the demonstration waited for the node to be active.")
    assert said.endswith("tire-dynamics: rate_hz is -1.0; it must be at least 1")
    assert "   node: tire-dynamics: rate_hz is -1.0" in capfd.readouterr().out  # and was shown when it was said


@pytest.mark.parametrize("compiled", [True, False])
def test_it_waits_for_the_state_and_the_node_has_the_rates_that_are_asked_for(ros_domain, compiled):
    with demo._Process("node", "--ros-args", *demo.rates(compiled)) as node, demo._Listener(["wheel"]) as listener:
        listener.wait("the node to be active", listener.is_active, node)
        node.interrupt()
        listener.wait("its end", node.is_over)
        assert node.status == 0
    assert f"active: 1 wheel, {500 if compiled else 50} Hz, no log" in node.last_lines()


def test_the_lower_rates_are_lower_than_those_of_the_demonstration():
    file = read_config(demo._CONFIG)
    names = [argument.partition(":=") for argument in demo.rates(compiled=False) if argument != "-p"]
    for name, _, value in names:
        assert float(value) < complete(file)[name]
    assert demo.rates(compiled=True) == []
