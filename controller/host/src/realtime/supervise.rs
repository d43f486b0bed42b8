//! Supervising the peer of a real-time loop.

use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use leg_process::Stop;

use crate::link::LinkError;
use crate::shm::{ConnectError, Message, PeerEvent, ShmLink};

/// How the peer was lost whose absence has ended the loop; empty until then.
pub type LostPeer = Arc<OnceLock<LinkError>>;

/// Returns the function that the supervisor of `link`'s loop must call periodically.
///
/// It updates the peer's state and calls `on_event` with each change. With a
/// `timeout`, a peer that is gone for longer ends the loop by `stop` and is stored in
/// the returned cell.
pub fn supervise_peer<Out: Message, In: Message, F: FnMut(&PeerEvent) + Send>(
    link: &ShmLink<Out, In>,
    stop: &Stop,
    timeout: Option<Duration>,
    mut on_event: F,
) -> (LostPeer, impl FnMut() + Send + use<Out, In, F>) {
    let lost_peer = LostPeer::default();
    let (monitor, stop, result) = (link.monitor(), stop.clone(), Arc::clone(&lost_peer));
    let mut lost: Option<(Instant, LinkError)> = None;
    let supervise = move || {
        match monitor.update() {
            Ok(Some(event)) => {
                on_event(&event);
                match event {
                    PeerEvent::Lost(cause) => lost = Some((Instant::now(), cause)),
                    PeerEvent::Connected(_) => lost = None,
                    PeerEvent::Rejected(_) | PeerEvent::Failed(_) => (),
                }
            }
            // No peer is connected, and none can connect any more.
            Err(error) => {
                let _ = result.set(ConnectError::from(error).into());
                stop.raise();
            }
            Ok(None) => (),
        }
        if let (Some((since, cause)), Some(timeout)) = (&lost, timeout)
            && since.elapsed() >= timeout
        {
            let _ = result.set(cause.clone());
            stop.raise();
        }
    };
    (lost_peer, supervise)
}
