//! The Markdown files of the repository: their paths and links.

use std::fs;
use std::path::{Path, PathBuf};

/// Returns every Markdown file of the repository.
fn markdown_files() -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![harness::checkout().canonicalize().unwrap()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let (path, name) = (entry.path(), entry.file_name());
            let is_source = !["target", "out", ".git"].iter().any(|skipped| name == *skipped);
            if entry.file_type().unwrap().is_dir() && is_source {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                files.push(path);
            }
        }
    }
    files
}

/// Returns the text outside of fenced code blocks.
fn prose(markdown: &str) -> String {
    markdown.split("```").step_by(2).collect()
}

/// Returns the targets of the links `[text](target)`.
fn links(markdown: &str) -> Vec<String> {
    let prose = prose(markdown);
    let targets = prose.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    targets.map(|(target, _)| target.to_owned()).collect()
}

/// Returns the anchors of the headings, as GitHub forms them.
fn anchors(markdown: &str) -> Vec<String> {
    let headings = prose(markdown);
    let headings = headings.lines().filter_map(|line| line.strip_prefix('#'));
    let anchor = |heading: &str| {
        let text = heading.trim_start_matches('#').trim().to_lowercase();
        let kept = text.chars().filter(|c| c.is_alphanumeric() || "- _".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(anchor).collect()
}

#[test]
fn every_path_in_architecture_and_contributing_exists() {
    let is_path = |word: &&str| {
        word.contains('/') && word.chars().all(|c| c.is_alphanumeric() || "/._-".contains(c))
    };
    for (file, at_least) in [("ARCHITECTURE.md", 50), ("CONTRIBUTING.md", 10)] {
        let text = prose(&fs::read_to_string(harness::checkout().join(file)).unwrap());
        let paths: Vec<&str> = text.split('`').skip(1).step_by(2).filter(is_path).collect();
        assert!(paths.len() >= at_least, "{file}: only {} paths in `code`", paths.len());
        let missing: Vec<_> =
            paths.iter().filter(|p| !harness::checkout().join(p).exists()).collect();
        assert!(missing.is_empty(), "{file} names missing paths: {missing:?}");
    }
}

#[test]
fn every_relative_link_in_a_markdown_file_resolves() {
    let mut checked = 0;
    let mut broken = Vec::new();
    for file in markdown_files() {
        let text = fs::read_to_string(&file).unwrap();
        // The Rust documentation resolves links to items.
        let is_relative = |link: &&String| !link.contains("://") && !link.contains("::");
        for link in links(&text).iter().filter(is_relative) {
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let folder = file.parent().unwrap_or(Path::new("/"));
            let target = if path.is_empty() { file.clone() } else { folder.join(path) };
            checked += 1;
            let has_anchor = || {
                let text = fs::read_to_string(&target).unwrap_or_default();
                anchor.is_empty() || anchors(&text).iter().any(|found| found == anchor)
            };
            if !target.exists() || !has_anchor() {
                broken.push(format!("{}: {link}", file.display()));
            }
        }
    }
    assert!(checked > 30, "only {checked} links found");
    assert!(broken.is_empty(), "broken links:\n{}", broken.join("\n"));
}
