"""Services that are answered later."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation

__all__ = ["Deferred", "allow_deferred"]


class Deferred:
    """What a service's callback returns in place of a response that is not known yet."""

    def __init__(self) -> None:
        self._send: Callable[[Any], None] | None = None

    def keep(self, send: Callable[[Any], None]) -> None:
        """Keep what sends a response to the one who asked."""
        self._send = send

    def answer(self, response: Any) -> None:
        """Send the response; nothing, if the one who asked or the service has gone."""
        if self._send is not None:
            with suppress(InvalidHandle, rclpy_implementation.RCLError):
                self._send(response)
            self._send = None


def allow_deferred(service: Any) -> None:
    """Let the callback of a service return a :class:`Deferred`.

    Every executor of rclpy hands what the callback returns to the service's ``send_response``, with the header that
    says whom it is for. Coroutines would do, but EventsExecutor awaits none of a service (rclpy 7.1).

    Parameters
    ----------
    service : rclpy.service.Service
    """
    send = service.send_response

    def send_or_keep(response: Any, header: Any) -> None:
        if isinstance(response, Deferred):
            response.keep(partial(send, header=header))
        else:
            send(response, header)

    service.send_response = send_or_keep
