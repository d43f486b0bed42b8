//! The paper's figures in short: every one made, and shown by a browser as it
//! is to be.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

use harness::browser;

/// Makes some figures: their files but for the report, which has a time.
fn make(only: &str, threads: &str, folder: &Path) -> BTreeMap<String, String> {
    let made = harness::program("paper-figures")
        .args(["--quick", "--only", only, "--out"])
        .arg(folder)
        .env("RAYON_NUM_THREADS", threads)
        .output()
        .expect("the program runs");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let drawn = files.filter(|path| path.extension().is_some_and(|e| e == "svg" || e == "csv"));
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    drawn.map(|path| (name(&path), fs::read_to_string(path).unwrap())).collect()
}

fn parts(folder: &Path) -> BTreeMap<String, SystemTime> {
    let entries = fs::read_dir(folder.join("parts")).unwrap().map(Result::unwrap);
    let named = |entry: fs::DirEntry| {
        (entry.file_name().to_string_lossy().into_owned(), entry.metadata().unwrap().modified())
    };
    entries.map(named).map(|(name, at)| (name, at.unwrap())).collect()
}

#[test]
fn any_number_of_threads_makes_the_same_figures_and_what_is_done_is_not_done_again() {
    let (one, three) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let drawn = make("5,6", "1", one.path());
    assert_eq!(
        drawn.keys().collect::<Vec<_>>(),
        ["fig05.csv", "fig05.svg", "fig06.csv", "fig06.svg"]
    );
    assert!(drawn == make("5,6", "3", three.path()), "the number of threads matters");

    // Cut short: some parts are not there yet.
    let done = parts(one.path());
    let missing: Vec<&String> =
        done.keys().filter(|name| name.starts_with("landscape-1")).collect();
    assert!(missing.len() > 1 && missing.len() < done.len(), "{missing:?}");
    for name in &missing {
        fs::remove_file(one.path().join("parts").join(name)).unwrap();
    }
    assert!(drawn == make("5,6", "2", one.path()), "a run that was cut comes to another end");
    let now = parts(one.path());
    assert!(now.keys().eq(done.keys()));
    for (name, at) in &done {
        assert_eq!(now[name] == *at, !missing.contains(&name), "{name}");
    }
}

#[test]
fn the_report_shows_every_figure_without_a_word_on_the_console() {
    let Some(browser) = requirements::chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    let made = harness::program("paper-figures")
        .args(["--quick", "--out"])
        .arg(folder.path())
        .output()
        .expect("the program runs");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));

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
    let said = browser::console(browser, &page).unwrap();
    assert!(said.is_empty(), "{said:#?}");
    let shown = browser::figures(browser, &page).unwrap();
    assert_eq!(shown.len(), ids.len() + 1);
    for (figure, id) in shown.iter().zip(ids.iter().map(String::as_str).chain(["beyond"])) {
        assert!(figure.visible && figure.marks > 10, "{id}: {figure:?}");
        assert!(figure.width_px > 600.0 && figure.height_px > 150.0, "{id}: {figure:?}");
        assert!(figure.cut.is_empty(), "{id}: {:?}", figure.cut);
    }
    // Everything is in the page: nothing is fetched, from the net or from a file.
    let html = fs::read_to_string(page).unwrap();
    for fetched in ["<script", "<link rel=\"stylesheet\"", "src=", "@import", "url("] {
        assert!(!html.contains(fetched), "the page has a {fetched}");
    }
}

#[test]
fn figures_that_are_not_there_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = harness::program("paper-figures")
        .args(["--only", "3,2", "--out"])
        .arg(folder.path().join("out"))
        .output()
        .expect("the program runs");
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("--only 2") && said.contains("3, 4, 5"), "{said}");
    assert!(!folder.path().join("out").exists(), "nothing is written");
}
