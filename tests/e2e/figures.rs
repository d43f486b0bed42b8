//! The paper's figures in short: every one made, and shown by a browser as it
//! is to be.

use std::fs;

use tests::browser;

#[test]
fn the_report_shows_every_figure_without_a_word_on_the_console() {
    let browser = browser::installed()
        .expect("Chromium is not installed; `cargo xtask setup` installs it, or says how");
    let folder = tempfile::tempdir().unwrap();
    let made = tests::program("trainer")
        .args(["figures", "--quick", "--out"])
        .arg(folder.path())
        .output()
        .expect("the trainer runs");
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
    let refused = tests::program("trainer")
        .args(["figures", "--only", "3,2", "--out"])
        .arg(folder.path().join("out"))
        .output()
        .expect("the trainer runs");
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("--only 2") && said.contains("3, 4, 5"), "{said}");
    assert!(!folder.path().join("out").exists(), "nothing is written");
}
