//! How the processes of a session find each other on one machine.
//!
//! A [`Domain`] is the namespace of one leg and one controller: a folder and a
//! prefix of shared-memory names. Within it, each [`Role`](crate::link::Role) is
//! held by at most one process, by a lock on a file that also publishes the
//! process's [`SessionParams`](crate::link::SessionParams).

mod domain;
mod role_lock;

pub use domain::{DEFAULT_DOMAIN, Domain, DomainError, MAX_NAME, other_users, other_users_note};
pub(crate) use role_lock::{Presence, RoleLock, RoleLockError, RoleRecord, presence, presence_in};
