//! Shows a page in headless Chromium and measures its layout.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;

/// The element of the page that holds the measurements.
const MEASURED: [&str; 2] = ["<pre id=\"shown\">", "</pre>"];

/// Measures the figures once the page is loaded.
const SCRIPT: &str = r#"<script>addEventListener("load", () => {
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

/// A figure as the browser lays it out.
#[derive(Debug, Deserialize)]
pub struct Shown {
    /// Width on a page of 1280 by 1024 CSS pixels.
    pub width_px: f64,
    /// Height on that page.
    pub height_px: f64,
    /// Number of lines, areas, cells and dots with a size above 0.
    pub marks: usize,
    /// Texts that reach beyond the figure's edge.
    pub cut: Vec<String>,
    /// True if no style hides it.
    pub visible: bool,
}

/// Opens a page and returns the messages of its console.
///
/// # Errors
/// Fails if the browser does not run.
pub fn console(browser: &str, page: &Path) -> Result<Vec<String>> {
    let log = open(browser, page)?.stderr;
    let lines = String::from_utf8_lossy(&log).into_owned();
    Ok(lines.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect())
}

/// Opens a page and measures how its figures are laid out.
///
/// # Errors
/// Fails if the browser does not run, or if the page yields no measurements.
pub fn figures(browser: &str, page: &Path) -> Result<Vec<Shown>> {
    let html = fs::read_to_string(page).with_context(|| page.display().to_string())?;
    ensure!(html.contains("</body>"), "{} is cut", page.display());
    let probe = page.with_extension("probe.html");
    fs::write(&probe, html.replace("</body>", &format!("{SCRIPT}</body>")))?;
    let output = open(browser, &probe);
    fs::remove_file(&probe)?;
    let dom = String::from_utf8(output?.stdout)?;
    let measured = dom.split_once(MEASURED[0]).and_then(|(_, rest)| rest.split_once(MEASURED[1]));
    let (measured, _) = measured.context("the page holds no measurements")?;
    Ok(serde_json::from_str(measured)?)
}

fn open(browser: &str, page: &Path) -> Result<Output> {
    let profile = tempfile::tempdir()?;
    let output = Command::new(browser)
        .args(["--headless=new", "--disable-gpu", "--disable-extensions", "--no-first-run"])
        // The sandbox does not start as root, as in a container; the page is our own.
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
