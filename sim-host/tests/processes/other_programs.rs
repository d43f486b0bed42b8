//! Recordings that other programs have written anew: filtered, merged, doubled, sorted
//! otherwise, compressed.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use mcap::records::{ChunkHeader, MessageHeader, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MessageStream, WriteOptions};

use crate::place::{Ended, Place, text};

const TICKS: u64 = 5_000;

/// A message as it is in a file.
#[derive(Clone, Debug)]
struct Message {
    topic: String,
    schema: String,
    definition: Vec<u8>,
    sequence: u32,
    time: u64,
    data: Vec<u8>,
}

/// Records a run and returns the file.
fn record(place: &Place, name: &str, more: &[&str]) -> PathBuf {
    let path = place.file(name);
    let run = ["--in-process", "--duration", "5", "--record", text(&path)];
    place.alone(&[&run[..], more].concat()).end().assert_ok();
    path
}

fn messages(path: &Path) -> Vec<Message> {
    let bytes = fs::read(path).unwrap();
    let read = MessageStream::new(&bytes).unwrap().map(|message| {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        Message {
            topic: message.channel.topic.clone(),
            schema: schema.name.clone(),
            definition: schema.data.to_vec(),
            sequence: message.sequence,
            time: message.log_time,
            data: message.data.to_vec(),
        }
    });
    read.collect()
}

/// Writes messages as another program does: without the profile, channels as they come.
fn write(path: &Path, messages: &[Message]) {
    let mut writer = WriteOptions::new()
        .library("another program")
        .compression(None)
        .chunk_size(Some(1 << 16))
        .create(File::create(path).unwrap())
        .unwrap();
    let mut channels = BTreeMap::new();
    for message in messages {
        let id =
            *channels.entry((message.topic.clone(), message.schema.clone())).or_insert_with(|| {
                let schema =
                    writer.add_schema(&message.schema, "protobuf", &message.definition).unwrap();
                writer.add_channel(schema, &message.topic, "protobuf", &BTreeMap::new()).unwrap()
            });
        let header = MessageHeader {
            channel_id: id,
            sequence: message.sequence,
            log_time: message.time,
            publish_time: message.time,
        };
        writer.write_to_known_channel(&header, &message.data).unwrap();
    }
    writer.finish().unwrap();
}

fn replay(place: &Place, path: &Path) -> Ended {
    place.start("replay", &[text(path)]).end()
}

fn plot(place: &Place, path: &Path) -> String {
    let svg = place.file("out.svg");
    place.start("plot", &[text(path), "-o", text(&svg)]).end().assert_ok();
    let picture = fs::read_to_string(svg).unwrap();
    // The title has the name of the file.
    picture.replace(path.file_name().unwrap().to_str().unwrap(), "NAME")
}

#[track_caller]
fn assert_same(ended: &Ended) {
    let same = format!("{TICKS} commands compared: the same, bit for bit");
    assert!(ended.assert_ok().out.contains(&same), "{}", ended.out);
    assert_eq!(ended.err, "");
}

#[test]
fn reads_messages_in_any_order_and_twice() {
    let place = Place::new();
    let whole = record(&place, "whole.mcap", &[]);
    let all = messages(&whole);
    let picture = plot(&place, &whole);
    let path = place.file("anew.mcap");
    let by_topic = || {
        let mut sorted = all.clone();
        sorted.sort_by(|a, b| a.topic.cmp(&b.topic));
        sorted
    };
    let mut reversed = all.clone();
    reversed.reverse();
    let mut by_time = all.clone();
    // Among those of one time, commands before samples.
    by_time.sort_by(|a, b| (a.time, &a.topic).cmp(&(b.time, &b.topic)));
    let twice: Vec<_> = all.iter().flat_map(|m| [m.clone(), m.clone()]).collect();
    let joined = [all.clone(), all.clone()].concat();
    for (name, anew) in [
        ("as it is", all.clone()),
        ("topic by topic", by_topic()),
        ("backwards", reversed),
        ("commands before samples", by_time),
        ("each message twice", twice),
        ("all messages twice", joined),
    ] {
        write(&path, &anew);
        println!("{name}");
        assert_same(&replay(&place, &path));
        assert!(plot(&place, &path) == picture, "the picture differs: {name}");
    }
}

#[test]
fn reads_compressed_files_and_names_a_compression_that_it_cannot_read() {
    let place = Place::new();
    let whole = place.file("whole.mcap");
    write(&whole, &messages(&record(&place, "recorded.mcap", &[])));
    let path = place.file("compressed.mcap");
    let lz4 = |bytes: &[u8]| {
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    };
    let zstd = |bytes: &[u8]| {
        ruzstd::encoding::compress_to_vec(bytes, ruzstd::encoding::CompressionLevel::Fastest)
    };
    compress(&whole, &path, "lz4", &lz4);
    assert!(size(&path) < size(&whole) * 3 / 4);
    assert_same(&replay(&place, &path));
    compress(&whole, &path, "zstd", &zstd);
    assert!(size(&path) < size(&whole) * 3 / 4);
    assert_same(&replay(&place, &path));
    // A byte of the compressed data is damaged.
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    fs::write(&path, bytes).unwrap();
    replay(&place, &path).assert(0, &["it is damaged", "last complete chunk"]);
    compress(&whole, &path, "brotli", &<[u8]>::to_vec);
    replay(&place, &path).assert(2, &["compressed by `brotli`", "`lz4` and `zstd` can"]);
}

fn size(path: &Path) -> u64 {
    fs::metadata(path).unwrap().len()
}

/// Writes a file anew with its chunks compressed, without its index.
fn compress(from: &Path, to: &Path, name: &str, method: &dyn Fn(&[u8]) -> Vec<u8>) {
    let mut out = mcap::MAGIC.to_vec();
    let mut put = |opcode: u8, content: &[u8]| {
        out.push(opcode);
        out.extend((content.len() as u64).to_le_bytes());
        out.extend(content);
    };
    let mut file = fs::read(from).unwrap().leak() as &[u8];
    let options = LinearReaderOptions::default().with_emit_chunks(true);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.unwrap() {
            LinearReadEvent::ReadRequest(least) => {
                let count = least.max(1 << 16).min(file.len());
                reader.insert(count.max(least))[..count].copy_from_slice(&file[..count]);
                reader.notify_read(count);
                file = &file[count..];
            }
            LinearReadEvent::Record { opcode: op::CHUNK, data } => {
                let Ok(Record::Chunk { header, data }) = mcap::parse_record(op::CHUNK, data) else {
                    panic!("no chunk");
                };
                put(op::CHUNK, &chunk(&header, name, &method(&data)));
            }
            LinearReadEvent::Record { opcode: op::DATA_END, .. } => break,
            LinearReadEvent::Record { opcode: op::MESSAGE_INDEX, .. } => (),
            LinearReadEvent::Record { opcode, data } => put(opcode, data),
        }
    }
    put(op::DATA_END, &[0; 4]);
    put(op::FOOTER, &[0; 20]);
    out.extend(mcap::MAGIC);
    fs::write(to, out).unwrap();
}

fn chunk(header: &ChunkHeader, name: &str, compressed: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    bytes.extend(header.message_start_time.to_le_bytes());
    bytes.extend(header.message_end_time.to_le_bytes());
    bytes.extend(header.uncompressed_size.to_le_bytes());
    bytes.extend(header.uncompressed_crc.to_le_bytes());
    bytes.extend((name.len() as u32).to_le_bytes());
    bytes.extend(name.as_bytes());
    bytes.extend((compressed.len() as u64).to_le_bytes());
    bytes.extend(compressed);
    bytes
}

#[test]
fn a_replay_that_compared_nothing_fails_and_names_what_is_missing() {
    let place = Place::new();
    let all = messages(&record(&place, "whole.mcap", &[]));
    let path = place.file("filtered.mcap");
    for (topic, named) in [
        ("/command", "contains no new command of a controller (topic /command)"),
        ("/sample", "contains no sample (topic /sample)"),
        ("/config", "contains no configuration (topic /config)"),
        ("/policy", "contains no policy that ran from its first tick (topic /policy)"),
    ] {
        let rest: Vec<_> = all.iter().filter(|m| m.topic != topic).cloned().collect();
        write(&path, &rest);
        let ended = replay(&place, &path);
        ended.assert(2, &[named, "another program has removed"]);
        assert_eq!(ended.out, "");
    }
    // Other topics do not matter.
    let needed = ["/command", "/sample", "/config", "/policy"];
    let least: Vec<_> =
        all.iter().filter(|m| needed.contains(&m.topic.as_str())).cloned().collect();
    write(&path, &least);
    assert_same(&replay(&place, &path));

    // A span of time: the state of the controller before it is unknown.
    let from = all[0].time + 2_000_000_000;
    let is_kept = |m: &&Message| m.time >= from || ["/config", "/policy"].contains(&&*m.topic);
    let later: Vec<_> = all.iter().filter(is_kept).cloned().collect();
    write(&path, &later);
    let ended = replay(&place, &path);
    ended.assert(2, &["no command was compared: ticks 0 to 1999 are not in the recording"]);
    let earlier: Vec<_> = all.iter().filter(|m| m.time < from).cloned().collect();
    write(&path, &earlier);
    let ended = replay(&place, &path);
    assert!(ended.assert_ok().out.contains("2000 commands compared: the same"), "{}", ended.out);

    // A file of another program.
    let foreign: Vec<_> = all
        .iter()
        .map(|m| Message { schema: format!("other.{}", m.schema), ..m.clone() })
        .collect();
    write(&path, &foreign);
    replay(&place, &path).assert(2, &["not a recording of this leg", "has no message"]);
    // Its messages under our topics beside ours are ignored.
    write(&path, &[foreign, all].concat());
    assert_same(&replay(&place, &path));
}

#[test]
fn refuses_merged_and_joined_recordings_by_name() {
    let place = Place::new();
    let one = messages(&record(&place, "one.mcap", &[]));
    let other = messages(&record(&place, "other.mcap", &["--set-point", "0.4"]));
    let path = place.file("merged.mcap");
    let merged = [one.clone(), other.clone()].concat();
    write(&path, &merged);
    let named = "holds more than one run (it has 2 configurations), as when recordings are merged";
    replay(&place, &path).assert(2, &[named]);
    let svg = place.file("out.svg");
    place.start("plot", &[text(&path), "-o", text(&svg)]).end().assert(2, &[named]);
    // Joined as `cat` does it, where other readers see the first file only.
    let files = ["one.mcap", "other.mcap"].map(|name| fs::read(place.file(name)).unwrap());
    fs::write(&path, files.concat()).unwrap();
    replay(&place, &path).assert(2, &["holds more than one run (bytes follow its end)"]);
    // A file without its index is read to its last message.
    fs::write(&path, &files[0][..files[0].len() - 100]).unwrap();
    assert_same(&replay(&place, &path));
    // Without the configuration of the one, the ticks show it.
    let rest: Vec<_> = other.into_iter().filter(|m| m.topic != "/config").collect();
    write(&path, &[one, rest].concat());
    replay(&place, &path).assert(2, &["holds more than one run (tick 0 comes after tick "]);
}
