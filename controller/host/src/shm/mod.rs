//! Links between two processes over iceoryx2 shared memory.
//!
//! There is one publish-subscribe service per direction: one publisher, a buffer of one
//! message at leg and controller, no history, safe overflow. So the newest message wins and a
//! publisher never waits for a slow subscriber. Further subscribers, such as a live view, or a
//! recorder with a larger buffer, may read along.
//!
//! A receiver polls: in lock-step the peer replies within microseconds, and any
//! blocking wait of the system costs thirty to forty. If the peer is slow, the
//! receiver yields the core; it sleeps after a millisecond, and at once where yields cost
//! time slices of other busy processes. Where the peer wants wake-ups, it blocks on a socket.
//!
//! The two ends find each other, agree on the session's parameters and notice each
//! other's end by a Unix socket, as `SESSION.md` describes; the [`PeerMonitor`] handles that. Each session
//! has shared memory of its own, so nothing that a killed process leaves behind is met again.
//! The peer may go and another may connect while the link stays open. Sending, and receiving
//! without a wait, only access the queues.

mod error;
mod hello;
pub mod layout;
mod link;
mod observer;
mod payload;
mod peer_monitor;
mod recorder;
mod service;
#[cfg(test)]
mod tests;
mod wake;

pub use error::{ConnectError, Half, MissingPeer, Parameter};
pub(crate) use hello::{SESSION_VERSION, socket_in};
pub use link::{ShmController, ShmLeg, ShmLink};
pub use observer::{Observer, Participants};
pub use payload::{Message, Payload};
pub use peer_monitor::{PeerEvent, PeerMonitor};
pub use recorder::Registration;
pub use service::{Attributes, config};
