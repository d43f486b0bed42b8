//! Names and places of the files of a training.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path, PathBuf};

/// Ending of the names of policy files.
const POLICY: &str = ".bin";
/// Ending of the names of logs.
const LOG: &str = ".csv";

/// Appends a suffix to a path.
pub(super) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(suffix);
    name.into()
}

/// Returns a path without a suffix of its file name; `None` where it has another ending.
fn without_suffix(path: &Path, suffix: &str) -> Option<PathBuf> {
    let name = path.file_name()?.as_bytes().strip_suffix(suffix.as_bytes())?;
    (!name.is_empty()).then(|| path.with_file_name(OsStr::from_bytes(name)))
}

/// Endings of the names of files that this trainer reads.
const KNOWN: [&str; 5] = [POLICY, LOG, ".safetensors", ".onnx", ".json"];

/// Returns the name of a policy, a log or an actor without folder and ending, whatever other
/// dots are in it.
#[must_use]
pub fn title(path: &Path) -> OsString {
    let plain = KNOWN.iter().find_map(|ending| without_suffix(path, ending));
    plain.as_deref().unwrap_or(path).file_name().unwrap_or(path.as_os_str()).to_owned()
}

/// Returns the usual path of the log of the policy file `out`: `X.csv` for `X.bin` and for
/// any other `X`, whatever dots are in it.
#[must_use]
pub fn usual_log(out: &Path) -> PathBuf {
    with_suffix(without_suffix(out, POLICY).as_deref().unwrap_or(out), LOG)
}

/// Returns the one other policy file with the same [`usual_log`]: `X` for `X.bin`, and the
/// other way round.
#[must_use]
pub fn other_policy(out: &Path) -> PathBuf {
    without_suffix(out, POLICY).unwrap_or_else(|| with_suffix(out, POLICY))
}

/// Returns the folder of a file.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Returns the canonical path of a file, whether or not it exists.
#[must_use]
pub fn place(path: &Path) -> PathBuf {
    let in_folder = || Some(folder_of(path).canonicalize().ok()?.join(path.file_name()?));
    path.canonicalize().ok().or_else(in_folder).unwrap_or_else(|| path.to_owned())
}

/// Returns the path of the log as a checkpoint beside `out` states it: as seen from its
/// folder, so that it stays right when both are moved; an absolute path stays.
pub(super) fn hint(log: &Path, out: &Path) -> PathBuf {
    let folders = [folder_of(log), folder_of(out)].map(Path::canonicalize);
    let ([Ok(to), Ok(from)], Some(name)) = (folders, log.file_name()) else { return log.into() };
    if log.is_absolute() {
        return log.into();
    }
    let common = to.components().zip(from.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(common).map(|_| Component::ParentDir);
    up.chain(to.components().skip(common)).collect::<PathBuf>().join(name)
}

/// Returns where the log of the checkpoint beside `out` may be, given its hint. Files
/// beside the checkpoint come first, so that a copied folder is complete in itself.
#[must_use]
pub fn log_candidates(out: &Path, hint: &Path) -> Vec<PathBuf> {
    // As `policy.csv`, not `./policy.csv`, where it is beside `policy.bin`.
    let beside = |path: &Path| match out.parent() {
        Some(folder) => folder.join(path),
        None => path.to_owned(),
    };
    let mut all: Vec<PathBuf> =
        hint.file_name().map(|name| beside(Path::new(name))).into_iter().collect();
    for path in [beside(hint), hint.to_owned(), usual_log(out)] {
        if !all.contains(&path) {
            all.push(path);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_not_cut_at_a_dot() {
        for (out, log, name) in [
            ("policy.bin", "policy.csv", "policy"),
            ("policy", "policy.csv", "policy"),
            ("w-lr0.1", "w-lr0.1.csv", "w-lr0.1"),
            ("runs.v2/w-lr0.1.bin", "runs.v2/w-lr0.1.csv", "w-lr0.1"),
            ("policy.v1", "policy.v1.csv", "policy.v1"),
            ("runs.v2/policy", "runs.v2/policy.csv", "policy"),
            (".bin", ".bin.csv", ".bin"),
        ] {
            assert_eq!(usual_log(Path::new(out)), Path::new(log), "{out}");
            assert_eq!(title(Path::new(out)), name, "{out}");
            assert_eq!(usual_log(&other_policy(Path::new(out))), Path::new(log), "{out}");
        }
        assert_eq!(title(Path::new("a/w-lr0.1.csv")), "w-lr0.1");
        assert_eq!(title(Path::new("a/w-lr0.*")), "w-lr0.*");
        assert_eq!(title(Path::new("a/w-lr0.1.onnx")), "w-lr0.1");
    }

    #[test]
    fn a_relative_log_is_stated_as_seen_from_the_policy() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["runs/a", "logs"] {
            std::fs::create_dir_all(folder.path().join(name)).unwrap();
        }
        std::env::set_current_dir(folder.path()).unwrap();
        for (log, out, expected) in [
            ("p.csv", "p.bin", "p.csv"),
            ("runs/p.csv", "runs/p.bin", "p.csv"),
            ("logs/p.csv", "runs/a/p.bin", "../../logs/p.csv"),
            ("p.csv", "runs/p.bin", "../p.csv"),
            ("runs/a/p.csv", "p.bin", "runs/a/p.csv"),
        ] {
            assert_eq!(hint(Path::new(log), Path::new(out)), Path::new(expected), "{log} {out}");
        }
        let absolute = folder.path().join("logs/p.csv");
        assert_eq!(hint(&absolute, Path::new("p.bin")), absolute);
        let candidates = log_candidates(Path::new("/new/runs/q.bin"), Path::new("../logs/p.csv"));
        let expected =
            ["/new/runs/p.csv", "/new/runs/../logs/p.csv", "../logs/p.csv", "/new/runs/q.csv"];
        assert_eq!(candidates, expected.map(PathBuf::from));
        assert_eq!(
            log_candidates(Path::new("p.bin"), Path::new("p.csv")),
            [PathBuf::from("p.csv")]
        );
    }
}
