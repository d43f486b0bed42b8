//! The names of the shared memory of one leg and one controller.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::domain::{Domain, DomainError, io_error, objects, paths_in};

/// Name of the folder of a session, without the random number that follows.
const FOLDER_PREFIX: &str = "session-";

/// The names of the shared memory of one leg and one controller.
///
/// They contain a random number, so no session meets what another left behind.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Session {
    /// What the names of its shared memory start with.
    pub prefix: String,
    /// The folder of its files.
    pub folder: PathBuf,
}

impl Session {
    /// Removes what is left of earlier sessions and creates the folder of another. Only the
    /// holder of the controller's role may call this: it has left those sessions.
    pub(crate) fn begin(domain: &Domain) -> Result<Self, DomainError> {
        for earlier in sessions(domain.root(), domain.prefix()) {
            let _ = fs::remove_dir_all(&earlier.folder);
            objects(&earlier.prefix).for_each(|path| drop(fs::remove_file(path)));
        }
        let mut random = [0; 8];
        rustix::rand::getrandom(&mut random, rustix::rand::GetRandomFlags::empty())
            .map_err(|cause| io_error("name a session in", domain.root())(cause.into()))?;
        let session = Self::named(
            domain.root(),
            domain.prefix(),
            &format!("{:016x}", u64::from_ne_bytes(random)),
        );
        fs::create_dir(&session.folder)
            .map_err(|cause| io_error("create the folder", &session.folder)(cause))?;
        Ok(session)
    }

    /// Returns the session that takes place, or last took place, in a domain.
    pub(crate) fn current(domain: &Domain) -> Option<Self> {
        Self::in_folder(domain.root(), domain.prefix())
    }

    /// Returns the same of the domain with this folder and prefix.
    pub(super) fn in_folder(root: &Path, prefix: &str) -> Option<Self> {
        sessions(root, prefix).next()
    }

    /// Returns whether its names are those of a session in `domain`.
    pub(crate) fn is_in(&self, domain: &Domain) -> bool {
        self.prefix.starts_with(domain.prefix())
            && self.folder.parent() == Some(domain.root())
            && self.folder.is_dir()
    }

    fn named(root: &Path, prefix: &str, id: &str) -> Self {
        let folder = root.join(format!("{FOLDER_PREFIX}{id}"));
        Self { prefix: format!("{prefix}{id}."), folder }
    }
}

fn sessions(root: &Path, prefix: &str) -> impl Iterator<Item = Session> {
    paths_in(root).filter_map(move |path| {
        let id = path.file_name()?.to_str()?.strip_prefix(FOLDER_PREFIX)?.to_owned();
        Some(Session::named(root, prefix, &id))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_session_replaces_the_one_before_and_touches_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let domain = Domain::join_in(dir.path(), "d").unwrap();
        assert_eq!(Session::current(&domain), None);
        let memory = |prefix: &str| PathBuf::from(format!("/dev/shm/{prefix}memory"));
        let first = Session::begin(&domain).unwrap();
        assert_eq!(Session::current(&domain).as_ref(), Some(&first));
        fs::write(memory(&first.prefix), "").unwrap();
        fs::write(memory(domain.prefix()), "").unwrap();
        fs::write(domain.root().join("leg.role"), "").unwrap();
        let second = Session::begin(&domain).unwrap();
        assert_ne!(first, second);
        assert_eq!(Session::current(&domain).as_ref(), Some(&second));
        assert!(second.is_in(&domain) && !first.is_in(&domain), "it is not there any more");
        let elsewhere = Session { folder: dir.path().to_owned(), ..second.clone() };
        assert!(!elsewhere.is_in(&domain));
        assert!(!Session { prefix: "iox2_".to_owned(), ..second.clone() }.is_in(&domain));
        assert!(!memory(&first.prefix).exists() && !first.folder.exists());
        assert!(memory(domain.prefix()).exists() && domain.root().join("leg.role").exists());
    }
}
