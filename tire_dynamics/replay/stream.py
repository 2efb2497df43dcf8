# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Serialised messages into the wheels, and serialised messages out of them: one call for each, or one for many.

The layouts are those of :mod:`.messages`, whose decoders and encoders this module asks for everything that is rare:
what is not little-endian, joint names that are new, and each encoder's message, of which only the numbers change.

The file is long because it is one compiled class: from a message's bytes through the wheels to an output's bytes there
is no call of Python, and the loops over many messages call what single messages call.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cdr import messages
from ..cdr.field_reader import ends
from ..estimator.belt import ring_angles
from ..estimator.vehicle import joint_places
from ..science.elementary import cos_sin

try:
    import cython
except ImportError:
    from ..science import cython_stand_in as cython
if cython.compiled:
    from cython.cimports.libc.string import memcpy
    from cython.cimports.tire_dynamics.cdr.field_reader import FieldReader, same_bytes
    from cython.cimports.tire_dynamics.estimator.wheels import Wheels
else:
    from ..cdr.field_reader import FieldReader, same_bytes
    from ..estimator.wheels import Wheels

from .input_map import QUANTITIES, MappedTopic

__all__ = ["IGNORED", "MESSAGE_HEAD", "TICKS", "MessageStream", "Sink"]

IntArray = NDArray[np.int64]

TICKS, IGNORED = -1, -2
"""In place of an input's number, of :meth:`MessageStream.run`: a tick; a message that is no input."""

Sink = Callable[[str, "int | None", int, int, "tuple[float, ...]"], object]
"""Takes a sample: quantity, wheel (None: values of all), stamp and time of receipt [ns], values."""

Estimator = Callable[[int], "tuple[list[float], list[float], list[float] | None] | None"]
"""Gives the loads of a tick [ns], their standard deviations, and the covariances of the axle forces."""

MESSAGE_HEAD = 31
"""Bytes before a message in an MCAP file: opcode, length, channel, sequence, log time, publish time."""

_TICK = cython.declare(cython.longlong, TICKS)
_HEAD = cython.declare(cython.Py_ssize_t, MESSAGE_HEAD)
_MESSAGE = cython.declare(cython.int, 5)  # the opcode
_SECOND = cython.declare(cython.longlong, 1_000_000_000)
_MAX_JOINT_STATE = cython.declare(cython.Py_ssize_t, 2**20)
_FIRST = cython.declare(cython.Py_ssize_t, 12)  # where a frame_id stands: encapsulation, stamp
_OUTCOMES = cython.declare(cython.Py_ssize_t, 12)  # places in Schedule.counts
_JOINT_TWICE = cython.declare(cython.Py_ssize_t, 10)
_NAN = cython.declare(cython.double, float("nan"))
_MOST_NOTED = cython.declare(cython.double, 1e12)  # beyond it is no measurement in any unit; squares can be summed
_NAMES = [name for name, _ in sorted(QUANTITIES.items(), key=lambda item: item[1].number)]
_SPEED = cython.declare(cython.Py_ssize_t, 0)  # numbers of quantities, as QUANTITIES has them
_ANGLE = cython.declare(cython.Py_ssize_t, 1)
_LOAD = cython.declare(cython.Py_ssize_t, 2)
_TRACTION = cython.declare(cython.Py_ssize_t, 3)
_ROAD_HEIGHT = cython.declare(cython.Py_ssize_t, 4)
_IMU = cython.declare(cython.Py_ssize_t, 7)
_VEHICLE_SPEED = cython.declare(cython.Py_ssize_t, 8)
_GROUP = cython.declare(cython.Py_ssize_t, 4)  # numbers that describe a group: quantity, first slot, count, wheel


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def get_uint(data: cython.const[cython.uchar][::1], at: cython.Py_ssize_t) -> cython.longlong:
    if cython.compiled:
        return (
            cython.cast(cython.longlong, data[at])
            | (cython.cast(cython.longlong, data[at + 1]) << 8)
            | (cython.cast(cython.longlong, data[at + 2]) << 16)
            | (cython.cast(cython.longlong, data[at + 3]) << 24)
        )
    else:
        return int(struct.unpack_from("<I", data, at)[0])


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def get_double(data: cython.const[cython.uchar][::1], at: cython.Py_ssize_t) -> cython.double:
    if cython.compiled:
        value: cython.double = 0.0
        memcpy(cython.address(value), cython.address(data[at]), 8)
        return value
    else:
        return float(struct.unpack_from("<d", data, at)[0])


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def put_integer(out: cython.uchar[::1], at: cython.Py_ssize_t, value: cython.longlong, size: cython.int) -> cython.void:
    k: cython.int
    for k in range(size):
        out[at + k] = (value >> (8 * k)) & 255


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def put_double(out: cython.uchar[::1], at: cython.Py_ssize_t, value: cython.double) -> cython.void:
    if cython.compiled:
        memcpy(cython.address(out[at]), cython.address(value), 8)
    else:
        struct.pack_into("<d", out, at, value)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def put_single(out: cython.uchar[::1], at: cython.Py_ssize_t, value: cython.double) -> cython.void:
    if cython.compiled:
        single: cython.float = cython.cast(cython.float, value)
        memcpy(cython.address(out[at]), cython.address(single), 4)
    else:
        out[at : at + 4] = np.float32(value).tobytes()


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def copy(
    out: cython.uchar[::1],
    at: cython.Py_ssize_t,
    data: cython.const[cython.uchar][::1],
    first: cython.Py_ssize_t,
    size: cython.Py_ssize_t,
) -> cython.void:
    if cython.compiled:
        if size > 0:
            memcpy(cython.address(out[at]), cython.address(data[first]), size)
    else:
        out[at : at + size] = data[first : first + size]


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def put_stamp(out: cython.uchar[::1], at: cython.Py_ssize_t, stamp: cython.longlong) -> cython.void:
    """A builtin_interfaces/Time: before the epoch its seconds are negative, its nanoseconds never."""
    seconds: cython.longlong = stamp // _SECOND
    if seconds * _SECOND > stamp:  # C rounds towards zero
        seconds -= 1
    put_integer(out, at, seconds, 4)
    put_integer(out, at + 4, stamp - seconds * _SECOND, 4)


@cython.cclass
class MessageStream:
    """The messages of a vehicle's wheels.

    Parameters
    ----------
    wheels : Wheels
    joints, frames : sequence of str
        Of each wheel: its joint in joint_states, the frame of its outputs.
    samples : int
        P, the angles of the belt.
    mapped : sequence of MappedTopic
        What comes by the field map; the numbers of these topics are behind those of the inputs.
    estimator : callable, optional
        Where loads are estimated: given the time of a tick [ns], it returns the load of each wheel and its standard
        deviation [N], and xx, xz and zz of each axle force's covariance [N^2] or None; or None if it has none.
    has_covariance : bool
        Whether the axle forces' covariances are outputs.

    Attributes
    ----------
    inputs : list of str
        What each input's number stands for: "joint_states", then "wheel_speed", "load" and "load_force" of each wheel;
        on the road "wheel_speed" and "road_height", with an estimator "wheel_speed" alone. Mapped topics are not in it.
    outputs : list of str
        Likewise: "axle_wrench", "ring_deflection" and "ring_shape" of each wheel; on the road "contact_load" too, with
        an estimator "load_estimate" and "load_standard_deviation", and "axle_wrench_covariance" if it is wanted.
    no_velocity : int
        JointStates whose velocities are not one per name, which were refused.
    """

    def __init__(
        self,
        wheels: Wheels,
        joints: Sequence[str],
        frames: Sequence[str],
        samples: int,
        mapped: Sequence[MappedTopic] = (),
        estimator: Estimator | None = None,
        has_covariance: bool = False,
    ) -> None:
        self.wheels, self.joints = wheels, tuple(joints)
        self.on_road = wheels.on_road
        self.estimator, self.estimates, self.has_covariance = estimator, estimator is not None, has_covariance
        kinds: tuple[str, ...] = ("wheel_speed", "load", "load_force")
        results: tuple[str, ...] = ("axle_wrench", "ring_deflection", "ring_shape")
        self.first_estimate = len(results)
        if self.on_road:
            kinds, results = ("wheel_speed", "road_height"), (*results, "contact_load")
        elif estimator is not None:
            kinds, results = ("wheel_speed",), (*results, "load_estimate", "load_standard_deviation")
            results = (*results, *("axle_wrench_covariance",) * has_covariance)
        self.has_estimate = False
        self.estimated, self.axle_variance = np.zeros(2 * wheels.count).data, np.zeros(3 * wheels.count).data
        self.number = _bytes(messages.encode_float64(0.0))
        self.covariance = _bytes(messages.CovarianceEncoder().encode(np.zeros((6, 6))))
        self.kinds, self.results = len(kinds), len(results)
        self.inputs = ["joint_states", *kinds * wheels.count]
        self.outputs = [*results * wheels.count]
        self.no_velocity = 0
        self._decoder, self._wrench_decoder = messages.JointStateDecoder(), messages.WrenchDecoder()
        self.fixed = len(self.inputs)
        self.malformed_counts = np.zeros(self.fixed + len(mapped), dtype=np.int64).data
        self._prepare(list(mapped))
        self.names, self.names_end, self.names_count, self.places = _bytes(b"\0"), 0, 0, 0
        self.place = np.zeros(3 * wheels.count, dtype=np.int64).data
        # each wheel's message, its numbers zero, one behind the other
        wrenches = [messages.WrenchEncoder(frame).encode(0, 0.0, 0.0) for frame in frames]
        shapes = [messages.RingShapeEncoder(frame, samples).encode(0, np.zeros((samples, 5))) for frame in frames]
        self.wrench, self.wrench_at = _bytes(b"".join(wrenches)), ends(map(len, wrenches))
        self.shape, self.shape_at = _bytes(b"".join(shapes)), ends(map(len, shapes))
        self.deflection = _bytes(messages.DeflectionEncoder(samples).encode(np.zeros((2, samples))))
        cosine, sine = cos_sin(ring_angles(samples))
        self.outward = np.stack([-cosine, sine], axis=1).reshape(-1).data  # x_ros = -X
        self.along = np.stack([sine, cosine], axis=1).reshape(-1).data
        self.radius, self.scale = 0.0, 1.0
        self.most = 2 * len(self.wrench) + len(self.shape) + wheels.count * (len(self.deflection) + 6 * _HEAD)
        self.most += wheels.count * (len(self.number) + len(self.covariance))
        self.out = memoryview(bytearray(2 * self.most))
        self.used = self.messages = 0
        self.begin, self.topic = (np.zeros(self.results * wheels.count, dtype=np.int64).data for _ in range(2))

    def _prepare(self, mapped: list[MappedTopic]) -> None:
        """What is needed of the field map, as numbers."""
        wheels = self.wheels.count
        self.mapped, self.fields = mapped, FieldReader([topic.plan for topic in mapped])
        self.empty_counts = np.zeros(max(len(mapped), 1), dtype=np.int64).data
        self.also = np.full(self.fixed, -1, dtype=np.int64).data
        slots = max((topic.plan.slots for topic in mapped), default=0) + 1
        wheel, partner = np.full(slots, -1), np.full(slots, -1)
        scale, shift = np.ones(slots), np.zeros(slots)
        groups = []
        for topic in mapped:
            place = {}
            for group in topic.values:
                quantity = QUANTITIES[group.quantity]
                row = quantity.number, group.first, len(group.scales), -1 if group.wheel is None else group.wheel
                groups.append(row)
                for k in range(len(group.scales)):
                    wheel[group.first + k] = k if quantity.size else group.wheels[k]
                    scale[group.first + k], shift[group.first + k] = group.scales[k], group.shifts[k]
                    place[group.quantity, int(wheel[group.first + k])] = group.first + k
            for (name, which), slot in place.items():  # an angle comes with its speed, a traction with its load
                for one, other in (("speed", "angle"), ("load", "traction")):
                    if name == one and (other, which) in place:
                        partner[slot], partner[place[other, which]] = place[other, which], slot
        self.groups = np.array(groups or [(0, 0, 0, 0)], dtype=np.int64).reshape(-1).data
        self.group_begin = np.cumsum([0, *(len(topic.values) for topic in mapped)]).astype(np.int64).data
        self.slot_wheel, self.partner = wheel.astype(np.int64).data, partner.astype(np.int64).data
        self.scale_of, self.shift_of = scale.data, shift.data
        self.last_speed, self.last_traction = np.full(wheels, np.nan).data, np.zeros(wheels).data
        self.width = max(wheels, 6)
        self.spare = np.zeros(self.width).data
        self.sums = np.zeros(4 * len(QUANTITIES) * self.width).data
        self.set_sink(None)

    def set_sink(self, sink: Sink | None) -> None:
        """Hand speed, travel, hub acceleration, imu and vehicle speed to something, as they come."""
        self.sink, self.offers = sink, sink is not None

    def share(self, number: int, mapped: int) -> None:
        """Take the messages of an input as those of a mapped topic too."""
        self.also[number] = mapped

    def take_sums(self) -> NDArray[np.float64]:
        """By quantity and wheel (or component): count, sum, sum of sizes and of squares since the last call."""
        sums = np.array(self.sums).reshape(len(QUANTITIES), self.width, 4)
        for k in range(self.sums.shape[0]):
            self.sums[k] = 0.0
        return sums

    def last_values(self) -> list[list[float | None]]:
        """Of each wheel the last speed and traction of mapped topics, None if there was none, as JSON has it."""
        speeds, tractions = list(self.last_speed), list(self.last_traction)
        return [[None if value != value else value for value in part] for part in (speeds, tractions)]

    def set_last_values(self, values: Sequence[Sequence[float | None]]) -> None:
        """Take over what :meth:`last_values` gave."""
        speeds, tractions = ([float("nan") if value is None else float(value) for value in part] for part in values)
        for k in range(self.wheels.count):
            self.last_speed[k], self.last_traction[k] = speeds[k], tractions[k]

    def set_shape(self, radius: float, scale: float) -> None:
        """The belt's radius [m], and by what the deflection in the points of ring_shape is multiplied."""
        self.radius, self.scale = radius, scale

    def malformed_of(self, number: int) -> int:
        """How many messages of an input were not what their type says; each was left out whole."""
        if not 0 <= number < len(self.malformed_counts):
            raise IndexError(f"number is {number}; it must be from 0 to {len(self.malformed_counts) - 1}")
        return int(self.malformed_counts[number])

    # -- in -------------------------------------------------------------------------------------------------

    def receive(self, number: int, received: int, data: bytes) -> None:
        """Take a serialised message of an input at its time of receipt [ns]."""
        if not 0 <= number < len(self.malformed_counts):
            raise IndexError(f"number is {number}; it must be from 0 to {len(self.malformed_counts) - 1}")
        self.take(number, received, data, 0, len(data))

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take(
        self,
        topic: cython.Py_ssize_t,
        received: cython.longlong,
        data: cython.const[cython.uchar][::1],
        first: cython.Py_ssize_t,
        size: cython.Py_ssize_t,
    ) -> cython.bint:
        """Take a message; whether it was one."""
        valid: cython.int
        kind: cython.Py_ssize_t = (topic - 1) % self.kinds
        if topic >= self.fixed:
            valid = self.take_mapped(topic - self.fixed, received, data, first, size)
        elif topic == 0:
            valid = self.take_joints(received, data, first, size)
        elif kind == 1 and not self.on_road:
            valid = self.take_wrench((topic - 1) // self.kinds, received, data, first, size)
        else:
            valid = self.take_float((topic - 1) // self.kinds, kind > 0, received, data, first, size)
        if valid < 0:  # not the usual layout
            with cython.gil:
                valid = self._take_slowly(topic, received, bytes(data[first : first + size]))
        if not valid:
            self.malformed_counts[topic] += 1
        if topic < self.fixed and self.also[topic] >= 0:
            self.take(self.fixed + self.also[topic], received, data, first, size)
        return valid > 0

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take_mapped(
        self,
        number: cython.Py_ssize_t,
        received: cython.longlong,
        data: cython.const[cython.uchar][::1],
        first: cython.Py_ssize_t,
        size: cython.Py_ssize_t,
    ) -> cython.bint:
        """A message of a mapped topic."""
        group: cython.Py_ssize_t
        stamp: cython.longlong = received
        if not self.fields.take(number, data, first, size):
            return False
        if self.fields.has_stamp:
            stamp = self.fields.stamp
        if self.fields.read_count == 0:  # names of none of the wheels
            self.empty_counts[number] += 1
        for group in range(self.group_begin[number], self.group_begin[number + 1]):
            self.take_group(group, received, stamp, self.groups[_GROUP * group + 1], self.groups[_GROUP * group + 2])
        return True

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take_group(
        self,
        group: cython.Py_ssize_t,
        received: cython.longlong,
        stamp: cython.longlong,
        first: cython.Py_ssize_t,
        count: cython.Py_ssize_t,
    ) -> cython.void:
        """The values of one quantity in the message that was read last."""
        slot: cython.Py_ssize_t
        other: cython.Py_ssize_t
        w: cython.Py_ssize_t
        quantity: cython.Py_ssize_t = self.groups[_GROUP * group]
        value: cython.double
        more: cython.double
        for w in range(self.width):
            self.spare[w] = _NAN
        for slot in range(first, first + count):
            if not self.fields.found[slot]:
                continue
            w, other = self.slot_wheel[slot], self.partner[slot]
            value = self.fields.values[slot] * self.scale_of[slot] + self.shift_of[slot]
            self.spare[w] = value
            self.note(quantity, w, value)
            more = _NAN
            if other >= 0 and self.fields.found[other]:
                more = self.fields.values[other] * self.scale_of[other] + self.shift_of[other]
            if quantity == _SPEED:
                self.last_speed[w] = value
                self.wheels.take_speed(w, received, stamp, value, more)
            elif quantity == _ANGLE and other < 0 and self.last_speed[w] == self.last_speed[w]:
                self.wheels.take_speed(w, received, stamp, self.last_speed[w], value)
            elif quantity == _LOAD and not self.on_road:
                self.wheels.take_load(w, received, stamp, value, more if other >= 0 else self.last_traction[w])
            elif quantity == _TRACTION and value == value:
                self.last_traction[w] = value
            elif quantity == _ROAD_HEIGHT and self.on_road:
                self.wheels.take_height(w, received, stamp, value)
        if self.offers and (quantity == _SPEED or quantity > _ROAD_HEIGHT):
            self.offer(quantity, self.groups[_GROUP * group + 3], received, stamp)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def note(self, quantity: cython.Py_ssize_t, place: cython.Py_ssize_t, value: cython.double) -> cython.void:
        """Add a value to what is known of its quantity."""
        at: cython.Py_ssize_t = 4 * (quantity * self.width + place)
        if not abs(value) <= _MOST_NOTED:  # or is no number
            return
        self.sums[at] += 1.0
        self.sums[at + 1] += value
        self.sums[at + 2] += abs(value)
        self.sums[at + 3] += value * value

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def offer(
        self,
        quantity: cython.Py_ssize_t,
        wheel: cython.Py_ssize_t,
        received: cython.longlong,
        stamp: cython.longlong,
    ) -> cython.void:
        """Hand what is in ``spare`` to the sink."""
        with cython.gil:
            self._hand_over(quantity, wheel, received, stamp)

    def _hand_over(self, quantity: int, wheel: int, received: int, stamp: int) -> None:
        size = 6 if quantity == 7 else 1 if quantity == 8 else self.wheels.count
        values = tuple([self.spare[k] for k in range(size)])
        assert self.sink is not None
        self.sink(_NAMES[quantity], None if wheel < 0 else wheel, stamp or received, received, values)

    def _take_slowly(self, topic: int, received: int, data: bytes) -> bool:
        """A message of any layout, by the decoders of :mod:`.messages`."""
        wheel, kind = divmod(topic - 1, self.kinds)
        try:
            if topic == 0:
                state = self._decoder.decode(data)
                if len(state.velocities) != len(state.names):
                    self.no_velocity += 1
                    return True
                has_angles = len(state.positions) == len(state.names)
                for index, place, is_twice in joint_places(self.joints, state.names):
                    if is_twice:
                        self.wheels.count_joint_twice(index)
                    angle = state.positions[place] if has_angles else _NAN
                    self.wheels.add_speed(index, received, state.stamp_ns, state.velocities[place], angle)
            elif kind and self.on_road:
                self.wheels.add_height(wheel, received, received, messages.decode_float64(data))
            elif kind == 1:
                wrench = self._wrench_decoder.decode(data)
                self.wheels.add_load(wheel, received, wrench.stamp_ns, wrench.fz, wrench.fx)
            elif kind == 2:
                self.wheels.add_load(wheel, received, received, messages.decode_float64(data), 0.0)
            else:
                self.wheels.add_speed(wheel, received, received, messages.decode_float64(data))
        except messages.MessageError:
            return False
        return True

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take_float(
        self,
        wheel: cython.Py_ssize_t,
        is_load: cython.bint,
        received: cython.longlong,
        data: cython.const[cython.uchar][::1],
        first: cython.Py_ssize_t,
        size: cython.Py_ssize_t,
    ) -> cython.bint:
        """A std_msgs/Float64."""
        value: cython.double
        if size < 12 or data[first] != 0 or data[first + 1] > 1:
            return False
        if data[first + 1] == 1:
            value = get_double(data, first + 4)
        else:
            value = _swapped(data, first + 4)
        if is_load and self.on_road:
            self.note(_ROAD_HEIGHT, wheel, value)
            self.wheels.take_height(wheel, received, received, value)
        elif is_load:
            self.note(_LOAD, wheel, value)
            self.wheels.take_load(wheel, received, received, value, 0.0)
        else:
            self.note(_SPEED, wheel, value)
            self.wheels.take_speed(wheel, received, received, value, _NAN)
            if self.offers:
                self.offer_one(wheel, received, value)
        return True

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def offer_one(self, wheel: cython.Py_ssize_t, received: cython.longlong, value: cython.double) -> cython.void:
        """Hand the speed of one wheel to the sink."""
        w: cython.Py_ssize_t
        for w in range(self.width):
            self.spare[w] = _NAN
        self.spare[wheel] = value
        self.offer(_SPEED, wheel, received, received)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take_wrench(
        self,
        wheel: cython.Py_ssize_t,
        received: cython.longlong,
        data: cython.const[cython.uchar][::1],
        first: cython.Py_ssize_t,
        size: cython.Py_ssize_t,
    ) -> cython.int:
        """A geometry_msgs/WrenchStamped in little-endian with a frame_id in ASCII; -1 for others."""
        k: cython.Py_ssize_t
        length: cython.longlong
        at: cython.Py_ssize_t
        stamp: cython.longlong
        if size < _FIRST + 4 or data[first] != 0 or data[first + 1] != 1:
            return -1
        length = get_uint(data, first + _FIRST)
        if length > size - 16:
            return 0
        for k in range(length):
            if data[first + 16 + k] > 127:
                return -1
        if length > 0 and data[first + 16 + length - 1] != 0:
            return 0
        at = 16 + length
        at += (4 - at) & 7  # the body, from byte 4 on, is aligned
        stamp = get_uint(data, first + 8)
        if at + 48 > size or stamp >= _SECOND:
            return 0
        stamp += _signed(get_uint(data, first + 4)) * _SECOND
        self.note(_LOAD, wheel, get_double(data, first + at + 16))
        self.wheels.take_load(wheel, received, stamp, get_double(data, first + at + 16), get_double(data, first + at))
        return 1

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def take_joints(
        self,
        received: cython.longlong,
        data: cython.const[cython.uchar][::1],
        first: cython.Py_ssize_t,
        size: cython.Py_ssize_t,
    ) -> cython.int:
        """A sensor_msgs/JointState in little-endian; -1 for others.

        A publisher sends the same frame_id and names every time: their bytes are kept, and parsed when they differ.
        """
        k: cython.Py_ssize_t
        at: cython.Py_ssize_t
        angles: cython.Py_ssize_t
        count: cython.longlong
        known: cython.longlong
        stamp: cython.longlong
        angle: cython.double
        speed: cython.double
        if size < _FIRST or size > _MAX_JOINT_STATE or data[first] != 0 or data[first + 1] != 1:
            return -1
        if size < self.names_end or not same_bytes(data, first + _FIRST, self.names, 0, self.names_end - _FIRST):
            with cython.gil:
                if not self._learn_names(bytes(data[first : first + size])):
                    return 0
        at = self.names_end
        at += (4 - at) & 3
        if at + 4 > size:
            return 0
        known = get_uint(data, first + at)  # of positions
        at += 4
        if 8 * known > size - at:
            return 0
        if known:
            at += (4 - at) & 7
        angles = at
        at += 8 * known
        if at > size:
            return 0
        at += (4 - at) & 3
        if at + 4 > size:
            return 0
        count = get_uint(data, first + at)
        at += 4
        if 8 * count > size - at:
            return 0
        if count:
            at += (4 - at) & 7
        k = at + 8 * count
        if k > size:
            return 0
        k += (4 - k) & 3
        if k + 4 > size or 8 * get_uint(data, first + k) > size - k - 4:  # efforts
            return 0
        stamp = get_uint(data, first + 8)
        if stamp >= _SECOND:
            return 0
        stamp += _signed(get_uint(data, first + 4)) * _SECOND
        if count != self.names_count:
            self.no_velocity += 1
            return 1
        if self.offers:
            for k in range(self.width):
                self.spare[k] = _NAN
        for k in range(self.places):
            if self.place[3 * k + 2]:
                self.wheels.schedule.counts[self.place[3 * k] * _OUTCOMES + _JOINT_TWICE] += 1
            angle = _NAN
            if known == count:
                angle = get_double(data, first + angles + 8 * self.place[3 * k + 1])
            speed = get_double(data, first + at + 8 * self.place[3 * k + 1])
            self.spare[self.place[3 * k]] = speed
            self.note(_SPEED, self.place[3 * k], speed)
            self.wheels.take_speed(self.place[3 * k], received, stamp, speed, angle)
        if self.offers and self.places:
            self.offer(_SPEED, -1, received, stamp)
        return 1

    def _learn_names(self, data: bytes) -> bool:
        """The names of a JointState and where the wheels' joints are among them; whether they can be read."""
        try:
            names, end = messages.joint_names(data)
        except messages.MessageError:
            return False
        self.names, self.names_end, self.names_count = _bytes(data[12:end] or b"\0"), end, len(names)
        places = joint_places(self.joints, names)
        self.places = len(places)
        for k, row in enumerate(places):
            for column, value in enumerate(row):
                self.place[3 * k + column] = int(value)
        return True

    # -- out ------------------------------------------------------------------------------------------------

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def put_forces(self, stamp: cython.longlong, head: cython.Py_ssize_t) -> cython.void:
        """The axle_wrench of each wheel in motion behind what is in ``out``, with room for a head before each.

        On the road each wheel's contact_load comes behind it; before them the loads that were estimated.
        """
        w: cython.Py_ssize_t
        for w in range(self.wheels.count):
            if self.has_estimate:
                self.put_estimate(w, stamp, head)
            if not self.wheels.schedule.running[w]:
                continue
            self.put_wrench(w, self.results * w, stamp, head, self.wheels.force[2 * w], self.wheels.force[2 * w + 1])
            if self.on_road:
                self.put_wrench(w, self.results * w + 3, stamp, head, 0.0, self.wheels.road.contact[w])

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def estimate(self, stamp: cython.longlong) -> cython.void:
        """Ask for the loads of a tick, before it: they hold from then on."""
        with cython.gil:
            self._ask(stamp)

    def _ask(self, stamp: int) -> None:
        assert self.estimator is not None
        found = self.estimator(stamp)
        self.has_estimate = found is not None
        if found is None:
            return
        loads, deviations, variances = found
        for w in range(self.wheels.count):
            self.estimated[2 * w], self.estimated[2 * w + 1] = loads[w], deviations[w]
            self.wheels.add_load(w, stamp, stamp, loads[w], self.last_traction[w])
        known: Any = [_NAN] * (3 * self.wheels.count) if variances is None else variances
        for k in range(3 * self.wheels.count):
            self.axle_variance[k] = known[k]

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def put_estimate(self, wheel: cython.Py_ssize_t, stamp: cython.longlong, head: cython.Py_ssize_t) -> cython.void:
        """The load of a wheel as it was estimated, its standard deviation, and what that makes of the axle's force."""
        at: cython.Py_ssize_t
        topic: cython.Py_ssize_t = self.results * wheel + self.first_estimate
        self.put_wrench(wheel, topic, stamp, head, 0.0, self.estimated[2 * wheel])
        if not self.wheels.due[wheel]:  # those of the error change slowly: they come with the belts
            return
        put_double(self.number, 4, self.estimated[2 * wheel + 1])
        self.put_bytes(self.number, topic + 1, head)
        if self.has_covariance and self.wheels.schedule.running[wheel]:
            if self.axle_variance[3 * wheel] == self.axle_variance[3 * wheel]:
                at = self.covariance.shape[0] - 8 * 36  # force x and force z are the first and the third of six
                put_double(self.covariance, at, self.axle_variance[3 * wheel])
                put_double(self.covariance, at + 16, self.axle_variance[3 * wheel + 1])
                put_double(self.covariance, at + 96, self.axle_variance[3 * wheel + 1])
                put_double(self.covariance, at + 112, self.axle_variance[3 * wheel + 2])
                self.put_bytes(self.covariance, topic + 2, head)

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def put_bytes(self, data: cython.uchar[::1], topic: cython.Py_ssize_t, head: cython.Py_ssize_t) -> cython.void:
        size: cython.Py_ssize_t = data.shape[0]
        at: cython.Py_ssize_t = self.used + head
        copy(self.out, at, data, 0, size)
        self.begin[self.messages] = at
        self.topic[self.messages] = topic
        self.messages += 1
        self.used = at + size

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def put_wrench(
        self,
        wheel: cython.Py_ssize_t,
        topic: cython.Py_ssize_t,
        stamp: cython.longlong,
        head: cython.Py_ssize_t,
        x: cython.double,
        z: cython.double,
    ) -> cython.void:
        first: cython.Py_ssize_t = self.wrench_at[wheel]
        size: cython.Py_ssize_t = self.wrench_at[wheel + 1] - first
        at: cython.Py_ssize_t = self.used + head
        copy(self.out, at, self.wrench, first, size)
        put_stamp(self.out, at + 4, stamp)
        put_double(self.out, at + size - 48, x)
        put_double(self.out, at + size - 32, z)
        self.begin[self.messages] = at
        self.topic[self.messages] = topic
        self.messages += 1
        self.used = at + size

    @cython.cfunc
    @cython.nogil
    @cython.exceptval(check=False)
    def put_belts(self, stamp: cython.longlong, head: cython.Py_ssize_t) -> cython.void:
        """The ring_deflection and the ring_shape of each wheel whose belt is due, likewise."""
        w: cython.Py_ssize_t
        i: cython.Py_ssize_t
        at: cython.Py_ssize_t
        size: cython.Py_ssize_t
        P: cython.Py_ssize_t = self.wheels.belt.points
        radial: cython.double
        tangential: cython.double
        for w in range(self.wheels.count):
            if not self.wheels.is_due(w):
                continue
            self.wheels.deflect(w)
            size = self.deflection.shape[0]
            at = self.used + head
            copy(self.out, at, self.deflection, 0, size)
            for i in range(2 * P):
                put_double(self.out, at + size - 16 * P + 8 * i, self.wheels.belt.shape[i])
            self.begin[self.messages] = at
            self.topic[self.messages] = self.results * w + 1
            self.messages += 1
            self.used = at + size
            size = self.shape_at[w + 1] - self.shape_at[w]
            at = self.used + head
            copy(self.out, at, self.shape, self.shape_at[w], size)
            put_stamp(self.out, at + 4, stamp)
            self.begin[self.messages] = at
            self.topic[self.messages] = self.results * w + 2
            self.messages += 1
            self.used = at + size
            at = at + size - 1 - 20 * P
            for i in range(P):
                radial, tangential = self.wheels.belt.shape[i], self.wheels.belt.shape[P + i]
                put_single(
                    self.out, at,
                    (self.radius + self.scale * radial) * self.outward[2 * i]
                    + (self.scale * tangential) * self.along[2 * i],
                )  # fmt: skip
                put_single(
                    self.out, at + 8,
                    (self.radius + self.scale * radial) * self.outward[2 * i + 1]
                    + (self.scale * tangential) * self.along[2 * i + 1],
                )  # fmt: skip
                put_single(self.out, at + 12, radial)
                put_single(self.out, at + 16, tangential)
                at += 20

    def tick(self, stamp: int) -> list[tuple[int, bytes]]:
        """Advance to a time [ns]; the forces of that moment, as numbers of outputs and serialised messages.

        Raises
        ------
        MessageError
            The time is outside ROS time.
        """
        messages.check_time(stamp)
        if self.estimates:
            self.estimate(stamp)
        self.wheels.go_to(stamp)
        self.used = self.messages = 0
        self.put_forces(stamp, 0)
        return self._taken()

    def belts(self) -> list[tuple[int, bytes]]:
        """The belts' messages if they are due at the last tick: later than the forces, which are waited for."""
        self.used = self.messages = 0
        self.put_belts(self.wheels.now, 0)
        return self._taken()

    def _taken(self) -> list[tuple[int, bytes]]:
        if not self.messages:
            return []
        ends = [*(self.begin[k] for k in range(1, self.messages)), self.used]
        return [(self.topic[k], bytes(self.out[self.begin[k] : end])) for k, end in enumerate(ends)]

    def _widen(self, wanted: int) -> None:
        grown = bytearray(2 * len(self.out) + wanted)
        grown[: self.used] = self.out[: self.used]
        self.out = memoryview(grown)

    def run(
        self,
        number: IntArray,
        received: IntArray,
        tick: IntArray,
        data: bytes,
        start: IntArray,
        size: IntArray,
        channel: IntArray,
        published: IntArray,
        channels: IntArray,
    ) -> tuple[memoryview, IntArray, IntArray]:
        """What :meth:`receive`, and :meth:`tick` with :meth:`belts`, do, for many events, as records of an MCAP file.

        Parameters
        ----------
        number : ndarray of int, shape (N,)
            Of the input that each event is a message of, ``TICKS`` or ``IGNORED``.
        received, tick : ndarray of int, shape (N,)
            Time of receipt, and the time to advance to [ns].
        data : bytes
        start, size : ndarray of int, shape (N,)
            Where in it the message is; a tick has one too.
        channel, published : ndarray of int, shape (N,)
            Channel and publish time of the event's own record; the log time is that of the receipt. Below 0: none.
        channels : ndarray of int, shape (R W,)
            Channels of the outputs, R of each wheel.

        Returns
        -------
        records : memoryview
            Each event's message, the outputs of each tick behind it. Good until the next call.
        starts, counts : ndarray of int, shapes (M,) and (R W,)
            Where the records are; how many there are of each output.
        """
        for stamp in (tick.min(initial=0), tick.max(initial=0)):
            messages.check_time(int(stamp))
        wanted = int(size.sum()) + MESSAGE_HEAD * len(number) + self.most
        self.used = 0
        if len(self.out) < wanted:
            self._widen(wanted)
        ticks = int((number == TICKS).sum())
        starts = np.empty(len(number) + ticks * self.results * self.wheels.count, dtype=np.int64)
        counts = np.zeros(self.results * self.wheels.count, dtype=np.int64)
        used = self._run(
            len(number), number.data, received.data, tick.data, memoryview(data),
            start.data, size.data, channel.data, published.data, channels.data,
            starts.data, counts.data,
        )  # fmt: skip
        return memoryview(self.out)[: self.used], starts[:used], counts

    def _run(
        self,
        events: cython.Py_ssize_t,
        number: cython.const[cython.longlong][::1],
        received: cython.const[cython.longlong][::1],
        tick: cython.const[cython.longlong][::1],
        data: cython.const[cython.uchar][::1],
        start: cython.const[cython.longlong][::1],
        size: cython.const[cython.longlong][::1],
        channel: cython.const[cython.longlong][::1],
        published: cython.const[cython.longlong][::1],
        channels: cython.const[cython.longlong][::1],
        starts: cython.longlong[::1],
        counts: cython.longlong[::1],
    ) -> int:
        event: cython.Py_ssize_t
        k: cython.Py_ssize_t
        at: cython.Py_ssize_t
        end: cython.Py_ssize_t
        found: cython.Py_ssize_t = 0
        left: cython.Py_ssize_t = 0
        for event in range(events):
            left += size[event] + _HEAD
        with cython.nogil:
            for event in range(events):
                if channel[event] >= 0:
                    starts[found] = self.used
                    found += 1
                    _head(self.out, self.used, size[event], channel[event], received[event], published[event])
                    copy(self.out, self.used + _HEAD, data, start[event], size[event])
                    self.used += _HEAD + size[event]
                left -= size[event] + _HEAD
                if number[event] == _TICK:
                    if self.out.shape[0] - self.used - left < self.most:
                        with cython.gil:
                            self._widen(left + self.most)
                    if self.estimates:
                        self.estimate(tick[event])
                    self.wheels.go_to(tick[event])
                    self.messages = 0
                    self.put_forces(tick[event], _HEAD)
                    self.put_belts(tick[event], _HEAD)
                    for k in range(self.messages):
                        at = self.begin[k]
                        end = self.begin[k + 1] - _HEAD if k + 1 < self.messages else self.used
                        starts[found] = at - _HEAD
                        found += 1
                        counts[self.topic[k]] += 1
                        _head(
                            self.out, at - _HEAD, end - at, channels[self.topic[k]], received[event], published[event]
                        )
                elif number[event] >= 0:
                    self.take(number[event], received[event], data, start[event], size[event])
        return found


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _head(
    out: cython.uchar[::1],
    at: cython.Py_ssize_t,
    size: cython.longlong,
    channel: cython.longlong,
    log_time: cython.longlong,
    publish_time: cython.longlong,
) -> cython.void:
    """The beginning of a message record of an MCAP file."""
    out[at] = _MESSAGE
    put_integer(out, at + 1, size + 22, 8)
    put_integer(out, at + 9, channel, 2)
    put_integer(out, at + 11, 0, 4)  # the sequence
    put_integer(out, at + 15, log_time, 8)
    put_integer(out, at + 23, publish_time, 8)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _signed(value: cython.longlong) -> cython.longlong:
    """A uint32 as an int32."""
    return value - ((value >> 31) << 32)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _swapped(data: cython.const[cython.uchar][::1], at: cython.Py_ssize_t) -> cython.double:
    """A big-endian double."""
    if cython.compiled:
        turned: cython.longlong = 0
        k: cython.int
        for k in range(8):
            turned = (turned << 8) | data[at + k]
        value: cython.double = 0.0
        memcpy(cython.address(value), cython.address(turned), 8)
        return value
    else:
        return float(struct.unpack_from(">d", data, at)[0])


def _bytes(data: bytes) -> memoryview:
    return memoryview(bytearray(data))
