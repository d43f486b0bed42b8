//! Uploads that are cut off, damaged, and complete, while the leg hops on.

use leg_control::policy::{Policy, SHIPPED};
use leg_control::serial::message::{MAX_CHUNK, Mode, Reply, Request, RequestError};
use leg_control::wire::{Command, Sample};
use leg_host::serial::client::{Client, ClientError, Received};
use leg_host::{Link, LinkError};
use sim_host::scenario::{Scenario, Settings};
use sim_host::session::Ending;
use sim_host::session::lock_step::{self, Options};
use std::time::Duration;

use crate::board::{Flashed, RATE_HZ, shipped, skips, ticks};
use crate::policies::sibling;

fn running(client: &mut Client) -> u32 {
    let who = client.identify(Duration::from_secs(10)).expect("an answer");
    who.policy.expect("a policy runs").crc32
}

fn crc32(blob: &[u8]) -> u32 {
    Policy::parse(blob).expect("a policy").crc32()
}

fn begin(client: &mut Client, blob: &[u8]) -> Result<(), ClientError> {
    client.have_done(&Request::Begin { length: blob.len() as u32, crc32: crc32(blob), origin: "" })
}

fn chunks(blob: &[u8]) -> impl Iterator<Item = Request<'_>> {
    blob.chunks(MAX_CHUNK).enumerate().map(|(index, bytes)| {
        let offset = (index * MAX_CHUNK) as u32;
        Request::Chunk { offset, bytes }
    })
}

#[test]
fn an_upload_cut_at_any_chunk_leaves_the_policy_running() {
    if skips() {
        return;
    }
    let mut flashed = Flashed::start(Some(&shipped()));
    let (blob, old) = (sibling(), crc32(SHIPPED));
    let count = chunks(blob).count();
    // All of them in the long version.
    let step = if ticks(0) > 0 { 1 } else { 9 };
    for cut in (0..count).step_by(step) {
        begin(&mut flashed.client, blob).unwrap();
        for chunk in chunks(blob).take(cut) {
            flashed.client.have_done(&chunk).unwrap();
        }
        for request in [Request::Verify, Request::Commit] {
            let refused = flashed.client.have_done(&request);
            assert!(
                matches!(refused, Err(ClientError::Refused(RequestError::Incomplete { .. }))),
                "cut at {cut}: {refused:?}"
            );
        }
        assert_eq!(running(&mut flashed.client), old, "cut at {cut}");
    }
}

#[test]
fn an_upload_with_any_byte_flipped_leaves_the_policy_running() {
    if skips() {
        return;
    }
    let mut flashed = Flashed::start(Some(&shipped()));
    let old = crc32(SHIPPED);
    let step = if ticks(0) > 0 { 67 } else { 1_999 };
    for at in (0..sibling().len()).step_by(step) {
        let mut blob = sibling().to_vec();
        blob[at] ^= 1 << (at % 8);
        let announced =
            Request::Begin { length: blob.len() as u32, crc32: crc32(sibling()), origin: "" };
        flashed.client.have_done(&announced).unwrap();
        for chunk in chunks(&blob) {
            flashed.client.have_done(&chunk).unwrap();
        }
        for request in [Request::Verify, Request::Commit] {
            let refused = flashed.client.have_done(&request);
            assert!(
                matches!(refused, Err(ClientError::Refused(RequestError::Blob(_)))),
                "byte {at}: {refused:?}"
            );
        }
        assert_eq!(running(&mut flashed.client), old, "byte {at}");
    }
}

/// A leg's link to a controller that receives an upload between ticks, a request a tick.
struct Uploading<'f> {
    flashed: &'f mut Flashed,
    /// The requests to send, the last one first.
    script: Vec<Request<'static>>,
    blobs: [&'static [u8]; 2],
    uploads: u32,
    is_waiting: bool,
    reply: Option<Command>,
    seq: u32,
}

impl Uploading<'_> {
    fn next_request(&mut self) {
        if self.script.is_empty() {
            self.uploads += 1;
            let blob = self.blobs[self.uploads as usize % 2];
            let mut script =
                vec![Request::Begin { length: blob.len() as u32, crc32: crc32(blob), origin: "" }];
            script.extend(chunks(blob));
            script.extend([Request::Verify, Request::Commit]);
            script.reverse();
            self.script = script;
        }
        let request = self.script.last().expect("just filled");
        self.flashed.client.post_request(request);
        self.is_waiting = true;
    }

    fn handle_reply(&mut self) {
        self.is_waiting = false;
        match self.flashed.client.reply().expect("a reply") {
            Reply::Done => drop(self.script.pop()),
            // The last policy still waits for an apex: send the request again.
            Reply::Refused(RequestError::SwapPending) => (),
            other => panic!("{other:?} to {:?}", self.script.last()),
        }
    }
}

impl Link for Uploading<'_> {
    type Sends = Sample;
    type Receives = Command;

    fn send(&mut self, sample: &Sample) -> Result<(), LinkError> {
        if !self.is_waiting {
            self.next_request();
        }
        self.seq += 1;
        self.flashed.client.post_sample(self.seq, sample);
        self.reply = loop {
            match self.flashed.client.listen(Duration::from_secs(10)).expect("the line") {
                Received::Command { seq, command, .. } if seq == self.seq => break Some(command),
                Received::Reply => self.handle_reply(),
                Received::Nothing | Received::Command { .. } => (),
                Received::Alarm(alarm) => panic!("{alarm:?}"),
            }
        };
        Ok(())
    }

    fn receive(&mut self, _timeout: Duration) -> Result<Option<Command>, LinkError> {
        Ok(self.reply.take())
    }
}

#[test]
fn swaps_policies_while_the_leg_hops() {
    if skips() {
        return;
    }
    // An upload waits for the apex before it: about one a hop.
    let wanted = if ticks(0) > 0 { 100 } else { 6 };
    let settings = Settings {
        density_ratio: Some(0.3),
        set_point_m_s: Some(0.4),
        duration_s: Some(f64::from(wanted) * 2.0),
        ..Settings::default()
    };
    let scenario = Scenario::from_settings(&settings).expect("a scenario");
    let mut flashed = Flashed::start(Some(&shipped()));
    flashed.reset(Mode::LockStep);
    let mut link = Uploading {
        flashed: &mut flashed,
        script: Vec::new(),
        blobs: [SHIPPED, sibling()],
        uploads: 0,
        is_waiting: false,
        reply: None,
        seq: 0,
    };
    let outcome = lock_step::run(&scenario, &mut link, Options::default(), |_| ()).unwrap();
    let uploads = link.uploads;
    let there = flashed.status();
    println!("{uploads} uploads, {} hops in {} ticks; {there:?}", outcome.apexes, outcome.ticks);
    assert_eq!(outcome.ending, Ending::Duration, "the leg fell");
    assert_eq!(outcome.ticks, scenario.ticks());
    assert_eq!(there.run.counts.ticks, outcome.ticks + 1, "a tick was missed");
    assert!(
        uploads >= wanted && there.run.counts.swaps >= wanted - 1,
        "{uploads} uploads, {there:?}"
    );
    // Under the safe command only until the first apex.
    let start = scenario.ticks() / 10;
    assert!(outcome.safe_ticks < start, "{} safe ticks", outcome.safe_ticks);
    assert!(u64::from(RATE_HZ) < outcome.ticks);
}
