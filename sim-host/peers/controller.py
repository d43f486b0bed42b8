"""Plays the controller for `sim-host run`, in lock-step or by the clock: places the foot by the speed."""
import argparse, contextlib, fcntl, json, math, os, secrets, select, socket, sys
from ctypes import Structure, c_float as F32, c_uint16 as U16, c_uint32 as U32, c_uint64 as U64
import iceoryx2 as iox2  # pip install iceoryx2==0.10.0
HEADER = [("version", U16), ("flags", U16), ("run_id", U32), ("seq", U64), ("t_ns", U64)]
class Sample(Structure):
    type_name = lambda: "leg.sample.v2"
    _fields_ = HEADER + [(name, F32) for name in "set_point vx y vy leg_length density".split()] + [("sensors", U32 * 12)]
class Command(Structure):
    type_name = lambda: "leg.command.v2"
    _fields_ = HEADER + [("angle", F32), ("elongation", F32), ("rate", F32), ("telemetry", U32 * 7)]

options = argparse.ArgumentParser(description=__doc__)
options.add_argument("--domain", default="default")
options = options.parse_args()

domain = f"/dev/shm/spring-leg-{os.getuid()}/{options.domain}"  # Join it, take the role, and wait for a leg.
os.makedirs(domain, mode=0o700, exist_ok=True)
member, role = os.open(domain, os.O_RDONLY), open(f"{domain}/controller.role", "a+")
fcntl.flock(member, fcntl.LOCK_SH), fcntl.flock(role, fcntl.LOCK_EX | fcntl.LOCK_NB)
role.truncate(0), print(os.getpid(), file=role, flush=True)
if os.path.exists(f"{domain}/session.sock"): os.remove(f"{domain}/session.sock")
listener = socket.socket(socket.AF_UNIX)
listener.bind(f"{domain}/session.sock"), listener.listen()
lines = (peer := listener.accept()[0]).makefile()
def send(line): peer.sendall((json.dumps(line) + "\n").encode())
leg = json.loads(lines.readline())["hello"]

name = secrets.token_hex(8)  # Create the session's shared memory under a new name.
session = {"prefix": f"leg-{os.getuid()}-{options.domain}-{os.fstat(member).st_ino:x}.{name}.", "folder": f"{domain}/session-{name}"}
os.mkdir(session["folder"])
config, place = iox2.config.default(), iox2.Path.new(session["folder"])
config.global_cfg.prefix, config.global_cfg.root_path = iox2.FileName.new(session["prefix"]), place
node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
def service(name, kind):
    builder = node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(kind).history_size(0).enable_safe_overflow(True)
    builder = builder.max_publishers(1).max_subscribers(8).max_nodes(16)
    return builder.subscriber_max_buffer_size(2048).subscriber_max_borrowed_samples(2).create()
samples = service("leg/samples", Sample).subscriber_builder().buffer_size(1).create()
commands = service("leg/commands", Command).publisher_builder().create()
wake, place = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM), session["folder"] + "/{}.wake"  # Both sides block on it.
wake.bind(place.format("controller")), wake.setblocking(False)
send({"hello": {"version": 1, "pid": os.getpid(), "params": {"wire_version": 2, "rate_hz": 1000, "gravity_m_s2": 9.81}, "session": session}})
if (answer := lines.readline()) != '"ready"\n': sys.exit(f"the leg refuses: {answer or 'it has left'}")
commands.update_connections(), samples.has_samples(), wake.connect(place.format("leg"))
send("ready")
ticks = 0
while True:
    if (received := samples.receive()) is None:
        if peer in select.select([peer, wake], [], [])[0]: break
        wake.recv(1)
        continue
    sample = Sample.from_buffer_copy(received.payload().contents)
    received.delete()
    if sample.flags == 16: break  # the end of the run
    angle = math.pi / 2 + 0.17 * sample.vx - 0.05 * sample.set_point  # The foot lands ahead of the mass by the speed.
    commands.send_copy(Command(2, 0, sample.run_id, sample.seq, sample.t_ns, angle))
    with contextlib.suppress(OSError): wake.send(b"0")
    ticks += 1
print(json.dumps({"ticks": ticks}))
