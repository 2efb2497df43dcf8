"""The live node.

The file is long because it is one class, which rclpy's callbacks need whole: lifecycle, parameters, subscriptions,
timers and services share the pipeline and its clock. What it says, logs and works out beside stands in other modules.
"""

from __future__ import annotations

import gc
import json
import math
import re
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.experimental import EventsExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from ..cdr import messages
from ..estimator.vehicle import modes_on_the_road
from ..files.errors import InputError, first_line
from ..replay.input_watch import InputWatch
from ..replay.parameters import NODE_NAME, complete
from ..replay.pipeline import LOG_RECORD, TF_STATIC, TICK, Pipeline
from . import diagnostics, duties, node_parameters, typed
from .analyst import Analyst
from .announcer import Announcer
from .deadlines import Deadlines
from .deferred import Deferred, allow_deferred
from .installed import definitions_of, message_class
from .journal import DIAGNOSTICS, Journal
from .load_diagnostics import change_of, of_loads
from .markers import MarkerBuilder
from .qos_overrides import QosOverrides, as_recorded
from .scheduling import run_in_time
from .stop import Stop
from .uniformity_monitor import UniformityMonitor, variation_of
from .worker import Worker

__all__ = ["TireDynamicsNode", "run"]

_IDLE = 20_000_000  # [ns] between two looks at everything else while the node is not active
_UPDATE = 0.25  # [s] after which what has changed of inputs and logs is said on /rosout
_WAKE = 0.25  # [s] between two looks at the time where nothing comes in
_MOST_WAITING = 64  # inputs that are let in before a tick that is late
_NOT_ACTIVE = "the node is not active"
_BUSY = "too many requests are waiting; ask again"
_AT_ONCE = 8  # results of the worker that are taken up between two ticks: each takes some 50 us
_SWITCH = 1e-4  # [s] after which a thread that computes gives way to the one that ticks
_SLOWEST = 20.0  # [rad/s] at which the diagnostics look at a tire that varies: the work goes with the time of a turn


class _Second(NamedTuple):
    """Counters at a moment: the diagnostics speak of what has come since the last ones."""

    ticks: int = 0
    missed: int = 0
    samples: Sequence[Counter[str]] = ()


class TireDynamicsNode(LifecycleNode):
    """Wheel speeds and loads in; axle forces, belt shapes, stability and a log out.

    A managed node. With the parameter ``autostart`` it is active when it has been made; without, it waits for a
    lifecycle manager. Configured, it has checked its parameters and has its topics; active, it listens and
    publishes, each time from equilibrium and with a log of its own; deactivated, that log is closed and whole.

    The node only carries: what is computed, and from which messages, is :class:`Pipeline`'s, which the replay
    runs too. Every message that comes in is logged as it was received, and every tick before its outputs, all
    from the one thread that also computes; so the order in the log is the order of the computation.

    Parameters
    ----------
    context : rclpy.context.Context, optional
    arguments : sequence of str, optional
        ROS arguments (``--ros-args ...``) beyond those of the context.
    paced : bool
        Whether the caller calls :meth:`pace` when :meth:`until_tick` is over. Without it a timer makes the ticks, on
        whatever executor the node is given.

    Attributes
    ----------
    received : int
        Messages that came in while it was active.

    Raises
    ------
    InputError
        A parameter is unknown, out of its bounds or in contradiction to another; without ``autostart`` it is the
        transition to configured that fails, and says so in the ROS log and the diagnostics.
    """

    _pipeline: Pipeline
    _monitor: UniformityMonitor
    _watch: InputWatch
    _doubts: list[str]  # of the inputs, as they were said last
    _announcer: Announcer
    _wanted: dict[str, Any]  # all values that were accepted: in force, or soon to be

    def __init__(
        self,
        *,
        context: rclpy.context.Context | None = None,
        arguments: Sequence[str] | None = None,
        paced: bool = False,
    ) -> None:
        self._made_by_rclpy = self._configured = self._declaring = self._is_destroyed = False
        try:
            super().__init__(
                NODE_NAME,
                context=context,
                cli_args=list(arguments) if arguments is not None else None,
                automatically_declare_parameters_from_overrides=True,
            )
        except (ParameterException, ValueError) as error:
            raise InputError(first_line(error)) from None
        except RuntimeError as error:  # rcl's own: a middleware that cannot do what it is asked, as security
            raise InputError(first_line(error)) from None
        self._made_by_rclpy = True
        self._clock_now = self.get_clock()
        self._autostart = self._active = False
        self._made: list[tuple[Callable[[Any], Any], Any]] = []  # what goes when the node is cleaned up
        self._refusal: Exception | None = None  # why the last transition failed
        self._starting = True  # the caller is told what is wrong
        self._journal = Journal(self.get_logger(), self._now)
        self._worker, self._judge = Worker(), Worker()  # who waits for a judgement keeps nothing else waiting
        self._analyst = Analyst()
        self._unanswered: dict[Deferred, Any] = {}  # with the response of each
        self._switching: list[tuple[Callable[[], tuple[bool, str] | None], Deferred]] = []
        self._questions: set[tuple[int, float]] = set()  # of wheels that have diverged, not yet answered
        self._preparing = False
        self._namesakes = 0
        self._time: int | None = None
        self.received = 0
        self._ticks = self._missed = self._before_clock = 0
        self._before = self._second = _Second()
        self._step_times: list[float] = []
        self._stabilities: list[dict[str, Any]] = []
        self._next_wheel = 0
        self._period = 0
        self._deadlines = Deadlines(time.monotonic_ns(), _IDLE)
        self._duties = duties.Duties(time.monotonic_ns)
        self._paced = paced
        # Timers run on the steady clock: one on the ROS clock stalls when the system time is set back.
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._say(f"starting as {self.get_fully_qualified_name()}")
        try:
            self._qos = QosOverrides(self)
            self._diagnostics = self._qos.publisher(DiagnosticArray, DIAGNOSTICS, 10)
            self._add_duty(1.0, self._diagnose)
            self.add_on_set_parameters_callback(self._check_change)
            self.add_post_set_parameters_callback(self._apply_change)
            self._autostart = self._is_to_start()
            if self._autostart:
                self._change(self.trigger_configure)
                self._change(self.trigger_activate)
            else:
                self._declare(node_parameters.declare_free)
                self._say("unconfigured: autostart is false, so a lifecycle manager is to configure and activate it")
            self._starting = False
        except BaseException:
            self._active = False
            self.destroy_node()
            raise

    def _say(self, what: str) -> None:
        self.get_logger().info(what)

    def _is_to_start(self) -> bool:
        row = node_parameters.ROWS["autostart"]
        try:
            return bool(row.check(node_parameters.given(self).get(row.name, row.default)))
        except ValueError as error:
            raise InputError(str(error)) from None

    def _change(self, trigger: Callable[[], TransitionCallbackReturn]) -> None:
        """Change the state, or say why not."""
        if trigger() != TransitionCallbackReturn.SUCCESS:
            assert self._refusal is not None
            raise self._refusal

    def _add_duty(self, seconds: float, call: duties.Call) -> None:
        """Have something done every so often, by :meth:`pace` or a timer."""
        if self._paced:
            self._made.append((self._duties.remove, self._duties.add(seconds, call)))
        else:
            timer = self.create_timer(seconds, partial(duties.do_all, call), clock=self._steady)
            self._made.append((self.destroy_timer, timer))

    # -- the states of a managed node -----------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Check the parameters, and make topics and services."""
        return self._try(self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen and publish, from equilibrium; begin a log if there is to be one."""
        return self._try(self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop all outputs, and close the log."""
        return self._try(self._deactivate, lambda: self._say("inactive: no outputs until it is activated"))

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take topics and services away; every parameter may change again."""
        return self._try(self._clean_up, lambda: self._say("unconfigured: every parameter may change"))

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As deactivated and cleaned up, for good."""
        return self._try(self._deactivate, self._clean_up)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As deactivated and cleaned up, to be configured anew."""
        return self._try(self._deactivate, self._clean_up)

    def _try(self, *changes: Callable[[], None]) -> TransitionCallbackReturn:
        self._refusal = None
        try:
            for change in changes:
                change()
        except Exception as error:  # rclpy would not say it
            self._refusal = error
            if not self._starting:
                self.get_logger().error(first_line(error))
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        try:
            values = node_parameters.whole(self)
        except ValueError as error:
            raise InputError(str(error)) from None
        try:
            pipeline = Pipeline(values, definitions_of(values))
        except ValueError as error:  # of the field map, whose types are known only here
            raise InputError(str(error)) from None
        try:
            self._pipeline, self._wanted = pipeline, values
            self._period = self._pipeline.vehicle.settings.period
            self._declare(partial(node_parameters.declare, values=values, read_only=self._autostart))
            self._connect()
            self._configured = True
        except BaseException:
            self._clean_up()
            raise
        self._say(f"configured: {', '.join(values['wheels'])}; listens to {len(self._pipeline.inputs)} topics")

    def _activate(self) -> None:
        made = Pipeline(self._pipeline.values, self._pipeline.definitions)  # nothing of what was before
        self._journal.pipeline = self._pipeline = made
        self._wanted = self._pipeline.values
        self._pipeline.vehicle.wheels.judged_elsewhere = True  # no tick waits for it
        self._questions.clear()
        self._monitor = UniformityMonitor(self._pipeline.vehicle.wheels)
        self._analysing = False
        self._watch, self._doubts = InputWatch(self._pipeline.values), []
        if self._pipeline.motion is not None:
            self._pipeline.motion.analyse = self._analyse_motion
        self._missing: tuple[str, ...] | None = None
        self._time = None
        self._before = self._second = self._present_second()
        try:
            if self._pipeline.values["log.directory"]:
                self._journal.start().wait_until_open()
                self._journal.update()
        except InputError:
            self._journal.end()
            raise
        self._deadlines = Deadlines(time.monotonic_ns(), self._period)
        self._active = True
        wheels = len(self._pipeline.vehicle.settings.wheels)
        log = f"log in {self._journal.log.folder}" if self._journal.log is not None else "no log"
        rate = self._pipeline.values["rate_hz"]
        self._say(f"active: {wheels} wheel{'s' if wheels > 1 else ''}, {rate:g} Hz, {log}")
        self._announcer = Announcer(
            self.get_logger(), self._pipeline, self._journal.names, lambda: self._active and self._now() == 0
        )

    def _deactivate(self) -> None:
        was_active, self._active = self._active, False
        self._duties.drop()
        self._worker.forget()
        self._judge.forget()
        while self._unanswered:
            deferred, response = self._unanswered.popitem()
            response.success, response.message = False, _NOT_ACTIVE
            deferred.answer(response)
        self._switching.clear()
        self._preparing = False
        if was_active and self._not_in_force():  # what was accepted counts, and the log says so
            self._pipeline.set_values(self._wanted)
            self._journal.record()
        self._journal.close()

    def _clean_up(self) -> None:
        kept = 1  # the first duty is to say in which state the node is
        while len(self._made) > kept:
            destroy, entity = self._made.pop()
            destroy(entity)
        self._configured = False
        if not self._autostart:
            self._declare(node_parameters.declare_free)

    def _connect(self) -> None:
        names = {TICK: self._own_name("tick"), LOG_RECORD: self._own_name("log_record")}
        qos = {}
        for topic, msgtype in self._pipeline.inputs.items():
            if (name := self.resolve_topic_name(topic)) in names.values():
                raise InputError(f"{topic} of inputs.*.topic is {name}, an input already; write both in the same way")
            subscription = self._qos.subscription(
                message_class(msgtype), topic, self._receiver(topic), qos_profile_sensor_data, raw=True
            )
            self._made.append((self.destroy_subscription, subscription))
            names[topic], qos[topic] = subscription.topic_name, as_recorded(subscription.qos_profile)
        self._outputs = {}
        for topic, msgtype in self._pipeline.outputs.items():
            self._outputs[topic] = self._publisher(topic, message_class(msgtype), 10)
            names[topic], qos[topic] = self._outputs[topic].topic_name, as_recorded(self._outputs[topic].qos_profile)
        names[DIAGNOSTICS], qos[DIAGNOSTICS] = self._diagnostics.topic_name, as_recorded(self._diagnostics.qos_profile)
        names[TF_STATIC] = TF_STATIC
        self._journal.names, self._journal.qos = names, qos
        wheels = self._pipeline.vehicle.settings.wheels
        self._markers = [self._publisher(f"{wheel}/markers", MarkerArray, 1) for wheel in wheels]
        samples = self._pipeline.vehicle.settings.ring_samples
        lifetime = max(0.5, 2.5 / self._pipeline.values["ring_rate_hz"])
        self._marker_builders = [
            MarkerBuilder(frame, samples, number=index, lifetime=lifetime)
            for index, frame in enumerate(self._pipeline.values["frame_ids"])
        ]
        for index, wheel in enumerate(wheels):
            reply = self._stability_service(index, _put_as_json)
            allow_deferred(self._service(Trigger, f"{wheel}/floquet_stability", reply))
        self._connect_typed(wheels)
        allow_deferred(self._service(SetBool, "~/set_logging", self._set_logging))
        self._stabilities = [{} for _ in wheels]
        self._next_wheel = 0
        self._add_duty(1.0 / len(wheels), self._update_stability)
        self._add_duty(_UPDATE, self._update)
        if not self._paced:
            self._add_duty(self._period * 1e-9, self._tick)
        self._publish_transforms()
        self._qos.check()

    def _connect_typed(self, wheels: Sequence[str]) -> None:
        """The topic and the service of each wheel that need messages which may not be installed."""
        self._wheel_states = None
        try:
            if not typed.are_installed():
                return
        except RuntimeError as error:
            self.get_logger().warning(f"no topic <wheel>/{typed.TOPIC}, no service <wheel>/{typed.SERVICE}: {error}")
            return
        from tire_dynamics_msgs.srv import FloquetStability

        self._wheel_states = typed.WheelStates(wheels, self._pipeline.values["frame_ids"], self._publisher)
        for index, wheel in enumerate(wheels):
            reply = self._stability_service(index, _put_into_fields)
            allow_deferred(self._service(FloquetStability, f"{wheel}/{typed.SERVICE}", reply))

    def _publisher(self, topic: str, kind: Any, qos: Any) -> Any:
        publisher = self._qos.publisher(kind, topic, qos)
        self._made.append((self.destroy_publisher, publisher))
        return publisher

    def _service(self, kind: Any, name: str, reply: Any) -> Any:
        service = self.create_service(kind, name, reply)
        self._made.append((self.destroy_service, service))
        return service

    def _publish_transforms(self) -> None:
        """Say where the axles' frames are; whoever comes later hears it too."""
        transforms = self._pipeline.transforms(time.time_ns())
        if transforms is None:
            return
        if find_spec("tf2_msgs") is None:
            self.get_logger().warning("tf.parent_frame is not published but only logged: tf2_msgs is not installed")
            return
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = self._publisher(TF_STATIC, message_class(messages.TF), qos)
        self._journal.qos = {**self._journal.qos, TF_STATIC: as_recorded(publisher.qos_profile)}
        publisher.publish(transforms)

    # -- parameters -----------------------------------------------------------------------------------------

    def declare_parameters(
        self, namespace: str, parameters: Sequence[Any], ignore_override: bool = False
    ) -> list[RosParameter]:
        """As of every node; but what comes from files and the command line need not have a value or a type."""
        if ignore_override and not self._made_by_rclpy:
            parameters = [(name, value, ParameterDescriptor(dynamic_typing=True)) for name, value, *_ in parameters]
        return super().declare_parameters(namespace, parameters, ignore_override)

    def set_parameters_atomically(self, parameter_list: Sequence[RosParameter]) -> SetParametersResult:
        """As of every node; and what cannot be set may be set to what it is, as ``ros2 param load`` of a dump does."""
        changes = node_parameters.meant(parameter_list)
        if self._configured:
            changes = [each for each in changes if not node_parameters.is_in_force(self, self._wanted, each)]
        if not changes and parameter_list:
            return SetParametersResult(successful=True)
        return super().set_parameters_atomically(changes)

    def _declare(self, declare: Callable[[TireDynamicsNode], None]) -> None:
        self._declaring = True
        try:
            declare(self)
        finally:
            self._declaring = False

    def _check_change(self, changes: Sequence[RosParameter]) -> SetParametersResult:
        if self._declaring:
            return SetParametersResult(successful=True)
        values = node_parameters.changed(changes)
        try:
            if not self._configured:
                node_parameters.check(self, values)
                return SetParametersResult(successful=True)
            for name in values:
                if node_parameters.ROWS[name].read_only:
                    raise ValueError(f"{name} may change only while the node is unconfigured")
            complete({**self._wanted, **values})
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_change(self, changes: Sequence[RosParameter]) -> None:
        values = {} if self._declaring else node_parameters.changed(changes)
        if not values:
            return
        if not self._configured:  # what was given of another type has its own from now on
            self._declare(node_parameters.declare_free)
            return
        self._wanted = complete({**self._wanted, **values})
        waits = self._preparing or any(name.startswith("tire.") for name in self._not_in_force())
        if self._active and waits:
            self._prepare_change()
            return
        self._pipeline.set_values(self._wanted)
        if self._active:
            self._journal.record()

    def _prepare_change(self) -> None:
        """Have what the wanted values need computed beside the ticks; those that come meanwhile, behind it."""
        if not self._preparing:
            self._preparing = True
            wanted = self._wanted
            work = partial(self._pipeline.prepare, wanted)
            self._worker.ask("parameters", work, partial(self._put_in_force, wanted), urgent=True)

    def _put_in_force(self, wanted: dict[str, Any], result: None, error: Exception | None) -> None:
        """Between two ticks: in the log the record of it stands where the change came."""
        self._preparing = False
        if error is not None:
            self.get_logger().error(f"the parameters stay as they were: {first_line(error)}")
            self._wanted = self._pipeline.values
            return
        self._pipeline.set_values(wanted)
        self._journal.record()
        if self._wanted != wanted:
            self._prepare_change()

    # -- messages and ticks ---------------------------------------------------------------------------------

    def _own_name(self, name: str) -> str:
        return f"{self.get_fully_qualified_name()}/{name}"

    def _now(self) -> int:
        if not self._clock_now.ros_time_is_active:
            return time.time_ns()  # the same clock, in a tenth of the time
        now: int = self._clock_now.now().nanoseconds
        return now

    def _receiver(self, topic: str) -> Any:
        def callback(data: bytes) -> None:
            if not self._active:
                return
            self.received += 1
            now = self._now()
            if now == 0:  # simulated time before the first /clock
                self._before_clock += 1
                return
            self._journal.put(topic, now, now, data)
            self._pipeline.receive(topic, now, data)

        def joints(data: bytes) -> None:
            if self._active:
                self._announcer.joint_states = data
            callback(data)

        return joints if topic == "joint_states" else callback

    def until_tick(self) -> float:
        """Time until the next tick is due [s], on the steady clock; negative if it is late."""
        return (self._deadlines.due - time.monotonic_ns()) * 1e-9

    def pace(self) -> None:
        """Tick if a tick is due, and do the rarer duties that are."""
        steady = time.monotonic_ns()
        if not self._active:
            self._deadlines = Deadlines(steady + _IDLE, _IDLE)
        else:
            if self._time is None:  # the deadlines begin with the first tick, whatever the start of the process took
                self._deadlines = Deadlines(steady, self._period)
            if (tick := self._deadlines.take(steady)) is not None:
                now = self._now()
                if now and not self._clock_now.ros_time_is_active:
                    self._missed += tick.left_out
                    self._tick_at(now, self._after_last(now - (steady - tick.deadline), now))
                else:
                    self._tick()
        self._deliver_results()
        self._duties.do(self._deadlines.due)

    def _after_last(self, stamp: int, now: int) -> int | None:
        """A stamp that lies behind the last one; None if there is no room for it. A clock set back starts anew."""
        if self._time is not None and self._time >= stamp and now >= self._time:
            return None  # slewed by less than a period
        self._time = stamp
        return stamp

    def _tick(self) -> None:
        if self._active:
            now = self._now()
            self._tick_at(now, self._due(now))
        if not self._paced:
            self._deliver_results()

    def _deliver_results(self) -> None:
        self._worker.deliver(_AT_ONCE)
        self._judge.deliver(_AT_ONCE)
        if self._switching:
            self._answer_switches()

    def _tick_at(self, now: int, stamp: int | None) -> None:
        if stamp is None:
            return
        started = time.perf_counter()
        logged = self._journal.put(TICK, now, stamp, messages.encode_clock(stamp))
        produced = self._pipeline.tick(stamp)
        for topic, data in produced:
            self._outputs[topic].publish(data)
        belts = self._pipeline.belts()  # they take longer, and nobody waits for them
        for topic, data in belts:
            self._outputs[topic].publish(data)
        if belts:
            self._show(stamp, belts, dict(produced))
        produced += belts
        self._ticks += 1
        self._step_times.append(time.perf_counter() - started)
        if self._journal.log is not None and produced:
            published = self._now()
            for topic, data in produced:
                if logged:
                    self._journal.put(topic, published, stamp, data)
                else:  # a replay has no outputs for a tick that is not in the log
                    self._journal.drop(topic)

    def _show(self, stamp: int, belts: Sequence[tuple[str, bytes]], produced: Mapping[str, bytes]) -> None:
        """Markers and state of the wheels whose belts have come, where somebody looks at them."""
        scale, vehicle = self._pipeline.values["marker_force_scale"], self._pipeline.vehicle
        shapes = {topic: data for topic, data in belts if topic.endswith("/ring_shape")}
        for index, wheel in enumerate(vehicle.settings.wheels):
            data = shapes.get(f"{wheel}/ring_shape")
            if data is not None and self._markers[index].get_subscription_count():
                load, traction = vehicle.inputs[index].load
                forces = vehicle.wheels.force_of(index), (traction, load)
                points = messages.ring_points(data, vehicle.settings.ring_samples)
                markers = self._marker_builders[index].build(stamp, points, *forces, scale)
                self._markers[index].publish(markers)
            if data is not None and self._wheel_states is not None:
                self._wheel_states.publish(index, stamp, vehicle, self._stabilities[index], produced)

    def _due(self, now: int) -> int | None:
        """The time to advance to: the latest of the regular instants, one period apart, that has come.

        The instants are tied to the ROS clock when the node starts. The timer that calls runs on the steady
        clock, which the system's clock does not follow exactly: it is slewed by some parts in ten thousand, so
        that sooner or later a call comes before the next instant. The instants are then tied anew, an eighth of
        a period before the call, which keeps the stamps regular until that eighth is used up, and none of them
        ahead of the clock. A simulated clock has to have come to the next instant. Where a clock is set back,
        they start anew.
        """
        if now == 0:
            return None  # simulated time before the first /clock
        if self._time is None or now < self._time:
            self._time = now
            return self._time
        late = now - (self._time + self._period)
        if late >= 0:
            missed = late // self._period
            self._missed += missed
            self._time += (1 + missed) * self._period
        elif late > -self._period // 2 and not self._clock_now.ros_time_is_active:
            self._time = now - self._period // 8
        else:
            return None
        return self._time

    def _set_logging(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response | Deferred:
        if not self._active:
            response.success, response.message = False, _NOT_ACTIVE
            return response
        deferred = Deferred()
        self._switching.append((self._journal.switch(request.data), deferred))
        self._unanswered[deferred] = response
        return deferred

    def _answer_switches(self) -> None:
        waiting = []
        for outcome, deferred in self._switching:
            if (found := outcome()) is None:
                waiting.append((outcome, deferred))
            else:
                response = self._unanswered.pop(deferred)
                response.success, response.message = found
                deferred.answer(response)
        self._switching = waiting

    # -- stability and diagnostics --------------------------------------------------------------------------

    def _stability_service(self, index: int, put: Callable[[dict[str, Any], Any], None]) -> Any:
        def reply(request: Any, response: Any) -> Any:
            if not self._active:
                response.success, response.message = False, _NOT_ACTIVE
                return response
            vehicle, deferred = self._pipeline.vehicle, Deferred()
            name = vehicle.settings.wheels[index]

            def answer(found: dict[str, Any] | None, error: Exception | None) -> None:
                self._unanswered.pop(deferred, None)
                response.success = found is not None
                if found is None:
                    response.message = str(error)
                else:
                    put({**found, "wheel": name}, response)
                deferred.answer(response)

            if not self._ask_for_stability(vehicle.inputs[index].speed, answer):
                response.success, response.message = False, _BUSY
                return response
            self._unanswered[deferred] = response
            return deferred

        return reply

    def _ask_for_stability(self, speed: float, then: Callable[[Any, Exception | None], None]) -> bool:
        vehicle = self._pipeline.vehicle
        state: tuple[Any, ...] = vehicle.unit, speed, vehicle.settings.model
        if vehicle.wheels.on_road:  # to the rad/s: it takes some tens of milliseconds, and is remembered
            n_max = modes_on_the_road(vehicle.unit, vehicle.settings.n_max)
            state = vehicle.unit, float(round(speed)), vehicle.settings.model, n_max, True
        return self._judge.ask(state, partial(self._analyst.stability, *state), then)

    def _update_stability(self) -> None:
        if not self._active or self._analysing:
            return
        index = self._next_wheel
        self._next_wheel = (index + 1) % len(self._stabilities)
        vehicle, monitor = self._pipeline.vehicle, self._monitor
        speed = vehicle.inputs[index].speed
        if speed and not vehicle.unit.is_uniform:  # milliseconds, and more the slower it turns: remembered by the rad/s
            speed = math.copysign(max(float(round(abs(speed))), _SLOWEST), speed)

        def keep_stability(found: dict[str, Any] | None, error: Exception | None) -> None:
            self._stabilities[index] = {"verdict": f"unknown: {error}"} if found is None else found

        def keep_variation(found: Any, error: Exception | None) -> None:
            self._analysing = False
            monitor.keep(index, found)

        self._ask_for_stability(speed, keep_stability)
        work = partial(variation_of, monitor.taken(index))
        self._analysing = self._worker.ask(("variation", index), work, keep_variation)

    def _update(self) -> None:
        if self._active:
            self._journal.update()
            self._announcer.update()
            self._ask_for_restarts()

    def _ask_for_restarts(self) -> None:
        """Have the stability of wheels that have diverged found beside the ticks; in the log stands when it was."""
        wheels, unit = self._pipeline.vehicle.wheels, self._pipeline.vehicle.unit
        for question in wheels.questions():
            if question in self._questions:
                continue

            def answer(found: Any, error: Exception | None, question: tuple[int, float] = question) -> None:
                self._questions.discard(question)
                is_stable = found is not None and found["verdict"] != "unstable"
                if is_stable and self._pipeline.vehicle.wheels is wheels and self._pipeline.vehicle.unit == unit:
                    wheels.answer(*question)
                    self._journal.record()

            if self._ask_for_stability(question[1], answer):
                self._questions.add(question)

    def _present_second(self) -> _Second:
        return _Second(self._ticks, self._missed, [inputs.counts for inputs in self._pipeline.vehicle.inputs])

    def _diagnose(self) -> Iterator[None]:
        names = self.get_node_names_and_namespaces()
        self._namesakes = names.count((self.get_name(), self.get_namespace())) - 1
        array = DiagnosticArray()
        array.header.stamp = self.get_clock().now().to_msg()
        if self._active:
            self._before, self._second = self._second, self._present_second()
            self._check_inputs()
            yield
            array.status = [self._node_status()]
            for index in range(len(self._pipeline.vehicle.inputs)):
                yield
                array.status.append(self._wheel_status(index))
            if (loads := self._pipeline.loads) is not None:
                yield
                array.status.append(self._status("load estimate", of_loads(loads)))
                if change := change_of(self._missing, loads):
                    self.get_logger().warning(change)
                if loads.filter.running or self._missing is not None:
                    self._missing = loads.missing
            yield
        else:
            array.status = [self._idle_status()]
        data = bytes(serialize_message(array))
        self._diagnostics.publish(data)
        now = self._now()
        if now and self._active:
            self._journal.put(DIAGNOSTICS, now, now, data)

    def _check_inputs(self) -> None:
        """Say what has become odd about the inputs, once: numbers in it change from second to second."""
        known = {re.sub(r"-?\d[\d.e+-]*", "", doubt) for doubt in self._doubts}
        self._doubts = self._watch.update(self._pipeline.take_sums())
        if self._pipeline.motion is not None:
            self._doubts += self._pipeline.motion.doubts
        for doubt in self._doubts:
            if re.sub(r"-?\d[\d.e+-]*", "", doubt) not in known:
                self.get_logger().warning(f"doubtful: {doubt}")

    def _analyse_motion(self, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        def take(found: Any, error: Exception | None) -> None:
            if error is None:
                then(found)
            else:
                text = f"the wheels cannot be compared with the imu: {first_line(error)}"
                self.get_logger().error(text, throttle_duration_sec=60.0)

        self._worker.ask(work, work, take)  # each look counts once, however long one waits: no two share a key

    def _node_status(self) -> DiagnosticStatus:
        missed, ticks = self._second.missed - self._before.missed, self._second.ticks - self._before.ticks
        simulated = bool(self._clock_now.ros_time_is_active)
        slow = diagnostics.of_ticks(missed, ticks, self._pipeline.values["rate_hz"], simulated)
        self._announcer.warn_of_ticks(slow[1])
        name = self.get_fully_qualified_name()
        namesakes = f"{self._namesakes} other nodes are called {name}" if self._namesakes > 0 else ""
        warning = DiagnosticStatus.WARN
        doubtful = f"doubtful: {self._doubts[0]}" if self._doubts else ""
        troubles = [(warning, namesakes), (DiagnosticStatus.ERROR, self._announcer.no_clock), slow, (warning, doubtful)]
        times, self._step_times = self._step_times, []
        values = {
            "ticks": self._ticks,
            "ticks missed": self._missed,
            "clock set back": self._pipeline.vehicle.clock_resets,
            "messages before the clock": self._before_clock,
            "parameters not yet in force": ", ".join(self._not_in_force()) or "none",
            "analyses waiting": self._worker.waiting + self._judge.waiting,
            **diagnostics.step_times(times),
            **{f"{topic}: malformed": count for topic, count in self._pipeline.malformed.items()},
            **{f"joint_states: {outcome}": n for outcome, n in self._pipeline.message_counts.items()},
            **{f"{topic}: none of the wheels": count for topic, count in self._pipeline.empty.items()},
            **{f"doubtful {number}": doubt for number, doubt in enumerate(self._doubts, 1)},
        }
        wheels = len(self._pipeline.vehicle.inputs)
        return self._status("node", diagnostics.of_node(wheels, values, self._journal.account(), troubles))

    def _idle_status(self) -> DiagnosticStatus:
        _, state = self._state_machine.current_state
        return self._status("node", diagnostics.of_idle_node(state, self._refusal))

    def _wheel_status(self, index: int) -> DiagnosticStatus:
        vehicle, variation = self._pipeline.vehicle, self._monitor.values(index)
        samples = self._second.samples[index] - self._before.samples[index]
        hint, load_source = self._announcer.misfit, self._pipeline.values["load_source"]
        found = diagnostics.of_wheel(vehicle, index, self._stabilities[index], variation, samples, hint, load_source)
        return self._status(vehicle.settings.wheels[index], found)

    def _status(self, name: str, found: diagnostics.Finding) -> DiagnosticStatus:
        return diagnostics.message(self.get_fully_qualified_name(), name, found)

    def _not_in_force(self) -> list[str]:
        values = self._pipeline.values
        return [name for name, value in self._wanted.items() if value != values[name]]

    def destroy_node(self) -> None:
        """Finish the log, end all work and leave the graph; again, it does nothing."""
        if self._is_destroyed:
            return
        self._is_destroyed = True
        self._deactivate()
        self._end_work()
        super().destroy_node()
        # rclpy leaves out what holds the lifecycle services' handles: they, and the node with them, would be in the
        # graph, and take requests that nobody answers, for as long as this object is referred to.
        self._state_machine.destroy_when_not_in_use()

    def _end_work(self) -> None:
        self._worker.close()
        self._judge.close()
        self._analyst.close()


def run(stop: Stop) -> None:
    """The node, in the context that is there, until it is told to stop.

    Parameters
    ----------
    stop : Stop
        Whether to stop; asked several times a second.

    Raises
    ------
    InputError
        The parameters cannot be used.
    """
    stop.loaded()
    try:
        node = TireDynamicsNode(paced=True)
    except (ParameterException, NameValidationException, ValueError) as error:
        raise InputError(first_line(error)) from None
    sys.setswitchinterval(_SWITCH)
    run_in_time()
    try:
        executor = EventsExecutor()
        executor.add_node(node)
        gc.collect()
        gc.freeze()  # what lives until the end need not be looked at again, tick after tick
        threading.Thread(target=_wake, args=(executor,), name="wake", daemon=True).start()
        stop.runs()
        while not stop():  # docs/real_time.md says why so
            left = node.until_tick()
            if left <= 0.0:
                _let_in(executor, node)
            while left > 0.0:
                executor.spin_once(timeout_sec=left)
                left = node.until_tick()
            node.pace()
    finally:
        node.destroy_node()


def _put_as_json(found: dict[str, Any], response: Any) -> None:
    response.message = json.dumps(found)


def _put_into_fields(found: dict[str, Any], response: Any) -> None:
    response.wheel = found["wheel"]
    typed.fill_stability(response.stability, found)


def _let_in(executor: Any, node: TireDynamicsNode) -> None:
    """Take what waits, before a tick that is late: inputs may be of before its time. Of anything else one at a time."""
    for _ in range(_MOST_WAITING):
        before = node.received
        executor.spin_once(timeout_sec=0.0)
        if node.received == before:
            return


def _wake(executor: Any) -> None:
    """End the executor's wait now and then.

    Where it was built for an old C library, it waits for a moment of the system's time: when that is set back by an
    hour, and no message comes, it would wait for an hour.
    """
    while True:
        time.sleep(_WAKE)
        executor.create_task(int)
