"""Reads a recording by the `mcap` project's own Python library, whole.

    python3 -m venv venv && venv/bin/pip install mcap mcap-protobuf-support
    sim-host run --in-process --duration 10 --record run.mcap
    venv/bin/python sim-host/tools/check_mcap.py run.mcap

Every checksum is checked and every message decoded by the schemas in the file.
Prints how many there are in each channel; ends with status 1 when a tick is
missing, out of order, or has no command.
"""

import collections
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def main(path):
    counts, samples, commands, last = collections.Counter(), [], [], 0
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        assert reader.get_header().profile == "spring-leg", reader.get_header()
        channels = {channel.topic for channel in reader.get_summary().channels.values()}
        for _, channel, message, decoded in reader.iter_decoded_messages():
            counts[channel.topic] += 1
            if channel.topic == "/sample":
                assert message.log_time > last, (message.log_time, last)
                last = message.log_time
                samples.append(decoded.seq)
            elif channel.topic == "/command":
                commands.append(decoded.tick)
    assert samples == list(range(len(samples))), "ticks are missing"
    assert samples == commands, "commands are missing"
    assert counts["/config"] == 1 and counts["/state"] == len(samples), counts
    for topic in sorted(channels):
        print(f"{topic:10} {counts[topic]:9}")


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
