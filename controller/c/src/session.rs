//! The leg's end of a session with the program `controller`.

use std::ffi::{CStr, c_char};
use std::mem::MaybeUninit;
use std::time::{Duration, Instant};

use leg_control::wire::{Command, Sample};
use leg_host::discovery::DEFAULT_DOMAIN;
use leg_host::shm::ShmLeg;
use leg_host::{Domain, Link, LinkError, SessionParams, TimeMode};
use leg_process::Stop;

use crate::messages::{LegCommand, LegSample};

/// A session in which this process plays the leg.
#[derive(Debug)]
pub struct LegSession {
    link: ShmLeg,
}

/// Longest wait, s; a longer one, or one that is no number, counts as this.
const MAX_WAIT_S: f64 = 86_400.0;

fn wait(timeout_s: f64) -> Duration {
    let is_in_range = (0.0..=MAX_WAIT_S).contains(&timeout_s);
    let most = if timeout_s < 0.0 { 0.0 } else { MAX_WAIT_S };
    Duration::from_secs_f64(if is_in_range { timeout_s } else { most })
}

/// Writes a reason, cut to `len` bytes with its 0.
///
/// # Safety
/// `reason` is null or points to `len` bytes.
unsafe fn state_reason(text: &str, reason: *mut c_char, len: usize) {
    if reason.is_null() || len == 0 {
        return;
    }
    let mut end = text.len().min(len - 1);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    // SAFETY: by contract, and `end` is less than `len`.
    unsafe {
        std::ptr::copy_nonoverlapping(text.as_ptr().cast(), reason, end);
        reason.add(end).write(0);
    }
}

/// Joins a domain as the leg and waits for a controller, at most for `timeout_s` seconds. A null
/// `domain` is the usual one. Both sides must agree on rate, gravity and mode: in lock-step, or
/// by the clock where `is_real_time`. Returns null where that fails, and writes why into
/// `reason`, of `reason_len` bytes, unless it is null.
///
/// # Safety
/// `domain` is null or a string that ends with 0, `reason` is null or points to `reason_len`
/// bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn leg_join(
    domain: *const c_char,
    rate_hz: u32,
    gravity_m_s2: f32,
    is_real_time: bool,
    timeout_s: f64,
    reason: *mut c_char,
    reason_len: usize,
) -> *mut LegSession {
    let name = if domain.is_null() {
        DEFAULT_DOMAIN.into()
    } else {
        // SAFETY: by contract.
        unsafe { CStr::from_ptr(domain) }.to_string_lossy()
    };
    let mode = if is_real_time { TimeMode::RealTime } else { TimeMode::LockStep };
    let params = SessionParams::at(rate_hz).with_gravity(gravity_m_s2).with_time_mode(mode);
    let link = Domain::join(&name).map_err(|cause| cause.to_string()).and_then(|domain| {
        ShmLeg::connect(&domain, params, wait(timeout_s), &Stop::default())
            .map_err(|cause| cause.to_string())
    });
    match link {
        Ok(link) => Box::into_raw(Box::new(LegSession { link })),
        Err(cause) => {
            // SAFETY: by contract.
            unsafe { state_reason(&cause, reason, reason_len) };
            std::ptr::null_mut()
        }
    }
}

/// Sends a sample; it never waits. Returns 0, or -1 where the session is over.
///
/// # Safety
/// `session` is one of `leg_join` that was not left, `sample` points to a sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn leg_send(session: *mut LegSession, sample: *const LegSample) -> i32 {
    // SAFETY: by contract.
    let (session, sample) = unsafe { (&mut *session, bytemuck::cast::<_, Sample>(*sample)) };
    session.link.send(&sample).map_or(-1, |()| 0)
}

/// Receives the newest command, if one comes within `timeout_s` seconds; with 0 it does not wait.
/// Returns 1 with a command, 0 without one, -1 where the controller is gone.
///
/// # Safety
/// `session` is one of `leg_join` that was not left, `command` points to a command, which need
/// not be initialised.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn leg_receive(
    session: *mut LegSession,
    timeout_s: f64,
    command: *mut MaybeUninit<LegCommand>,
) -> i32 {
    // SAFETY: by contract.
    let session = unsafe { &mut *session };
    // SAFETY: by contract.
    unsafe { answer(&session.link.receive(wait(timeout_s)), command) }
}

/// Sends a sample and waits for the command that answers it, at most for `timeout_s` seconds: a
/// tick in lock-step. Returns 1 with a command, 0 without one, -1 where the controller is gone.
///
/// # Safety
/// As of `leg_send` and `leg_receive`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn leg_exchange(
    session: *mut LegSession,
    sample: *const LegSample,
    timeout_s: f64,
    command: *mut MaybeUninit<LegCommand>,
) -> i32 {
    // SAFETY: by contract.
    let (session, sample) = unsafe { (&mut *session, bytemuck::cast::<_, Sample>(*sample)) };
    let (timeout, start) = (wait(timeout_s), Instant::now());
    let mut exchange = || {
        session.link.send(&sample)?;
        loop {
            let left = timeout.saturating_sub(start.elapsed());
            let received = session.link.receive(left)?;
            let answers = |command: &Command| {
                let (theirs, ours) = (command.header, sample.header);
                (theirs.version, theirs.run_id, theirs.seq) == (ours.version, ours.run_id, ours.seq)
            };
            if received.is_none_or(|command| answers(&command)) {
                return Ok(received);
            }
        }
    };
    // SAFETY: by contract.
    unsafe { answer(&exchange(), command) }
}

/// # Safety
/// `command` points to a command, which need not be initialised.
unsafe fn answer(
    received: &Result<Option<Command>, LinkError>,
    command: *mut MaybeUninit<LegCommand>,
) -> i32 {
    match received {
        Ok(None) => 0,
        Err(_) => -1,
        Ok(Some(received)) => {
            // SAFETY: by contract.
            unsafe { (*command).write(bytemuck::cast(*received)) };
            1
        }
    }
}

/// Leaves a session in good order. Null is permitted.
///
/// # Safety
/// `session` is null, or one of `leg_join` that was not left.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn leg_leave(session: *mut LegSession) {
    if !session.is_null() {
        // SAFETY: by contract.
        drop(unsafe { Box::from_raw(session) });
    }
}
