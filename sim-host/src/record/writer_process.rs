//! The process that writes the file, so that a killed run leaves a complete one.
//!
//! It reads frames until the pipe ends for whatever reason, then writes the
//! file's index and renames the file. It runs in a session of its own and
//! ignores signals to stop, because it ends with the run. One that is stopped by SIGSTOP
//! continues when the run gives it up, or when the run's process is gone, and completes its file.

use std::fs::{self, File, TryLockError};
use std::io::{self, BufReader, BufWriter, ErrorKind, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use foxglove::Schema;
use leg_process::remedy;
use mcap::records::MessageHeader;
use rustix::process::Signal;

use super::display::DisplayTopic;
use super::file::{PROTOBUF, RecordingFile};
use super::pipe::{self, Frame};
use super::schema::{Channel, DESCRIPTORS};

const BUFFER_LEN: usize = 1 << 18;

/// Printed when the writer accepts frames.
pub(super) const READY: &str = "ready";
/// Printed before the number of messages once the file is complete.
pub(super) const DONE: &str = "done ";
/// Printed before an error message.
pub(super) const FAILED: &str = "failed ";

/// Returns the path of the file until it is complete.
pub(super) fn part(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

/// Writes the frames from stdin to the file at `path`. Prints `READY`, then
/// `DONE` or `FAILED`, on stdout.
#[must_use]
pub fn main(path: &Path) -> ExitCode {
    let report = |line: &str| {
        // If the run is gone, nobody reads this.
        let mut out = io::stdout();
        let _ = out.write_all(format!("{line}\n").as_bytes()).and_then(|()| out.flush());
    };
    match detach().and_then(|()| write(path, || report(READY))) {
        Ok(messages) => {
            report(&format!("{DONE}{messages}"));
            ExitCode::SUCCESS
        }
        Err(error) => {
            report(&format!("{FAILED}{}", with_remedy(&error)));
            ExitCode::FAILURE
        }
    }
}

/// Shields the process from signals that are meant for the run.
fn detach() -> io::Result<()> {
    // Fails only for a process that leads a session already, which is as good.
    let _ = rustix::process::setsid();
    // Nobody else would continue a stopped one after the run.
    rustix::process::set_parent_process_death_signal(Some(Signal::CONT))?;
    leg_process::signals::disregard_stop_signals()
}

fn write(path: &Path, ready: impl FnOnce()) -> io::Result<u64> {
    let part = part(path);
    let file = claim(&part)?;
    let mut recording = RecordingFile::begin(BufWriter::with_capacity(BUFFER_LEN, &file))?;
    let mut channels = Vec::new();
    for channel in Channel::ALL {
        let schema = recording.add_schema(&channel.schema(), PROTOBUF, DESCRIPTORS)?;
        channels.push(Some(recording.add_channel(schema, channel.topic(), PROTOBUF)?));
    }
    // A topic for viewers begins with its first message: most recordings lack some.
    channels.resize(pipe::TOPICS, None);
    ready();

    let mut pipe = BufReader::with_capacity(BUFFER_LEN, io::stdin().lock());
    let mut buffer = Vec::new();
    // A broken pipe ends the recording as a closed one does.
    while let Ok(Some(frame)) = pipe::read(&mut pipe, &mut buffer) {
        match frame {
            Frame::Message { topic, log_time_ns, sequence, message } => {
                let channel_id = match channels[topic] {
                    Some(id) => id,
                    None => begin_display(&mut recording, topic)?,
                };
                channels[topic] = Some(channel_id);
                let header = MessageHeader {
                    channel_id,
                    sequence,
                    log_time: log_time_ns,
                    publish_time: log_time_ns,
                };
                recording.add(header, message)?;
            }
            Frame::Flush => recording.flush()?,
        }
    }
    let (messages, buffered) = recording.finish()?;
    buffered.into_inner().map_err(io::IntoInnerError::into_error)?;
    file.sync_all()?;
    put_in_place(&part, path)?;
    Ok(messages)
}

/// Adds the channel of a topic for viewers, by its number on the pipe.
fn begin_display<W: Write>(recording: &mut RecordingFile<W>, number: usize) -> io::Result<u16> {
    let topic = DisplayTopic::ALL[number - Channel::ALL.len()];
    let Schema { name, encoding, data } = topic.schema();
    let schema = recording.add_schema(&name, &encoding, &data)?;
    recording.add_channel(schema, topic.name(), PROTOBUF)
}

/// Gives the complete file its name. A file that cannot be replaced, because a container has
/// mounted it or the folder forbids it, is written over.
fn put_in_place(part: &Path, path: &Path) -> io::Result<()> {
    let Err(error) = fs::rename(part, path) else { return Ok(()) };
    let copied = fs::copy(part, path).and_then(|_| File::open(path)?.sync_all());
    if copied.is_ok() {
        return fs::remove_file(part);
    }
    let cause = format!("the file is complete but cannot become {}: {error}", path.display());
    Err(io::Error::new(error.kind(), cause))
}

/// Adds what the user can do about an error.
fn with_remedy(error: &io::Error) -> String {
    let remedy = match error.kind() {
        ErrorKind::StorageFull => Some("free space there, or record to another disk"),
        _ => remedy::of_write(error),
    };
    remedy.map_or_else(|| error.to_string(), |remedy| format!("{error}; {remedy}"))
}

/// Opens the file empty and locks it, so that no other recorder writes to it.
/// The remains of a recorder that died are overwritten, as the complete file
/// will be.
fn claim(part: &Path) -> io::Result<File> {
    let in_use = || {
        let message = format!("another recorder is writing {}", part.display());
        io::Error::new(io::ErrorKind::ResourceBusy, message)
    };
    let file = File::options().create(true).truncate(false).write(true).open(part)?;
    match file.try_lock() {
        Ok(()) => (),
        Err(TryLockError::WouldBlock) => return Err(in_use()),
        Err(TryLockError::Error(error)) => return Err(error),
    }
    // Another recorder may have renamed the file between opening and locking it.
    if fs::metadata(part)?.ino() != file.metadata()?.ino() {
        return Err(in_use());
    }
    file.set_len(0)?;
    Ok(file)
}
