use std::ffi::OsStr;
use std::io::{Read, Write};
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::mpsc::channel;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use super::super::stream::{Endpoint, USUAL_BAUD, over_device};
use super::super::upload::upload;
use super::super::{Client, VirtualBoard};
use super::*;
use crate::flash::MemoryFlash;
use leg_control::policy::SHIPPED;
use leg_control::serial::message::Slot;
use leg_process::Stop;
use leg_process::policy_file::PolicyFile;

const LONG: Duration = Duration::from_secs(10);
const SHORT: Duration = Duration::from_millis(5);

/// Returns the master of a new pseudo-terminal and the path of its other end.
fn terminal() -> (File, PathBuf) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap();
    (File::from(master), PathBuf::from(OsStr::from_bytes(path.as_bytes())))
}

fn serial(path: &Path) -> Endpoint {
    Endpoint::Serial { path: path.to_owned(), baud: USUAL_BAUD }
}

fn open_raw(path: &Path) -> File {
    File::options().read(true).write(true).open(path).unwrap()
}

#[test]
fn carries_every_byte_of_an_upload_unchanged() {
    let (master, path) = terminal();
    let (end, ended) = channel::<()>();
    let board = std::thread::spawn(move || {
        let flash = MemoryFlash::new().loaded(Slot::A, SHIPPED);
        let go_on = || ended.try_recv().is_err();
        VirtualBoard::power_up(flash).serve(&mut *over_device(master).unwrap(), go_on)
    });
    let mut client = Client::new(serial(&path).open().unwrap(), &Stop::default());
    let blob = PolicyFile::load(None).unwrap();
    let policy = blob.policy().unwrap();
    let done = upload(&mut client, &policy, blob.as_slice(), "a file", LONG, |_| ()).unwrap();
    assert!(done.swapped_after.is_some());
    end.send(()).unwrap();
    board.join().unwrap().unwrap();
}

#[test]
fn refuses_a_port_that_another_program_has_open_and_names_that_program() {
    let (_master, path) = terminal();
    // `sleep` inherits the port as its standard input.
    let port = open_raw(&path);
    let mut other = Command::new("sleep").arg("60").stdin(Stdio::from(port)).spawn().unwrap();
    let name = format!("sleep (process {})", other.id());
    let first = serial(&path).open().unwrap();
    assert_eq!(other_users(&path), [name.as_str()]);
    let error = serial(&path).open().map(|_| ()).unwrap_err().to_string();
    assert!(error.contains(&format!("{name} has the port open: end it")), "{error}");
    let mut client = Client::new(first, &Stop::default());
    let silent = client.identify(SHORT).unwrap_err().to_string();
    assert!(silent.contains(&format!("{name} has the port open, too")), "{silent}");
    other.kill().unwrap();
    other.wait().unwrap();
    assert!(other_users(&path).is_empty());
    drop(client);
    serial(&path).open().unwrap();
}

/// `poll` reports bytes, the other program reads them, and a blocking read would wait for ever.
#[test]
fn a_read_returns_in_time_while_another_program_reads_the_same_bytes() {
    let (mut master, path) = terminal();
    let mut stream = serial(&path).open().unwrap();
    let mut others = open_raw(&path);
    let (done, is_done) = channel();
    let reading = std::thread::spawn(move || {
        let mut byte = [0];
        let mut count = 0;
        while others.read(&mut byte).is_ok_and(|n| n > 0 && byte != *b"q") {
            count += 1;
        }
        count
    });
    std::thread::spawn(move || {
        let mut byte = [0];
        for _ in 0..3_000 {
            let result = stream.read(&mut byte, SHORT);
            if done.send(result.map(|_| ())).is_err() {
                break;
            }
        }
    });
    let mut reads = 0;
    while let Ok(result) = {
        master.write_all(b"x").unwrap();
        is_done.recv_timeout(LONG)
    } {
        result.unwrap();
        reads += 1;
    }
    assert_eq!(reads, 3_000, "a read has not returned for {LONG:?}");
    while !reading.is_finished() {
        master.write_all(b"q").unwrap();
        std::thread::sleep(SHORT);
    }
    assert!(reading.join().unwrap() > 0, "the other program has read some of them");
}

#[test]
fn reports_settings_that_another_program_has_changed_and_sets_them_again_when_reopened() {
    let (mut master, path) = terminal();
    let mut bytes = [0; 8];
    for change in [
        |settings: &mut Termios| settings.local_modes |= rustix::termios::LocalModes::ICANON,
        |settings: &mut Termios| settings.local_modes |= rustix::termios::LocalModes::ECHO,
        |settings: &mut Termios| settings.special_codes[SpecialCodeIndex::VMIN] = 0,
        |settings: &mut Termios| settings.set_speed(9_600).unwrap(),
    ] {
        let mut stream = serial(&path).open().unwrap();
        let other = open_raw(&path);
        let mut settings = tcgetattr(&other).unwrap();
        change(&mut settings);
        tcsetattr(&other, OptionalActions::Now, &settings).unwrap();
        let begun = Instant::now();
        let error = loop {
            assert!(begun.elapsed() < LONG, "the change is not noticed");
            if let Err(error) = stream.read(&mut bytes, SHORT) {
                break error;
            }
        };
        assert_eq!(error.to_string(), "another program has changed the settings of the port");
        drop(stream);
        let mut stream = serial(&path).open().unwrap();
        master.write_all(b"\n\r\x04").unwrap();
        let mut read = 0;
        while read < 3 {
            read += stream.read(&mut bytes[read..], LONG).unwrap();
        }
        assert_eq!(&bytes[..3], b"\n\r\x04", "raw again");
    }
}

#[test]
fn a_port_whose_other_end_is_gone_has_ended() {
    let (master, path) = terminal();
    let mut stream = serial(&path).open().unwrap();
    drop(master);
    let begun = Instant::now();
    let read = loop {
        assert!(begun.elapsed() < LONG);
        if let Err(error) = stream.read(&mut [0; 8], SHORT) {
            break error;
        }
    };
    assert!(is_end(&read), "{read}");
    let written = stream.write_all(b"x").unwrap_err();
    assert!(is_end(&written), "{written}");
}
