"""The leg's side of a session in lock-step, as controller/host/SESSION.md describes it."""

import contextlib
import json
import os
import select
import socket
from ctypes import Structure, c_float, c_uint16, c_uint32, c_uint64

import iceoryx2 as iox2

HEADER = [("version", c_uint16), ("flags", c_uint16), ("run_id", c_uint32), ("seq", c_uint64), ("t_ns", c_uint64)]
WIRE_VERSION, END = 2, 1 << 4
# Contact, leg length, vx, y and vy are sensed.
SENSED, IN_CONTACT, DENSITY_SENSED = 0b11100101, 1 << 1, 1 << 3


def message(name, fields):
    return type(name, (Structure,), {"_fields_": HEADER + fields, "type_name": lambda: name})


Sample = message(
    "leg.sample.v2",
    [(f, c_float) for f in ("set_point", "vx", "y", "vy", "leg_length", "density")] + [("sensors", c_uint32 * 12)],
)
Command = message(
    "leg.command.v2", [("angle", c_float), ("elongation", c_float), ("rate", c_float), ("telemetry", c_uint32 * 7)]
)


class LegSession:
    """Connects to the controller of a domain."""

    def __init__(self, domain, rate_hz):
        self.rate_hz = rate_hz
        self.peer = socket.socket(socket.AF_UNIX)
        self.peer.connect(f"/dev/shm/spring-leg-{os.getuid()}/{domain}/session.sock")
        self.lines = self.peer.makefile()
        params = {"wire_version": WIRE_VERSION, "rate_hz": rate_hz, "gravity_m_s2": 9.81, "time_mode": "lock-step"}
        self.send({"hello": {"version": 1, "pid": os.getpid(), "params": params}})
        answer = json.loads(self.lines.readline())["hello"]
        if "session" not in answer:
            raise SystemExit(f"the controller refuses: {answer['refused']}")
        config = iox2.config.default()
        config.global_cfg.prefix = iox2.FileName.new(answer["session"]["prefix"])
        config.global_cfg.root_path = iox2.Path.new(answer["session"]["folder"])
        self.node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
        service = lambda name, kind: (
            self.node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(kind).open()
        )
        self.samples = service("leg/samples", Sample).publisher_builder().create()
        self.commands = service("leg/commands", Command).subscriber_builder().buffer_size(1).create()
        # Both sides block on these sockets, and send a byte after each message.
        self.wake = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.wake.bind(answer["session"]["folder"] + "/leg.wake")
        self.wake.setblocking(False)
        controller = answer["session"]["folder"] + "/controller.wake"
        self.send("ready")
        answer = self.lines.readline()
        if answer != '"ready"\n':
            raise SystemExit(f"the controller refuses: {answer}")
        self.wake.connect(controller)

    def send_sample(self, *fields):
        self.samples.send_copy(Sample(*fields))
        with contextlib.suppress(OSError):
            self.wake.send(b"0")

    def send(self, line):
        self.peer.sendall((json.dumps(line) + "\n").encode())

    def exchange(self, seq, set_point, reading, density_ratio=None):
        """Sends what is sensed at a tick; returns angle, elongation and its rate."""
        flags = SENSED + IN_CONTACT * reading["contact"] + DENSITY_SENSED * (density_ratio is not None)
        self.send_sample(
            WIRE_VERSION,
            flags,
            1,
            seq,
            seq * 10**9 // self.rate_hz,
            set_point,
            reading["vx_m_s"],
            reading["y_m"],
            reading["vy_m_s"],
            reading["leg_length_m"],
            density_ratio or 0.0,
        )
        while True:
            if received := self.commands.receive():
                command = Command.from_buffer_copy(received.payload().contents)
                received.delete()
                if command.seq == seq:
                    return command.angle, command.elongation, command.rate
            # The other socket is readable only once the controller leaves.
            elif self.peer in select.select([self.peer, self.wake], [], [])[0]:
                raise SystemExit("the controller has left")
            else:
                self.wake.recv(1)

    def leave(self, seq):
        """Ends the run and the session."""
        self.send_sample(WIRE_VERSION, END, 1, seq)
        self.send("left")
