//! Where a missing process may be instead: in another domain, or under another user.

use std::fmt;
use std::path::{Path, PathBuf};

use super::domain::{BASE_PREFIX, SHARED_MEMORY, check_name, has_orphans, paths_in};
use super::role_lock::{Holder, holder};
use crate::link::Role;

/// Where a process in a role was looked for, and where one may be instead.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Whereabouts {
    /// The folder of the domain in which it was looked for.
    pub folder: PathBuf,
    /// A process that has the role and has not answered.
    pub silent: Option<Holder>,
    /// Other domains of this user in which a process holds the role.
    pub domains: Vec<String>,
    /// Ids of other users who have, or had, domains on this machine. Processes of two
    /// users cannot connect.
    pub users: Vec<u32>,
    /// Whether there is shared memory of a folder of this domain that was removed.
    pub has_orphans: bool,
}

impl Whereabouts {
    /// Looks for processes in `role` outside the domain with this folder.
    #[must_use]
    pub fn of(role: Role, folder: &Path) -> Self {
        let (Some(base), Some(name)) = (folder.parent(), folder.file_name()) else {
            return Self::default();
        };
        let name = name.to_string_lossy();
        let mut domains: Vec<String> = names(base)
            .filter(|other| *other != name && check_name(other).is_ok())
            .filter(|other| matches!(holder(&base.join(other), role), Ok(Some(_))))
            .collect();
        domains.sort_unstable();
        let own = rustix::process::getuid().as_raw();
        let mut users: Vec<u32> = names(Path::new(SHARED_MEMORY))
            .filter_map(|name| name.strip_prefix(BASE_PREFIX)?.parse().ok())
            .filter(|user| *user != own)
            .collect();
        users.sort_unstable();
        let has_orphans = has_orphans(base, &name);
        let silent = holder(folder, role).ok().flatten();
        Self { folder: folder.to_owned(), silent, domains, users, has_orphans }
    }
}

/// Returns the names of the files and folders in a folder.
fn names(folder: &Path) -> impl Iterator<Item = String> {
    paths_in(folder).filter_map(|path| Some(path.file_name()?.to_str()?.to_owned()))
}

impl fmt::Display for Whereabouts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, " ({}", self.folder.display())?;
        if let Some(Holder { pid }) = self.silent {
            let process =
                pid.map_or_else(|| "a process".to_owned(), |pid| format!("process {pid}"));
            write!(
                f,
                "; {process} has the role but has not answered: is it stopped, or connected to another process?"
            )?;
        }
        if !self.domains.is_empty() {
            write!(f, "; one runs in the domain {}", self.domains.join(", "))?;
        }
        if !self.users.is_empty() {
            let users: Vec<_> = self.users.iter().map(ToString::to_string).collect();
            write!(
                f,
                "; user {} has domains here too, and processes of two users cannot connect: run both \
                 as one user",
                users.join(", ")
            )?;
        }
        if self.has_orphans {
            f.write_str(
                "; shared memory of an earlier folder of this domain is there: the folder was removed \
                 under a run, which nobody can connect to any more: end it",
            )?;
        }
        f.write_str(")")
    }
}
