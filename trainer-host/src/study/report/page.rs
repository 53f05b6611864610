//! What several studies found, on one page.

use super::figure::{Figure, figures};
use super::findings::Findings;
use super::setting;
use super::summary::Summary;
use super::threshold;
use crate::study::data::StudyData;

/// What the page says before the first study.
const OPENING: &str = "\
# Results

Every number here is computed from the flights of the studies in `configs/studies/` by

```sh
kestrel study run configs/studies/NAME.yaml     # for each of them: rows of flights
kestrel study results STUDY... --output FILE    # this page; --pictures FOLDER draws its pictures
```

Intervals are 95 % bootstrap intervals over seeds. A claim is written in the study's file; it *holds* when its whole interval is
where it says, *fails* when the whole interval is elsewhere, and is *open* otherwise. Trivial pilots (do nothing, random,
scripted) flew the same tasks. A study that is not finished says so. The full report of a study, with its learning curves,
matrices and definitions, is `report.md` in its directory.
";

/// Pictures that a page has room for; the others are in the full reports.
const SHOWN: [&str; 4] = ["final.svg", "so-far.svg", "curves.svg", "threshold.svg"];

/// Several studies on one page.
#[derive(Debug)]
pub struct Page {
    /// Markdown.
    pub text: String,
    /// File names and SVG of the pictures that it shows.
    pub pictures: Vec<(String, String)>,
}

/// The page about these studies, in the order given; with pictures when it is said in which folder, as a link of the
/// page names it.
pub fn page(studies: &[StudyData], folder: Option<&str>) -> Page {
    let mut page = Page { text: OPENING.to_owned(), pictures: Vec::new() };
    for data in studies {
        page.text.push('\n');
        page.add(data, folder);
    }
    page
}

impl Page {
    fn add(&mut self, data: &StudyData, folder: Option<&str>) {
        let summary = Summary::new(data);
        let learnings = threshold::learnings(data, &summary);
        let mut drawn = if folder.is_some() { figures(data, &summary, &learnings) } else { Vec::new() };
        drawn.retain(|figure| SHOWN.contains(&figure.file));
        let prefix = format!("{}/{}-", folder.unwrap_or_default(), data.manifest.name);
        let pictures = drawn.iter().map(|figure| figure.file).collect();
        let findings = Findings { data, summary: &summary, learnings: &learnings, pictures, prefix: &prefix };
        self.text += &section(&findings);
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
