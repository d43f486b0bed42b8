//! A page as a reader's browser shows it: headless Chromium.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

/// Where the page's findings stand, once it has told them.
const FOUND: [&str; 2] = ["<pre id=\"shown\">", "</pre>"];

/// Runs in the page when all of it is there.
const ASK: &str = r#"<script>addEventListener("load", () => {
  const shown = [...document.querySelectorAll("figure svg")].map(svg => {
    const box = svg.getBoundingClientRect();
    const inside = other => other.left >= box.left - 1 && other.right <= box.right + 1
      && other.top >= box.top - 1 && other.bottom <= box.bottom + 1;
    const cut = [...svg.querySelectorAll("text")].filter(text => text.textContent.trim())
      .filter(text => !inside(text.getBoundingClientRect())).map(text => text.textContent);
    const marks = [...svg.querySelectorAll("path,polyline,polygon,rect,circle,line,image")]
      .filter(mark => { const at = mark.getBoundingClientRect(); return at.width + at.height > 0; });
    return {
      width_px: box.width, height_px: box.height, marks: marks.length, cut,
      visible: svg.checkVisibility({ opacityProperty: true, visibilityProperty: true }),
    };
  });
  const pre = document.createElement("pre");
  pre.id = "shown";
  pre.textContent = JSON.stringify(shown);
  document.body.append(pre);
})</script>"#;

/// A figure as it is laid out.
#[derive(Debug, Deserialize)]
pub struct Shown {
    /// Its size on a page of 1280 by 1024 CSS pixels.
    pub width_px: f64,
    /// The same.
    pub height_px: f64,
    /// Lines, areas, cells and dots that take up room.
    pub marks: usize,
    /// Words that reach beyond the figure's edge.
    pub cut: Vec<String>,
    /// Not hidden by any style.
    pub visible: bool,
}

/// Opens a page as it is: what its console says, a message a line.
///
/// # Errors
/// When the browser does not run.
pub fn console(browser: &str, page: &Path) -> Result<Vec<String>> {
    let said = open(browser, page)?.stderr;
    let lines = String::from_utf8_lossy(&said).into_owned();
    Ok(lines.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect())
}

/// Opens a page, and asks it how its figures are laid out.
///
/// # Errors
/// When the browser does not run, or the page does not answer.
pub fn figures(browser: &str, page: &Path) -> Result<Vec<Shown>> {
    let html = fs::read_to_string(page).with_context(|| page.display().to_string())?;
    ensure!(html.contains("</body>"), "{} is cut", page.display());
    let asking = page.with_extension("asking.html");
    fs::write(&asking, html.replace("</body>", &format!("{ASK}</body>")))?;
    let answer = open(browser, &asking);
    fs::remove_file(&asking)?;
    let answer = String::from_utf8(answer?.stdout)?;
    let told = answer.split_once(FOUND[0]).and_then(|(_, rest)| rest.split_once(FOUND[1]));
    let (told, _) = told.context("the page did not say how it is laid out")?;
    Ok(serde_json::from_str(told)?)
}

fn open(browser: &str, page: &Path) -> Result<Output> {
    let profile = tempfile::tempdir()?;
    let output = Command::new(browser)
        .args(["--headless=new", "--disable-gpu", "--disable-extensions", "--no-first-run"])
        // As root, as in a container, its sandbox does not start; the page is our own.
        .args(["--no-sandbox", "--disable-dev-shm-usage"])
        .args(["--enable-logging=stderr", "--window-size=1280,1024", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("file://{}", page.canonicalize()?.display()))
        .output()
        .with_context(|| format!("cannot start {browser}"))?;
    ensure!(
        output.status.success(),
        "{browser}: {}: {}",
        output.status,
        String::from_utf8_lossy(&output.stderr)
    );
    Ok(output)
}
