//! What several studies found, on one page.

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
kestrel study results STUDY... --output FILE    # this page
```

Intervals are 95 % bootstrap intervals over seeds. A claim is written in the study's file; it *holds* when its whole interval is
where it says, *fails* when the whole interval is elsewhere, and is *open* otherwise. Trivial pilots (do nothing, random,
scripted) flew the same tasks. A study that is not finished says so. The full report of a study, with its learning curves,
matrices and definitions, is `report.md` in its directory.
";

/// The page about these studies, in the order given.
pub fn page(studies: &[StudyData]) -> String {
    let mut text = OPENING.to_owned();
    for data in studies {
        text.push('\n');
        text += &section(data);
    }
    text
}

fn section(data: &StudyData) -> String {
    let summary = Summary::new(data);
    let learnings = threshold::learnings(data, &summary);
    let findings = Findings { data, summary: &summary, learnings: &learnings, pictures: Vec::new() };
    let sections = [
        findings.claims(),
        findings.finals(),
        if findings.is_sequential() { findings.retention() } else { String::new() },
        findings.success_by_task(),
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
