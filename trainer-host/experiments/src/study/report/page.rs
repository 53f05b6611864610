//! What several studies found, on one page.

use thiserror::Error;

use super::claims;
use super::definitions::definitions;
use super::figure::{Figure, figures};
use super::findings::Findings;
use super::setting;
use super::summary::Summary;
use super::table::Table;
use super::threshold;
use super::wrap::wrapped;
use crate::study::data::StudyData;

/// The first line.
const TITLE: &str = "# Results\n";

/// Heading of the first section that is not written by hand.
const METHOD: &str = "\n## How these numbers are made\n";

/// Heading of the section behind it.
const CLAIMS: &str = "Claims of all studies";

/// Heading of the last section.
const LAST: &str = "Definitions";

/// What the page says before the claims.
const OPENING: &str = "
Every number below is computed from the flights of the studies in `configs/studies/` by

```sh
kestrel study run configs/studies/NAME.yaml     # for each of them: rows of flights
kestrel study results STUDY... --output FILE    # this page
```

`--pictures FOLDER` draws its pictures. `--update` leaves the sections of other studies, and what is
written by hand above this section, as they are.

Intervals are 95 % bootstrap intervals over seeds (BCa, widened for few seeds, and none below four
of them). A claim is written in the study's file; it *holds* when its whole interval is on the
expected side, *fails* when the whole interval is on the other side, and is *open* otherwise, and
with fewer than eight seeds. Trivial pilots (do nothing, random, scripted) flew the same tasks. A study that is not finished says so. The full report of a study, with its learning curves,
matrices and definitions, is `report.md` in its directory.
";

/// Pictures that a page has room for; the others are in the full reports.
const SHOWN: [&str; 6] = ["final.svg", "so-far.svg", "memory.svg", "curves.svg", "returns.svg", "threshold.svg"];

/// Several studies on one page.
#[derive(Debug)]
pub struct Page {
    /// What stands between the title and what is generated, written by hand.
    head: String,
    /// Name and text of each study's section.
    sections: Vec<(String, String)>,
    /// File names and SVG of the pictures that it shows.
    pub pictures: Vec<(String, String)>,
}

/// The page about these studies, in the order given; with pictures when it is said in which folder, as a link of the
/// page names it.
pub fn page(studies: &[StudyData], folder: Option<&str>) -> Page {
    let mut page = Page { head: String::new(), sections: Vec::new(), pictures: Vec::new() };
    for data in studies {
        page.add(data, folder);
    }
    page
}

/// A text is no page of results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("expected a page of `kestrel study results`, which begins with `# Results`")]
pub struct NoPage;

impl Page {
    /// Markdown.
    pub fn text(&self) -> String {
        let mut text = format!("{METHOD}{OPENING}{}", self.claims());
        for (_, section) in &self.sections {
            text.push('\n');
            text += section;
        }
        text.push('\n');
        text += &definitions("the study's threshold");
        format!("{TITLE}{}{}", self.head, wrapped(&text))
    }

    /// Takes over the head of an `earlier` page, which is written by hand, and what it has about other studies: its
    /// sections keep their places, and new ones follow.
    ///
    /// # Errors
    /// [`NoPage`] when the text is something else.
    pub fn keep(&mut self, earlier: &str) -> Result<(), NoPage> {
        let earlier = earlier.strip_prefix(TITLE).ok_or(NoPage)?;
        let (head, earlier) = earlier.split_once(METHOD).unwrap_or(("", earlier));
        head.clone_into(&mut self.head);
        let mut sections = Vec::new();
        for section in earlier.split("\n## ").skip(1) {
            let name = section.lines().next().unwrap_or_default();
            let told: Vec<_> = self.sections.extract_if(.., |(told, _)| told == name).collect();
            if told.is_empty() && ![CLAIMS, LAST].contains(&name) {
                sections.push((name.to_owned(), format!("## {}\n", section.trim_end())));
            }
            sections.extend(told);
        }
        sections.append(&mut self.sections);
        self.sections = sections;
        Ok(())
    }

    /// The claims of all sections, each with a link to its study; empty without claims.
    fn claims(&self) -> String {
        let heading = Table::new(claims::HEADINGS).text();
        let mut rows = String::new();
        for (name, section) in &self.sections {
            let table = section.split_once(&heading).map_or("", |(_, table)| table);
            for row in table.lines().take_while(|line| line.starts_with('|')) {
                rows.extend(["| [", name, "](#", name, ") ", row, "\n"]);
            }
        }
        if rows.is_empty() {
            return rows;
        }
        format!("\n## {CLAIMS}\n\n{}{rows}", Table::new(["study"].into_iter().chain(claims::HEADINGS)).text())
    }

    fn add(&mut self, data: &StudyData, folder: Option<&str>) {
        let summary = Summary::new(data);
        let learnings = threshold::learnings(data, &summary);
        let mut drawn = if folder.is_some() { figures(data, &summary, &learnings) } else { Vec::new() };
        drawn.retain(|figure| SHOWN.contains(&figure.file));
        let prefix = format!("{}/{}-", folder.unwrap_or_default(), data.manifest.name);
        let pictures = drawn.iter().map(|figure| figure.file).collect();
        let findings = Findings { data, summary: &summary, learnings: &learnings, pictures, prefix: &prefix };
        self.sections.push((data.manifest.name.clone(), section(&findings)));
        let named = |Figure { file, drawing }: Figure| (format!("{}-{file}", data.manifest.name), drawing.svg());
        self.pictures.extend(drawn.into_iter().map(named));
    }
}

fn section(findings: &Findings<'_>) -> String {
    let data = findings.data;
    let sections = [
        findings.claims(),
        findings.finals(),
        if findings.is_sequential() { findings.retention() } else { String::new() },
        if findings.is_sequential() { findings.memory() } else { String::new() },
        findings.success_by_task(),
        if findings.pictures.is_empty() { String::new() } else { findings.curves() },
        if findings.has_thresholds() { findings.thresholds() } else { String::new() },
        findings.published(),
        setting::tasks(data),
        setting::methods(data),
        setting::procedure(data),
    ];
    let deeper = sections.iter().filter(|section| !section.is_empty()).map(|section| format!("#{section}"));
    let head =
        format!("## {}\n\n{}\n\n{}", data.manifest.name, data.manifest.about.trim(), setting::missing(data));
    std::iter::once(head.trim_end().to_owned() + "\n").chain(deeper).collect::<Vec<_>>().join("\n")
}
