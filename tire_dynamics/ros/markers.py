"""A wheel as RViz and Foxglove draw it: visualization_msgs/MarkerArray as CDR bytes, with no ROS."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import ArrayLike

from ..cdr.primitives import BODY, LITTLE_ENDIAN, encoded_string, sec_nanosec

__all__ = ["MARKER_ARRAY", "MarkerBuilder"]

MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"

_ARROW, _LINE_STRIP = 0, 4  # visualization_msgs/Marker: type
_ADD = 0  # action
_BELT_WIDTH = 0.004  # [m], of the line
_SHAFT, _HEAD, _HEAD_LENGTH = 0.02, 0.05, 0.06  # [m], diameters and length of an arrow
_GREY, _BLUE, _ORANGE = (0.45, 0.45, 0.48, 1.0), (0.10, 0.45, 0.85, 1.0), (0.90, 0.45, 0.05, 1.0)  # r g b a


class MarkerBuilder:
    """Builds the markers of one wheel, serialised: what stays the same is laid out once.

    Three markers: ``belt``, the closed line of the belt; ``axle_force``, an arrow from the axle's origin along the
    force of the wheel on its suspension; ``contact_load``, an arrow along the force of the road on the tire, whose
    head is at the lowest point of the belt.

    Parameters
    ----------
    frame_id : str
        The axle's frame: x forward, y left, z up.
    points : int
        P, the number of points along the belt.
    number : int
        The id of the wheel's markers; with one number per wheel all wheels can share a topic.
    lifetime : float
        Time after which a marker that is not renewed vanishes [s].
    """

    def __init__(self, frame_id: str, points: int, *, number: int = 0, lifetime: float = 0.5) -> None:
        arrow = (_SHAFT, _HEAD, _HEAD_LENGTH)
        forms = (
            ("belt", _LINE_STRIP, (_BELT_WIDTH, 0.0, 0.0), _GREY, points + 1),
            ("axle_force", _ARROW, arrow, _BLUE, 2),
            ("contact_load", _ARROW, arrow, _ORANGE, 2),
        )
        duration = sec_nanosec(round(1e9 * lifetime))
        self._points = points
        self._lowest = round(0.75 * points) % points  # psi = 2 pi j/P, 3 pi/2 at the road
        self._message, stamps, (belt, axle, contact) = _marker_array(frame_id, number, forms, duration)
        self._stamps = stamps
        # Views of the bytes that change: whoever fills them fills the message.
        self._belt = np.frombuffer(self._message, "<f8", 3 * (points + 1), belt).reshape(points + 1, 3)
        self._axle = np.frombuffer(self._message, "<f8", 6, axle).reshape(2, 3)
        self._contact = np.frombuffer(self._message, "<f8", 6, contact).reshape(2, 3)

    def build(
        self, stamp_ns: int, points: ArrayLike, axle_force: ArrayLike, contact_load: ArrayLike, force_scale: float
    ) -> bytes:
        """The markers at one moment.

        Parameters
        ----------
        stamp_ns : int
            Time of the state that is drawn [ns].
        points : (P, 3 or more) array_like
            x, y, z of the belt in the axle's frame [m], at psi = 2 pi j/P; further columns are left aside.
        axle_force : (2,) array_like
            force.x and force.z of the wheel on its suspension [N].
        contact_load : (2,) array_like
            force.x (traction) and force.z (load) of the road on the tire [N].
        force_scale : float
            Length of the arrows per force [m/N].

        Returns
        -------
        bytes
            A visualization_msgs/MarkerArray.

        Raises
        ------
        MessageError
            If the stamp is outside ROS time.
        """
        place = np.asarray(points, np.float64)
        if place.ndim != 2 or place.shape[0] != self._points or place.shape[1] < 3:
            raise ValueError(f"points: shape {place.shape}, must be ({self._points}, 3)")
        self._belt[:-1] = place[:, :3]
        self._belt[-1] = self._belt[0]
        self._axle[1, ::2] = np.multiply(axle_force, force_scale)
        self._contact[:] = self._belt[self._lowest]
        self._contact[0, ::2] -= np.multiply(contact_load, force_scale)
        return _stamped(self._message, self._stamps, stamp_ns)


_Form = tuple[str, int, tuple[float, float, float], tuple[float, float, float, float], int]


def _marker_array(
    frame_id: str, number: int, forms: tuple[_Form, ...], lifetime: tuple[int, int]
) -> tuple[bytearray, list[int], list[int]]:
    """Message with markers of namespace, type, scale, colour and number of points; where stamps and points are."""
    body = bytearray(struct.pack("<I", len(forms)))
    stamps, places = [], []

    def put(layout: str, alignment: int, *values: float) -> int:
        body.extend(bytes(-len(body) % alignment))
        position = len(body)
        body.extend(struct.pack("<" + layout, *values))
        return BODY + position

    def put_texts(*texts: str) -> None:
        for text in texts:
            body.extend(encoded_string(text, len(body)))

    for namespace, kind, scale, colour, points in forms:
        stamps.append(put("iI", 4, 0, 0))
        put_texts(frame_id, namespace)
        put("iii", 4, number, kind, _ADD)
        put("10d", 8, *(0.0, 0.0, 0.0), *(0.0, 0.0, 0.0, 1.0), *scale)  # position and orientation: those of the frame
        put("4f", 4, *colour)
        put("iI?", 4, *lifetime, False)  # and not frame_locked: where the axle was at the stamp
        put("I", 4, points)
        places.append(put(f"{3 * points}d", 8, *([0.0] * 3 * points)))
        put("I", 4, 0)  # colors
        put_texts("")  # texture_resource
        put("iI", 4, 0, 0)  # texture: stamp
        put_texts("", "")  # its frame and format
        put("II", 4, 0, 0)  # its data; uv_coordinates
        put_texts("", "", "")  # text, mesh_resource, the name of mesh_file
        put("I?", 4, 0, False)  # its data; mesh_use_embedded_materials
    return bytearray(LITTLE_ENDIAN) + body, stamps, places


def _stamped(message: bytearray, stamps: list[int], stamp_ns: int) -> bytes:
    sec, nanosec = sec_nanosec(stamp_ns)
    for position in stamps:
        struct.pack_into("<iI", message, position, sec, nanosec)
    return bytes(message)
