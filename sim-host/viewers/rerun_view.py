"""Shows a recording in Rerun: the hopping leg, every number over time, and the log.

    python3 -m venv venv && venv/bin/pip install -r tests/requirements.txt
    sim-host run --in-process --duration 10 --record run.mcap
    venv/bin/python sim-host/viewers/rerun_view.py run.mcap

`--save FILE.rrd` writes a file for `rerun FILE.rrd` instead of opening the viewer. Rerun opens a
recording by itself, too (`rerun run.mcap`), and shows points and log, but neither scene nor plots.
"""

import argparse
from collections import defaultdict

import rerun as rr
import rerun.blueprint as rrb
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

LEVELS = {1: "DEBUG", 2: "INFO", 3: "WARN", 4: "ERROR", 5: "CRITICAL"}


def numbers(message, prefix=""):
    """Yields name and value of each number in a message, also of those within others."""
    for field in message.DESCRIPTOR.fields:
        name, value = prefix + field.name, getattr(message, field.name)
        if field.is_repeated or field.type in (field.TYPE_STRING, field.TYPE_BYTES):
            continue
        if field.type != field.TYPE_MESSAGE:
            yield name, float(value)
        elif message.HasField(field.name):
            yield from numbers(value, name + "/")


def rgba(color):
    return [round(255 * part) for part in (color.r, color.g, color.b, color.a)]


def xyz(place):
    return [place.x, place.y, place.z]


def draw(entity):
    """Logs an entity of a scene."""
    path = f"/scene/{entity.id}"
    for line in entity.lines:
        strip = [xyz(point) for point in line.points]
        rr.log(
            f"{path}/line",
            rr.LineStrips3D([strip], radii=line.thickness / 2, colors=[rgba(line.color)]),
        )
    if entity.spheres:
        rr.log(
            f"{path}/spheres",
            rr.Points3D(
                [xyz(sphere.pose.position) for sphere in entity.spheres],
                radii=[sphere.size.x / 2 for sphere in entity.spheres],
                colors=[rgba(sphere.color) for sphere in entity.spheres],
            ),
        )
    for triangles in entity.triangles:
        indices = list(triangles.indices)
        rr.log(
            f"{path}/surface",
            rr.Mesh3D(
                vertex_positions=[xyz(point) for point in triangles.points],
                triangle_indices=list(zip(indices[::3], indices[1::3], indices[2::3])),
                albedo_factor=rgba(triangles.color),
            ),
        )


def read(path):
    """Logs scene and texts, and returns the numbers by their paths: times and values."""
    columns = defaultdict(lambda: ([], []))
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            rr.set_time("time", timestamp=message.log_time * 1e-9)
            if schema.name == "foxglove.SceneUpdate":
                for entity in decoded.entities:
                    draw(entity)
            elif schema.name == "foxglove.Log":
                level = LEVELS.get(decoded.level, "INFO")
                rr.log("/log", rr.TextLog(f"{decoded.name} {decoded.message}", level=level))
            elif schema.name.startswith("leg."):
                for name, value in numbers(decoded):
                    times, values = columns[f"{channel.topic}/{name}"]
                    times.append(message.log_time)
                    values.append(value)
    return columns


def blueprint(paths):
    """Returns views of the leg, of what matters most, and of each topic."""
    plot = lambda name, *contents: rrb.TimeSeriesView(name=name, contents=list(contents))
    most = rrb.Vertical(
        plot("height, m", "/state/y_m", "/apex/y_m"),
        plot("velocity, m/s", "/state/vx_m_s", "/apex/vx_m_s", "/sample/set_point_m_s"),
        plot("density", "/state/density_ratio", "/apex/density_estimate"),
        plot("command", "/command/leg_angle_rad", "/command/elongation_m"),
        name="run",
    )
    topics = sorted({path.split("/")[1] for path in paths})
    each = [plot(f"/{topic}", f"/{topic}/**") for topic in topics]
    leg = rrb.Spatial3DView(name="leg", origin="/scene")
    log = rrb.TextLogView(name="log", origin="/log")
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(leg, log, row_shares=[3, 1]), rrb.Tabs(most, *each))
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("recording")
    parser.add_argument("--save", metavar="FILE", help="write FILE, open no viewer")
    args = parser.parse_args()
    rr.init("spring-leg", spawn=args.save is None)
    if args.save is not None:
        rr.save(args.save)
    rr.log("/scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    columns = read(args.recording)
    for path, (times, values) in columns.items():
        rr.send_columns(
            path,
            indexes=[rr.TimeColumn("time", timestamp=[time * 1e-9 for time in times])],
            columns=rr.Scalars.columns(scalars=values),
        )
    rr.send_blueprint(blueprint(columns))
    print(f"{len(columns)} numbers over time")


if __name__ == "__main__":
    main()
