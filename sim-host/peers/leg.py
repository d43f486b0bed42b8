"""Plays the leg for the program `controller`: a hopper in air, in lock-step or by the clock."""
import argparse, cmath, contextlib, json, math, os, select, socket, sys, time
from ctypes import Structure, c_float as F32, c_uint16 as U16, c_uint32 as U32, c_uint64 as U64
import iceoryx2 as iox2  # pip install iceoryx2==0.10.0
HEADER = [("version", U16), ("flags", U16), ("run_id", U32), ("seq", U64), ("t_ns", U64)]
def message(name, fields): return type(name, (Structure,), {"_fields_": HEADER + fields, "type_name": lambda: name})
Sample = message("leg.sample.v2", [(f, F32) for f in "set_point vx y vy leg_length density".split()] + [("sensors", U32 * 12)])
Command = message("leg.command.v2", [("angle", F32), ("elongation", F32), ("rate", F32), ("telemetry", U32 * 7)])
options = argparse.ArgumentParser(description=__doc__)
for name, usual in {"domain": "default", "mode": "lock-step", "set-point": 0.0, "duration": 10.0}.items():
    options.add_argument("--" + name, type=type(usual), default=usual)
options = options.parse_args()
peer = socket.socket(socket.AF_UNIX)  # Agree with the controller, then open the session's shared memory.
peer.connect(f"/dev/shm/spring-leg-{os.getuid()}/{options.domain}/session.sock")
lines, config = peer.makefile(), iox2.config.default()
def send(line): peer.sendall((json.dumps(line) + "\n").encode())
send({"hello": {"version": 1, "pid": os.getpid(), "params": {"wire_version": 2, "rate_hz": 1000, "gravity_m_s2": 9.81, "time_mode": options.mode}}})
session = (answer := json.loads(lines.readline())["hello"]).get("session") or sys.exit("the controller refuses: " + answer["refused"])
config.global_cfg.prefix, config.global_cfg.root_path = iox2.FileName.new(session["prefix"]), iox2.Path.new(session["folder"])
node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
service = lambda name, kind: node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(kind).open()
samples, commands = service("leg/samples", Sample).publisher_builder().create(), service("leg/commands", Command).subscriber_builder().buffer_size(1).create()
wake, place = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM), session["folder"] + "/{}.wake"  # Both sides block on it.
wake.bind(place.format("leg")), wake.setblocking(False), send("ready")
if (answer := lines.readline()) != '"ready"\n': sys.exit("the controller refuses: " + answer)
wake.connect(place.format("controller"))
def send_sample(*fields):
    samples.send_copy(Sample(*fields))
    with contextlib.suppress(OSError): wake.send(b"0")
def receive(answers):  # the newest command, or None; in lock-step wait for the one that answers
    while (received := commands.receive()) or answers:
        if received:
            command = Command.from_buffer_copy(received.payload().contents)
            received.delete()
            if not answers or command.seq == seq: return command
        elif peer in select.select([peer, wake], [], [])[0]: sys.exit("the controller has left")
        else: wake.recv(1)
body, speed, foot, seq, apexes, command, ticks = 2j, 0j, None, 0, [], None, 1  # x + iy in the plane
def play(angle, elongation, rate):  # one tick: 80 kg, with 8 kg of added mass, on a spring of 20 kN/m
    global body, speed, foot
    for step in range(20):
        body, push = body + speed * 25e-6, -9.81j * 80 / 88
        if foot is None and speed.imag < 0 and body.imag < math.sin(angle): foot = body - cmath.rect(1, angle)
        if foot is not None:
            leg, rest = body - foot, 1 + min(max(elongation + rate * step * 50e-6, 0), 0.2)
            foot, push = (foot, push + 20000 / 88 * (rest / abs(leg) - 1) * leg) if abs(leg) < rest + 1e-9 else (None, push)
        if speed.imag > 0 >= (speed + push * 50e-6).imag: apexes.append(speed.real)
        speed, body = speed + push * 50e-6, body + (speed + push * 50e-6) * 25e-6
while seq < 1000 * options.duration and body.imag > 0:
    send_sample(2, 0b11100001 + 2 * (foot is not None), 1, seq, seq * 10**6, options.set_point, speed.real, body.imag, speed.imag)
    if options.mode == "real-time" and command:  # Play all ticks that are due, under the newest command.
        time.sleep(max(0, start + (seq + 1) / 1000 - time.monotonic()))
        command, ticks = receive(False) or command, max(1, int(1000 * (time.monotonic() - start)) - seq)
    else:
        command, start = receive(True), start if command else time.monotonic()
    for seq in range(seq + 1, seq + 1 + ticks):  # After 10 ms without a command the leg is upright and passive.
        age = (seq - 1 - command.seq) / 1000
        play(*(command.angle, command.elongation + age * command.rate, command.rate) if age < 0.01 else (math.pi / 2, 0, 0))
send_sample(2, 16, 1, seq), send("left")  # the end of the run, and of the session
print(json.dumps({"ticks": seq, "ticks_per_s": round(seq / (time.monotonic() - start)), "hops": len(apexes), "apexes_m_s": apexes}))
