//! The paper's figures, computed quickly: every figure is rendered, and a browser shows the
//! report as intended.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

use harness::browser;

/// Renders some figures and returns their files, except the report, which states a time.
fn render(only: &str, threads: &str, folder: &Path) -> BTreeMap<String, String> {
    let output = harness::program("paper-figures")
        .args(["--quick", "--only", only, "--out"])
        .arg(folder)
        .env("RAYON_NUM_THREADS", threads)
        .output()
        .expect("the program runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let rendered = files.filter(|path| path.extension().is_some_and(|e| e == "svg" || e == "csv"));
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    rendered.map(|path| (name(&path), fs::read_to_string(path).unwrap())).collect()
}

/// Returns the files of the cache, with the times when they were written.
fn cache(folder: &Path) -> BTreeMap<String, SystemTime> {
    let entries = fs::read_dir(folder.join("cache")).unwrap().map(Result::unwrap);
    let named = |entry: fs::DirEntry| {
        (entry.file_name().to_string_lossy().into_owned(), entry.metadata().unwrap().modified())
    };
    entries.map(named).map(|(name, at)| (name, at.unwrap())).collect()
}

#[test]
fn figures_do_not_depend_on_the_number_of_threads_and_cached_steps_are_used_again() {
    let (one, three) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let rendered = render("5,6", "1", one.path());
    assert_eq!(
        rendered.keys().collect::<Vec<_>>(),
        ["fig05.csv", "fig05.svg", "fig06.csv", "fig06.svg"]
    );
    assert!(rendered == render("5,6", "3", three.path()), "the number of threads matters");

    // As after an interrupted run: some steps are missing.
    let done = cache(one.path());
    let missing: Vec<&String> =
        done.keys().filter(|name| name.starts_with("landscape-1")).collect();
    assert!(missing.len() > 1 && missing.len() < done.len(), "{missing:?}");
    for name in &missing {
        fs::remove_file(one.path().join("cache").join(name)).unwrap();
    }
    assert!(rendered == render("5,6", "2", one.path()), "a resumed run differs");
    let now = cache(one.path());
    assert!(now.keys().eq(done.keys()));
    for (name, at) in &done {
        assert_eq!(now[name] == *at, !missing.contains(&name), "{name}");
    }
}

#[test]
fn the_report_shows_every_figure_and_the_browser_logs_nothing() {
    let Some(browser) = requirements::chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = harness::program("paper-figures")
        .args(["--quick", "--out"])
        .arg(folder.path())
        .output()
        .expect("the program runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    let ids: Vec<String> = (3..=13).map(|number| format!("fig{number:02}")).collect();
    for id in ids.iter().map(String::as_str).chain(["beyond"]) {
        let svg = fs::read_to_string(folder.path().join(format!("{id}.svg"))).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{id}.svg");
        let mut rows = fs::read_to_string(folder.path().join(format!("{id}.csv"))).unwrap();
        rows.truncate(rows.trim_end().len());
        let columns: Vec<usize> = rows.lines().map(|row| row.split(',').count()).collect();
        assert!(columns.len() > 10, "{id}.csv: {} rows", columns.len());
        assert!(columns.iter().all(|count| *count == columns[0]), "{id}.csv is ragged");
    }

    let page = folder.path().join("report.html");
    let messages = browser::console(browser, &page).unwrap();
    assert!(messages.is_empty(), "{messages:#?}");
    let shown = browser::figures(browser, &page).unwrap();
    assert_eq!(shown.len(), ids.len() + 1);
    for (figure, id) in shown.iter().zip(ids.iter().map(String::as_str).chain(["beyond"])) {
        assert!(figure.visible && figure.marks > 10, "{id}: {figure:?}");
        assert!(figure.width_px > 600.0 && figure.height_px > 150.0, "{id}: {figure:?}");
        assert!(figure.cut.is_empty(), "{id}: {:?}", figure.cut);
    }
    // The page needs no other file, neither from the network nor from the disk.
    let html = fs::read_to_string(page).unwrap();
    for reference in ["<script", "<link rel=\"stylesheet\"", "src=", "@import", "url("] {
        assert!(!html.contains(reference), "the page has a {reference}");
    }
}
