//! The report: one HTML page without external files.

use std::fmt::Write as _;

use super::{Claim, Figure, RenderedFigure, Verdict};

const STYLE: &str = "\
body{max-width:1040px;margin:2em auto;padding:0 1em;font:16px/1.5 system-ui,sans-serif;color:#262c38}\
h1{font-size:1.7em}h2{font-size:1.25em;margin-top:2.2em}\
svg{width:100%;height:auto;border:1px solid #e2e5ec;border-radius:6px}\
table{border-collapse:collapse;width:100%;font-size:.92em}\
td,th{border-bottom:1px solid #e2e5ec;padding:.35em .6em;text-align:left;vertical-align:top}\
.holds{color:#12725f;font-weight:600}.in-part{color:#a06a00;font-weight:600}\
.fails{color:#b3361b;font-weight:600}\
td[class]{white-space:nowrap}\
.paper{color:#5a606c}pre{background:#f5f6f9;padding:.8em;overflow:auto;font-size:.85em}";

/// Returns the report as HTML. `provenance` holds rows of what, and value.
#[must_use]
pub fn report(
    figures: &[(&dyn Figure, RenderedFigure)],
    provenance: &[(String, String)],
) -> String {
    let mut html = String::from(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width\">\
         <link rel=\"icon\" href=\"data:,\"><title>Learning to stop: the figures</title>",
    );
    let _ = write!(html, "<style>{STYLE}</style></head><body>");
    html += "<h1>Learning to stop: the paper's figures, computed anew</h1>\
             <p>Every figure below comes from this repository's own plant, trainer and controller. \
             If the authors' published data is available (doi 10.5281/zenodo.4607469), it is drawn \
             beside ours. Each claim of the paper is stated, measured and judged.</p>";
    overview(&mut html, figures);
    for (figure, rendered) in figures {
        section(&mut html, *figure, rendered);
    }
    html += "<h2>How this report was made</h2><table>";
    for (what, value) in provenance {
        let _ = write!(html, "<tr><td>{}</td><td>{}</td></tr>", escape(what), escape(value));
    }
    html += "</table></body></html>\n";
    html
}

/// Adds a table of every claim and its verdict.
fn overview(html: &mut String, figures: &[(&dyn Figure, RenderedFigure)]) {
    let verdicts =
        figures.iter().flat_map(|(_, rendered)| &rendered.claims).map(|claim| claim.verdict);
    let (mut holds, mut all) = (0, 0);
    for verdict in verdicts {
        all += 1;
        holds += usize::from(verdict == Verdict::Holds);
    }
    let _ = write!(html, "<h2>{holds} of {all} claims hold</h2><table>");
    for (figure, rendered) in figures {
        for Claim { statement, verdict, .. } in &rendered.claims {
            let _ = write!(
                html,
                "<tr><td><a href=\"#{0}\">{0}</a></td><td>{1}</td><td class=\"{2}\">{3}</td></tr>",
                figure.id(),
                escape(statement),
                class(*verdict),
                verdict.text(),
            );
        }
    }
    *html += "</table>";
}

/// Adds a figure: the paper's report, our measurements, the charts, and the verdicts.
fn section(html: &mut String, figure: &dyn Figure, rendered: &RenderedFigure) {
    let _ = write!(
        html,
        "<h2 id=\"{0}\">{1}</h2><p class=\"paper\"><b>The paper.</b> {2}</p><p><b>Measured.</b> {3}</p>\
         <figure style=\"margin:0\">{4}</figure><table>",
        figure.id(),
        escape(&heading(figure)),
        escape(figure.paper()),
        escape(&rendered.measured),
        rendered.svg,
    );
    for Claim { statement, measured, verdict } in &rendered.claims {
        let _ = write!(
            html,
            "<tr><td>{}</td><td>{}</td><td class=\"{}\">{}</td></tr>",
            escape(statement),
            escape(measured),
            class(*verdict),
            verdict.text(),
        );
    }
    let _ = write!(
        html,
        "</table><p><a href=\"{0}.svg\">{0}.svg</a>, <a href=\"{0}.csv\">{0}.csv</a></p>",
        figure.id()
    );
}

fn heading(figure: &dyn Figure) -> String {
    match figure.id().strip_prefix("fig") {
        Some(number) => format!("Figure {}. {}", number.trim_start_matches('0'), figure.title()),
        None => figure.title().to_owned(),
    }
}

fn class(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Holds => "holds",
        Verdict::InPart => "in-part",
        Verdict::Fails => "fails",
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
