//! What a running controller has beside its loop: office, desk, and a clerk
//! who looks after signals and says what has happened.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::say;
use crate::desk::Desk;
use crate::desk::requests::Request;
use crate::office::Office;
use crate::{Domain, Role};
use leg_process::Stop;
use leg_process::signals::{SighupAction, SighupListener};

/// Between two rounds of the clerk.
const ROUND: Duration = Duration::from_millis(10);

/// A file to read again at a SIGHUP.
#[derive(Debug)]
pub(super) struct Reload {
    pub(super) sighup: SighupListener,
    pub(super) policy: PathBuf,
}

/// All of it; ends when dropped.
#[derive(Debug)]
pub(super) struct Beside {
    end: Arc<AtomicBool>,
    clerk: Option<JoinHandle<()>>,
    _desk: Option<Desk>,
}

impl Beside {
    /// Opens the desk of the controller in `domain`, and sets the clerk to work.
    ///
    /// Without a desk or a clerk the loop runs all the same; that is said.
    pub(super) fn open(
        domain: &Arc<Domain>,
        office: Office,
        reload: Option<Reload>,
        stop: &Stop,
    ) -> Self {
        let office = Arc::new(Mutex::new(office));
        let at_desk = Arc::clone(&office);
        let desk = Desk::open(domain, Role::Controller, move |request: Request| {
            lock(&at_desk).answer(request)
        });
        let desk = desk
            .inspect_err(|cause| {
                say(format_args!("warning: no desk, so no swap and no status: {cause}"));
            })
            .ok();
        let end = Arc::new(AtomicBool::new(false));
        let (ends, stop) = (Arc::clone(&end), stop.clone());
        let work = move || {
            while !ends.load(Ordering::Relaxed) {
                if let Some(reload) = &reload {
                    reload.look(&office, &stop);
                }
                // The lock is not held while something is said.
                let news = lock(&office).news();
                if let Some(news) = news {
                    say(news);
                }
                std::thread::park_timeout(ROUND);
            }
        };
        let clerk = std::thread::Builder::new().name("clerk".into()).spawn(work);
        let clerk = clerk
            .inspect_err(|cause| {
                say(format_args!("warning: nobody looks after signals: {cause}"));
            })
            .ok();
        Self { end, clerk, _desk: desk }
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(clerk) = self.clerk.take() {
            clerk.thread().unpark();
            let _ = clerk.join();
        }
    }
}

impl Reload {
    fn look(&self, office: &Mutex<Office>, stop: &Stop) {
        match self.sighup.take() {
            None => (),
            Some(SighupAction::TerminalClosed) => stop.raise(),
            Some(SighupAction::Reload) => {
                let swapped = lock(office).swap_file(&self.policy);
                match swapped {
                    Ok(swapping) => say(format_args!(
                        "{} is read again: the policy {} ({}) takes over at the next apex",
                        swapping.policy.file, swapping.policy.name, swapping.policy.crc32
                    )),
                    Err(why) => say(why),
                }
            }
        }
    }
}

fn lock(office: &Mutex<Office>) -> MutexGuard<'_, Office> {
    office.lock().unwrap_or_else(PoisonError::into_inner)
}
