//! The recorder: a process of its own, so that a run that is killed leaves a
//! file that is whole.
//!
//! It reads frames until the pipe ends, for whatever reason, then writes the
//! file's index and gives the file its name. Signals to the run, or to its
//! terminal, are not for it: it leaves the run's session and does not stop when
//! asked to, for it ends by itself with the run.

use std::fs::{self, File, TryLockError};
use std::io::{self, BufReader, BufWriter, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use mcap::WriteOptions;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use super::pipe::{self, Incoming};
use super::schema::{Channel, DESCRIPTORS, PROFILE};

/// Messages are lost by the chunk when the machine loses its power.
const CHUNK: u64 = 1 << 18;
const BUFFER: usize = 1 << 18;

/// What it says when it can begin.
pub(super) const READY: &str = "ready";
/// What it says, before a number of messages, when the file is in its place.
pub(super) const DONE: &str = "done ";
/// What it says before what went wrong.
pub(super) const FAILED: &str = "failed ";

/// Where a recording is until it is finished.
pub(super) fn part(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

/// The recorder, from its stdin to the file at `path`. It says on its stdout
/// when it is ready, and how it ended.
#[must_use]
pub fn main(path: &Path) -> ExitCode {
    let said = |line: &str| {
        // The run may be gone: then there is nobody to tell.
        let mut out = io::stdout();
        let _ = out.write_all(format!("{line}\n").as_bytes()).and_then(|()| out.flush());
    };
    match apart().and_then(|()| record(path, || said(READY))) {
        Ok(messages) => {
            said(&format!("{DONE}{messages}"));
            ExitCode::SUCCESS
        }
        Err(error) => {
            said(&format!("{FAILED}{error}"));
            ExitCode::FAILURE
        }
    }
}

/// Out of the reach of signals that are for the run.
fn apart() -> io::Result<()> {
    // In a session of its own already when it leads one: then that is as good.
    let _ = rustix::process::setsid();
    for signal in [SIGHUP, SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::default())?;
    }
    Ok(())
}

fn record(path: &Path, ready: impl FnOnce()) -> io::Result<u64> {
    let part = part(path);
    let file = claim(&part)?;
    let mut writer = WriteOptions::new()
        .profile(PROFILE)
        .library(concat!("sim-host ", env!("CARGO_PKG_VERSION")))
        .compression(None)
        .chunk_size(Some(CHUNK))
        .disable_seeking(true)
        .create(NoSeek::new(BufWriter::with_capacity(BUFFER, &file)))
        .map_err(io::Error::other)?;
    let mut channels = Vec::new();
    for channel in Channel::ALL {
        let schema = writer
            .add_schema(channel.schema(), "protobuf", DESCRIPTORS)
            .map_err(io::Error::other)?;
        let id = writer
            .add_channel(schema, channel.topic(), "protobuf", &[].into())
            .map_err(io::Error::other)?;
        channels.push(id);
    }
    ready();

    let mut pipe = BufReader::with_capacity(BUFFER, io::stdin().lock());
    let (mut buffer, mut messages) = (Vec::new(), 0);
    // A pipe that breaks is the end of it as much as one that is closed.
    while let Ok(Some(frame)) = pipe::read(&mut pipe, &mut buffer) {
        match frame {
            Incoming::Message { channel, log_time_ns, sequence, message } => {
                let header = MessageHeader {
                    channel_id: channels[channel as usize],
                    sequence,
                    log_time: log_time_ns,
                    publish_time: log_time_ns,
                };
                writer.write_to_known_channel(&header, message).map_err(io::Error::other)?;
                messages += 1;
            }
            Incoming::Flush => writer.flush().map_err(io::Error::other)?,
        }
    }
    writer.finish().map_err(io::Error::other)?;
    writer.into_inner().into_inner().into_inner().map_err(io::IntoInnerError::into_error)?;
    file.sync_all()?;
    fs::rename(&part, path)?;
    Ok(messages)
}

/// The file to write to, empty, which no other recorder writes to. What a dead
/// one left there is overwritten, as the finished file will be.
fn claim(part: &Path) -> io::Result<File> {
    let in_use = || {
        let what = format!("another recorder is writing {}", part.display());
        io::Error::new(io::ErrorKind::ResourceBusy, what)
    };
    let file = File::options().create(true).truncate(false).write(true).open(part)?;
    match file.try_lock() {
        Ok(()) => (),
        Err(TryLockError::WouldBlock) => return Err(in_use()),
        Err(TryLockError::Error(error)) => return Err(error),
    }
    // Finished and renamed by another in this very moment?
    if fs::metadata(part)?.ino() != file.metadata()?.ino() {
        return Err(in_use());
    }
    file.set_len(0)?;
    Ok(file)
}
