"""An autopilot that takes uploads of missions, over a loopback connection (pymavlink)."""

import socket
import threading
import time
from contextlib import suppress
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_TIMEOUT_S = 10.0


class LoopbackVehicle:
    """Listens at a free port; ``uploads`` holds what arrived, by the type of mission."""

    def __init__(self, autopilot: int) -> None:
        self.uploads: dict[int, list[Any]] = {}
        self._autopilot = autopilot
        self._expected = 0
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(_TIMEOUT_S)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    @property
    def url(self) -> str:
        """Where MAVSDK connects to."""
        return f"tcpout://127.0.0.1:{self._server.getsockname()[1]}"

    def __enter__(self) -> "LoopbackVehicle":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(_TIMEOUT_S)
        self._server.close()

    def _serve(self) -> None:
        connection, _ = self._server.accept()
        with connection, connection.makefile("wb", buffering=0) as stream, suppress(OSError):
            connection.settimeout(0.05)
            link = mavlink.MAVLink(stream, srcSystem=1, srcComponent=1)
            link.robust_parsing = True
            beaten = -1.0
            while not self._ended.is_set():
                if time.monotonic() - beaten > 0.2:
                    beaten = time.monotonic()
                    kind, state = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_STATE_STANDBY
                    link.heartbeat_send(kind, self._autopilot, 0, 0, state)
                with suppress(TimeoutError):
                    for message in link.parse_buffer(connection.recv(4096)) or []:
                        self._answer(link, message)

    def _answer(self, link: Any, message: Any) -> None:
        kind = message.get_type()
        if kind == "COMMAND_LONG":
            link.command_ack_send(message.command, mavlink.MAV_RESULT_UNSUPPORTED)
        if kind not in ("MISSION_COUNT", "MISSION_ITEM_INT"):
            return
        got = self.uploads.setdefault(message.mission_type, [])
        if kind == "MISSION_COUNT":
            self._expected = message.count
            got.clear()
        elif message.seq == len(got):  # and not one that was sent twice
            got.append(message)
        sender = message.get_srcSystem(), message.get_srcComponent()
        if len(got) < self._expected:
            link.mission_request_int_send(*sender, len(got), message.mission_type)
        else:
            accepted = mavlink.MAV_MISSION_ACCEPTED
            link.mission_ack_send(*sender, accepted, message.mission_type)
