//! Output files that would replace an input, or another output.

use std::fs;
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Checks that the file at `output`, which a program is to write, is none of `others`, which it
/// reads or writes, too: by another name or through a link, either. A device or a pipe may be
/// several of them.
///
/// # Errors
/// [`ErrorKind::InvalidInput`], with the other file's name, which
/// [`is_wrong_path`](crate::remedy::is_wrong_path) counts as the caller's mistake.
pub fn check_apart<'a>(
    output: &Path,
    others: impl IntoIterator<Item = &'a Path>,
) -> io::Result<()> {
    let Some(other) = others.into_iter().find(|other| is_same(output, other)) else {
        return Ok(());
    };
    let other = other.display();
    let what = format!("it is the same file as {other}, which is needed, too; choose another one");
    Err(io::Error::new(ErrorKind::InvalidInput, what))
}

fn is_same(a: &Path, b: &Path) -> bool {
    match (fs::metadata(a), fs::metadata(b)) {
        (Ok(a), Ok(b)) => a.is_file() && (a.dev(), a.ino()) == (b.dev(), b.ino()),
        (Err(_), Err(_)) => place(a) == place(b),
        _ => false,
    }
}

/// Returns the path of a file that does not exist, by its real folder.
fn place(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let real = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    path.file_name().map_or_else(|| real.clone(), |name| real.join(name))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;
    use crate::remedy::is_wrong_path;

    #[test]
    fn refuses_a_file_that_is_needed_by_whatever_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("log"), "rows").unwrap();
        fs::write(at("other"), "rows").unwrap();
        fs::create_dir(at("sub")).unwrap();
        symlink("log", at("link")).unwrap();
        let refused = |output: &str, other: &str| {
            check_apart(&at(output), [at("other").as_path(), &at(other)]).unwrap_err()
        };
        for name in ["log", "link", "sub/../log", "./log"] {
            let error = refused(name, "log");
            assert!(is_wrong_path(&error), "{name}: {error}");
            assert!(error.to_string().contains("log, which is needed"), "{error}");
            refused("log", name);
        }
        // Neither of two outputs exists yet.
        refused("new", "sub/../new");
        check_apart(&at("new"), [at("log").as_path(), &at("sub/new")]).unwrap();
        check_apart(Path::new("/dev/null"), [Path::new("/dev/null")]).unwrap();
    }
}
