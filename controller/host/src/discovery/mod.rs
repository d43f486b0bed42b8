//! How the processes of a session find each other on one machine.
//!
//! A [`Domain`] is the namespace of one leg and one controller: a folder and a
//! prefix of shared-memory names. Within it, each [`Role`](crate::link::Role) is
//! held by at most one process, by a lock on a file that also publishes the
//! process's [`SessionParams`](crate::link::SessionParams).

mod domain;
mod elsewhere;
mod role_lock;
mod room;
mod unfinished;

pub use domain::{DEFAULT_DOMAIN, Domain, DomainError, MAX_NAME};
pub use elsewhere::Whereabouts;
pub(crate) use role_lock::{
    Presence, RoleFile, RoleLock, RoleLockError, RoleRecord, Tenure, presence_in,
};
pub use room::NoRoom;
