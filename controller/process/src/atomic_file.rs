//! Output files that appear complete or not at all.

use std::fs::{self, File, Metadata};
use std::io::{self, BufWriter, ErrorKind, Read, Seek, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicU32, Ordering};

/// Numbers the temporary files of this process.
static NEXT: AtomicU32 = AtomicU32::new(0);
/// Prefix of the names of temporary files.
const TEMPORARY: &str = ".tmp";
/// What precedes the machine's name in them.
const AT: char = '@';
/// Bit of a folder's mode: only the owner of a file may replace it.
const STICKY: u32 = 0o1000;
/// `EPERM`, the error of a file that even its owner cannot change, such as an immutable one.
const NOT_PERMITTED: i32 = 1;
/// Largest number of symbolic links that are followed to a file that does not exist.
const MOST_LINKS: usize = 40;

/// A file that is written under a temporary name in the target's folder and
/// renamed by [`AtomicFile::finish`].
///
/// A reader sees either the old file or the complete new one. Dropping the value
/// before `finish` removes the temporary file.
///
/// Some files cannot be replaced: a bind mount (a single file that a container
/// mounts), a file in a folder that takes no new files, a device, a pipe. Their
/// content is collected in memory and written over the old one by `finish`; where
/// that fails, the old content is written back.
#[derive(Debug)]
pub struct AtomicFile {
    content: Content,
    path: PathBuf,
}

/// The content until it is complete.
#[derive(Debug)]
enum Content {
    /// In a temporary file, to be renamed.
    Temporary(BufWriter<File>, Temporary),
    /// In memory, to be written over the old content.
    Memory(Vec<u8>),
}

/// The path of a temporary file, which is removed on drop.
#[derive(Debug)]
struct Temporary(PathBuf);

impl Temporary {
    /// Creates a file under a name that nothing else in the folder has. It is as readable as
    /// any new file.
    fn create_in(folder: &Path) -> io::Result<(File, Self)> {
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let name = format!("{TEMPORARY}{}-{number}{AT}{}", process::id(), machine());
            let path = folder.join(name);
            match File::options().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => return Ok((file, Self(path))),
                // A process of the same id in another container, or one that was killed.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Leaves the file where it is and returns its path.
    fn keep(mut self) -> PathBuf {
        std::mem::take(&mut self.0)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // After the rename, or when the file is kept, there is nothing to remove.
        _ = fs::remove_file(&self.0);
    }
}

impl AtomicFile {
    /// Creates the temporary file. If `path` is a symbolic link, its target will be
    /// replaced.
    ///
    /// Whatever can be known about `finish` is checked here, so that a caller can find
    /// out before long work whether its result can be written.
    ///
    /// # Errors
    /// Returns the system's error when `path` is a folder, or neither its folder nor the
    /// file itself is writable. The message does not name the temporary file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let path = resolved(path);
        let old = fs::metadata(&path).ok();
        let in_memory = |path| Ok(Self { content: Content::Memory(Vec::new()), path });
        match &old {
            Some(old) if old.is_dir() => return Err(ErrorKind::IsADirectory.into()),
            Some(old) if !old.is_file() => return in_memory(path),
            Some(_) if is_mount_point(&path) => {
                open_for_writing(&path)?;
                return in_memory(path);
            }
            _ => {}
        }
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let (file, temporary) = match Temporary::create_in(folder) {
            Ok(created) => created,
            Err(error) => {
                let is_forbidden = matches!(
                    error.kind(),
                    ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem
                );
                if is_forbidden && old.is_some() && open_for_writing(&path).is_ok() {
                    return in_memory(path);
                }
                return Err(error);
            }
        };
        if let Some(old) = &old {
            if !may_replace(file.metadata()?.uid(), old, &fs::metadata(folder)?) {
                open_for_writing(&path)?;
                return in_memory(path);
            }
            match open_for_writing(&path) {
                Err(error) if error.raw_os_error() == Some(NOT_PERMITTED) => return Err(error),
                // A file without write permission can still be replaced.
                _ => {}
            }
        }
        Ok(Self { content: Content::Temporary(BufWriter::new(file), temporary), path })
    }

    /// Flushes the file to disk and gives it its final path.
    ///
    /// # Errors
    /// Returns the system's error; an existing file is then unchanged. If the complete
    /// content could be written, but not under its final path, it stays in the temporary
    /// file, which the message names.
    pub fn finish(self) -> io::Result<()> {
        let (file, temporary) = match self.content {
            Content::Temporary(file, temporary) => (file, temporary),
            Content::Memory(content) => return overwrite(&self.path, &content),
        };
        let mut file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.sync_all()?;
        let Err(error) = fs::rename(&temporary.0, &self.path) else { return Ok(()) };
        // The file may have become a mount point since, or be one that was not recognised.
        let mut content = Vec::new();
        let read = file.rewind().and_then(|()| file.read_to_end(&mut content));
        if self.path.is_file() && read.and_then(|_| overwrite(&self.path, &content)).is_ok() {
            return Ok(());
        }
        let kept = temporary.keep();
        let text = format!("{error}; the complete content is in {}", kept.display());
        Err(io::Error::new(error.kind(), text))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.content {
            Content::Temporary(file, _) => file.write(bytes),
            Content::Memory(content) => content.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.content {
            Content::Temporary(file, _) => file.flush(),
            Content::Memory(_) => Ok(()),
        }
    }
}

/// Writes `content` to `path` by an [`AtomicFile`].
///
/// # Errors
/// As [`AtomicFile::create`] and [`AtomicFile::finish`].
pub fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(content)?;
    file.finish()
}

/// Checks what can be known about whether [`write()`] to `path` will succeed, and leaves
/// nothing behind.
///
/// # Errors
/// As [`AtomicFile::create`].
pub fn check(path: &Path) -> io::Result<()> {
    AtomicFile::create(path).map(drop)
}

/// Removes the temporary files of this machine's processes from `folder`. The caller makes
/// sure, by a lock, that none of them is writing there: then these are of processes that
/// were killed. Those of other machines, which a lock may not reach, are left.
///
/// # Errors
/// Returns the system's error.
pub fn remove_abandoned(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let is_here = || name.split_once(AT).is_none_or(|(_, at)| at == machine());
        if name.starts_with(TEMPORARY) && is_here() {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Returns the name of this machine.
fn machine() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().replace('/', "_")
}

/// Follows symbolic links, also to a file that does not exist yet.
fn resolved(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..MOST_LINKS {
        if let Ok(canonical) = fs::canonicalize(&path) {
            return canonical;
        }
        // `/dev/stdout` may be a link to a pipe, which exists, but not under a path.
        match fs::read_link(&path) {
            Ok(target) if !path.exists() => {
                path = path.parent().unwrap_or(Path::new("")).join(target);
            }
            _ => break,
        }
    }
    path
}

fn open_for_writing(path: &Path) -> io::Result<File> {
    File::options().write(true).open(path)
}

/// Returns whether something is mounted on the canonical path `path`: a rename would
/// fail with "Device or resource busy".
fn is_mount_point(path: &Path) -> bool {
    let escaped: Vec<u8> = path.as_os_str().as_bytes().iter().fold(Vec::new(), |mut text, byte| {
        match byte {
            b' ' | b'\t' | b'\n' | b'\\' => text.extend(format!("\\{byte:03o}").bytes()),
            _ => text.push(*byte),
        }
        text
    });
    let mounts = fs::read("/proc/self/mountinfo").unwrap_or_default();
    mounts
        .split(|byte| *byte == b'\n')
        .filter_map(|line| line.split(|byte| *byte == b' ').nth(4))
        .any(|at| at == escaped)
}

/// Returns whether the user `me` may rename a file over `old` in `folder`.
fn may_replace(me: u32, old: &Metadata, folder: &Metadata) -> bool {
    me == 0 || folder.mode() & STICKY == 0 || [old.uid(), folder.uid()].contains(&me)
}

/// Writes `content` over that of an existing file. A regular file gets its old content
/// back where this fails.
fn overwrite(path: &Path, content: &[u8]) -> io::Result<()> {
    if !path.is_file() {
        return fs::write(path, content);
    }
    let old = fs::read(path);
    let mut file = open_for_writing(path)?;
    let mut replace = |content: &[u8]| {
        file.rewind()?;
        file.write_all(content)?;
        file.set_len(content.len() as u64)?;
        file.sync_all()
    };
    let Err(error) = replace(content) else { return Ok(()) };
    let restored = old.and_then(|old| replace(&old));
    Err(match restored {
        Ok(()) => error,
        Err(_) => io::Error::new(error.kind(), format!("{error}; its old content is lost")),
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt, symlink};
    use std::process::Command;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> =
            entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn an_unfinished_file_leaves_the_old_one_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        write(&path, b"old").unwrap();
        let mut unfinished = AtomicFile::create(&path).unwrap();
        unfinished.write_all(b"half of the new").unwrap();
        drop(unfinished);
        assert_eq!(fs::read(&path).unwrap(), b"old");
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
        assert!(write(folder.path(), b"a folder is no file").is_err());
        let error = write(&folder.path().join("no/such/folder"), b"").unwrap_err();
        assert_eq!(error.to_string(), "No such file or directory (os error 2)");
    }

    #[test]
    fn abandoned_files_of_this_machine_only_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (_, temporary) = Temporary::create_in(folder.path()).unwrap();
        let abandoned = temporary.keep();
        for name in ["file", ".tmp1-0@another-machine", ".tmp1-0"] {
            fs::write(at(name), "").unwrap();
        }
        remove_abandoned(folder.path()).unwrap();
        assert!(!abandoned.exists());
        assert_eq!(names(folder.path()), [".tmp1-0@another-machine", "file"]);
    }

    #[test]
    fn follows_a_link_to_a_file_that_does_not_exist_yet() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("runs")).unwrap();
        symlink("runs/7", at("latest")).unwrap();
        write(&at("latest"), b"seven").unwrap();
        assert!(at("latest").is_symlink());
        assert_eq!(fs::read(at("runs/7")).unwrap(), b"seven");
        assert_eq!(names(&at("runs")), ["7"]);
    }

    #[test]
    fn writes_to_a_device_directly() {
        write(Path::new("/dev/null"), b"nothing").unwrap();
        check(Path::new("/dev/null")).unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }

    #[test]
    fn a_failed_overwrite_restores_the_old_content() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "old content").unwrap();
        overwrite(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        // A device without room; a regular file on a full disk is restored the same way.
        let error = overwrite(Path::new("/dev/full"), b"x").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::StorageFull);
    }

    #[test]
    fn only_the_owner_replaces_a_file_in_a_sticky_folder() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let [old, plain] = [&file, folder.path()].map(|path| fs::metadata(path).unwrap());
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o1777)).unwrap();
        let sticky = fs::metadata(folder.path()).unwrap();
        let (owner, another) = (old.uid(), old.uid() + 1);
        assert!(may_replace(another, &old, &plain));
        assert!(!may_replace(another, &old, &sticky));
        assert!(may_replace(owner, &old, &sticky));
        assert!(may_replace(0, &old, &sticky));
    }

    fn mount(arguments: &[&str]) {
        assert!(Command::new("mount").args(arguments).status().unwrap().success(), "{arguments:?}");
    }

    #[test]
    fn writes_a_bind_mounted_file_in_place() {
        if !requirements::in_mount_namespace(
            "atomic_file::tests::writes_a_bind_mounted_file_in_place",
        ) {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let (outside, inside) = (at("out side"), at("in \\side"));
        fs::write(&outside, "a longer old content").unwrap();
        fs::write(&inside, "").unwrap();
        mount(&["--bind", &outside, &inside]);
        write(inside.as_ref(), b"new").unwrap();
        assert_eq!(fs::read(&outside).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["in \\side", "out side"]);
        // Mounted after the beginning.
        let (late, target) = (at("late"), at("target"));
        fs::write(&late, "old").unwrap();
        fs::write(&target, "old").unwrap();
        let mut file = AtomicFile::create(target.as_ref()).unwrap();
        file.write_all(b"complete").unwrap();
        mount(&["--bind", &late, &target]);
        file.finish().unwrap();
        assert_eq!(fs::read(&late).unwrap(), b"complete");
        // Read-only: found out before anything is written.
        mount(&["-o", "remount,ro,bind", &inside]);
        let error = check(inside.as_ref()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::ReadOnlyFilesystem);
        assert_eq!(names(folder.path()), ["in \\side", "late", "out side", "target"]);
    }

    #[test]
    fn a_full_disk_leaves_a_file_that_cannot_be_replaced_as_it_was() {
        if !requirements::in_mount_namespace(
            "atomic_file::tests::a_full_disk_leaves_a_file_that_cannot_be_replaced_as_it_was",
        ) {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_str().unwrap();
        mount(&["-t", "tmpfs", "-o", "size=16k", "tmpfs", path]);
        let file = folder.path().join("file");
        fs::write(&file, "old").unwrap();
        let large = vec![1; 100_000];
        let error = overwrite(&file, &large).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::StorageFull);
        assert_eq!(fs::read(&file).unwrap(), b"old");
        let error = write(&file, &large).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::StorageFull);
        assert_eq!(fs::read(&file).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["file"]);
    }
}
