//! What a controller process runs beside its loop: the control socket, and a
//! thread that handles SIGHUP and logs swaps and safe states.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::log;
use crate::Domain;
use crate::node_server::NodeServer;
use crate::server::ControlSocket;
use leg_process::Stop;
use leg_process::signals::{SighupAction, SighupListener};

/// Time between two rounds of the thread.
const ROUND: Duration = Duration::from_millis(10);

/// A file to read again at a SIGHUP.
#[derive(Debug)]
pub(super) struct Reload {
    pub(super) sighup: SighupListener,
    pub(super) policy: PathBuf,
}

/// The control socket and the thread; they end when dropped.
#[derive(Debug)]
pub(super) struct Background {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    _socket: Option<ControlSocket>,
}

impl Background {
    /// Opens the control socket of the controller in `domain`, and starts the
    /// thread. Without them the loop runs all the same, after a warning.
    pub(super) fn open(
        domain: &Arc<Domain>,
        server: &Arc<Mutex<NodeServer>>,
        reload: Option<Reload>,
        stop: &Stop,
    ) -> Self {
        let server = Arc::clone(server);
        let socket = ControlSocket::open(domain, Arc::clone(&server))
            .inspect_err(|cause| {
                log(format_args!("warning: no control socket, so no swap and no status: {cause}"));
            })
            .ok();
        let end = Arc::new(AtomicBool::new(false));
        let (ends, stop) = (Arc::clone(&end), stop.clone());
        let work = move || {
            while !ends.load(Ordering::Relaxed) {
                if let Some(reload) = &reload {
                    reload.look(&server, &stop);
                }
                // The lock is released before anything is printed.
                let (news, safe_state) = {
                    let mut server = lock(&server);
                    (server.news(), server.safe_state())
                };
                for message in news.into_iter().chain(safe_state) {
                    log(message);
                }
                std::thread::park_timeout(ROUND);
            }
        };
        let thread = std::thread::Builder::new().name("thread".into()).spawn(work);
        let thread = thread
            .inspect_err(|cause| {
                log(format_args!("warning: SIGHUP is ignored: {cause}"));
            })
            .ok();
        Self { end, thread, _socket: socket }
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

impl Reload {
    fn look(&self, server: &Mutex<NodeServer>, stop: &Stop) {
        match self.sighup.take() {
            None => (),
            Some(SighupAction::TerminalClosed) => stop.raise(),
            Some(SighupAction::Reload) => {
                let swapped = lock(server).swap_file(&self.policy);
                match swapped {
                    Ok(policy) => log(format_args!(
                        "{} is read again: the policy {} ({}) takes over at the next apex",
                        policy.file, policy.name, policy.crc32
                    )),
                    Err(why) => log(why),
                }
            }
        }
    }
}

pub(super) fn lock(server: &Mutex<NodeServer>) -> MutexGuard<'_, NodeServer> {
    server.lock().unwrap_or_else(PoisonError::into_inner)
}
