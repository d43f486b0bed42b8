"""Checks what viewers make of a recording, with the libraries of Foxglove and Rerun.

    python3 -m venv venv && venv/bin/pip install -r tests/requirements.txt
    sim-host run --in-process --medium water --duration 10 --fault drag=1.1 --record run.mcap
    venv/bin/python sim-host/tools/check_viewers.py run.mcap

The run must be one in water with a fault that lasts from its start to its end. Ends with status 1
unless the schemas are those of Foxglove's SDK, transforms and scene show the recorded states at
50 Hz, the log tells of start, fault, decisions and end, messages are in order of time within each
chunk, and Rerun converts the recording and loads what `rerun_view.py` makes of it.
"""

import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import foxglove.messages
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap_protobuf.decoder import DecoderFactory

VIEWERS = Path(__file__).parent.parent / "viewers"
RATE_HZ = 50
FOXGLOVE = {
    "/log": "Log",
    "/tf": "FrameTransform",
    "/scene": "SceneUpdate",
    "/points/leg": "PointCloud",
    "/points/ground": "PointCloud",
}


def chunks_in_order(path):
    """Checks the order of time within each chunk; returns the number of chunks."""
    chunks = 0
    with open(path, "rb") as file:
        for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
            if isinstance(record, Chunk):
                assert record.compression == "zstd", record.compression
                inside = breakup_chunk(record, validate_crc=True)
                times = [entry.log_time for entry in inside if isinstance(entry, Message)]
                assert times == sorted(times), "a chunk is not in order of time"
                chunks += 1
    return chunks


def read(path):
    """Returns the decoded messages of each topic with their log times, and the schemas."""
    messages, schemas = defaultdict(list), {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            messages[channel.topic].append((message.log_time, decoded))
            schemas[channel.topic] = schema
    return messages, schemas


def check_schemas(schemas):
    for topic, name in FOXGLOVE.items():
        own = getattr(foxglove.messages, name).get_schema()
        found = schemas[topic]
        assert (found.name, found.encoding) == (own.name, own.encoding), (topic, found.name)
        assert found.data == own.data, f"{topic}: not the schema of Foxglove's SDK"


def check_pictures(messages):
    states = dict(messages["/state"])
    duration_s = 1e-9 * (max(states) - min(states))
    frames = defaultdict(dict)
    for time, transform in messages["/tf"]:
        frames[time][transform.parent_frame_id, transform.child_frame_id] = transform.translation
    assert abs(len(frames) - RATE_HZ * duration_s) <= 1, (len(frames), duration_s)
    standing = 0
    for time, found in frames.items():
        state, body, leg = states[time], found["world", "body"], found["body", "foot"]
        assert (body.x, body.z) == (state.x_m, state.y_m), "the body is elsewhere"
        length_m = (leg.x**2 + leg.z**2) ** 0.5
        assert 0.5 < length_m < 1.5 and leg.z < 0, "no leg"
        if state.phase == 1:
            standing += 1
            assert abs(body.x + leg.x - state.foot_x_m) < 1e-9, "the foot slides"
            assert abs(body.z + leg.z - state.foot_y_m) < 1e-9, "the foot is not on the ground"
    assert 0 < standing < len(frames), "the leg does not hop"
    entities = defaultdict(list)
    for time, scene in messages["/scene"]:
        for entity in scene.entities:
            assert entity.frame_id == "world", entity.frame_id
            entities[entity.id].append((time, entity))
    assert {"leg", "ground", "water"} == set(entities), set(entities)
    assert len(entities["leg"]) == len(frames) == len(messages["/points/leg"])
    for time, leg in entities["leg"]:
        foot = leg.lines[0].points[1]
        found = frames[time]
        assert abs(foot.x - found["world", "body"].x - found["body", "foot"].x) < 1e-9
    for _, cloud in messages["/points/leg"] + messages["/points/ground"]:
        assert cloud.data and len(cloud.data) % cloud.point_stride == 0, "no points"
    return len(frames)


def check_log(messages):
    log = [(entry.level, entry.name, entry.message) for _, entry in messages["/log"]]
    for level, name, text in [
        (2, "run", "starts in lock-step at 1000 Hz"),
        (3, "run", "fault drag=1.1"),
        (2, "controller", "receives the policy"),
        (2, "controller", "decides for"),
        (2, "run", "ends after"),
    ]:
        assert any(l == level and n == name and text in m for l, n, m in log), (text, log)
    decisions = sum("decides for" in text for _, _, text in log)
    assert decisions == sum(apex.answered for _, apex in messages["/apex"]) > 0, decisions


def check_layout(messages):
    layout = json.loads((VIEWERS / "foxglove-layout.json").read_text())
    panels = layout["configById"]
    names = [panels["RosOut!log"]["topicToRender"], *panels["3D!leg"]["topics"]]
    assert set(names) <= set(messages), names
    for panel in panels.values():
        for path in panel.get("paths", []):
            topic, field = path["value"].split(".")
            assert isinstance(getattr(messages[topic][0][1], field), float), path
    placed = json.dumps(layout["layout"])
    assert all(f'"{name}"' in placed for name in panels), "a panel is not placed"


def rerun(*arguments):
    command = [sys.executable, "-m", "rerun", *map(str, arguments)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stdout


def check_rerun(path, folder):
    converted = folder / "converted.rrd"
    rerun("mcap", "convert", path, "-o", converted)
    stats = rerun("rrd", "stats", converted)
    for part in ["Transform3D:translation", "Points3D:positions", "TextLog:text"]:
        assert f"{part}: " in stats, (part, stats)
    viewed = folder / "viewed.rrd"
    script = [sys.executable, VIEWERS / "rerun_view.py", path, "--save", viewed]
    subprocess.run(list(map(str, script)), check=True)
    stats = rerun("rrd", "stats", viewed)
    for part in ["/scene/leg/line", "/scene/ground/surface", "/scene/water/surface", "/log",
                 "/state/y_m", "/apex/vx_m_s", "/command/elongation_m"]:
        assert f"{part}: " in stats, (part, stats)


def main(path):
    chunks = chunks_in_order(path)
    messages, schemas = read(path)
    check_schemas(schemas)
    pictures = check_pictures(messages)
    check_log(messages)
    check_layout(messages)
    with tempfile.TemporaryDirectory() as folder:
        check_rerun(path, Path(folder))
    print(f"{chunks} chunks, {pictures} pictures, {len(messages['/log'])} lines of the log: good")


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
