//! How the processes of a session find each other on one machine.
//!
//! A [`Domain`] is the namespace of one leg and one controller: a folder and a
//! prefix of shared-memory names. Within it, each [`Role`](crate::link::Role) is
//! held by at most one process, by a lock on a file. The controller creates the memory of
//! each [`Session`] with a leg under a name that was never used before.

mod domain;
mod elsewhere;
mod role_lock;
mod room;
mod session;
mod unfinished;

pub use domain::{DEFAULT_DOMAIN, Domain, DomainError, MAX_NAME};
pub use elsewhere::Whereabouts;
pub use role_lock::Holder;
pub(crate) use role_lock::{RoleLock, holder};
pub use room::NoRoom;
pub use session::Session;
