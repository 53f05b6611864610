//! Every method against a reference.

use super::summary::{Summary, final_success, final_success_in};
use crate::statistics::bootstrap::Estimate;
use crate::statistics::comparison::{probability_of_improvement, sign_flip_p};
use crate::statistics::correction::holm;
use crate::statistics::sample::Sample;
use crate::study::data::StudyData;

/// What the sign test's draws follow from.
const SEED: u64 = 1935;

/// One method beside the reference.
pub(super) struct Comparison {
    pub(super) method: usize,
    /// Chance that a run of it has the higher final success, averaged over tasks.
    pub(super) improvement: Option<Estimate>,
    /// Mean final success less that of the reference, seed by seed.
    pub(super) difference: Option<Estimate>,
    /// That the difference is chance: sign flips of the seeds' differences.
    pub(super) p: Option<f64>,
    /// The same, corrected for the number of comparisons (Holm).
    pub(super) corrected: Option<f64>,
}

/// Compares all other methods that have runs with the `reference`.
pub(super) fn comparisons(data: &StudyData, summary: &Summary, reference: usize) -> Vec<Comparison> {
    let with_runs = |method: &usize| *method != reference && summary.methods[*method].runs > 0;
    let others = (0..data.manifest.methods.len()).filter(with_runs);
    let mut comparisons: Vec<Comparison> =
        others.map(|method| compare(data, summary, method, reference)).collect();
    let tested = comparisons.iter_mut().filter(|comparison| comparison.p.is_some());
    let (mut tested, mut p_values) = (tested.collect::<Vec<_>>(), Vec::new());
    p_values.extend(tested.iter().filter_map(|comparison| comparison.p));
    for (comparison, corrected) in tested.iter_mut().zip(holm(&p_values)) {
        comparison.corrected = Some(corrected);
    }
    comparisons
}

fn compare(data: &StudyData, summary: &Summary, method: usize, reference: usize) -> Comparison {
    let (mine, theirs) = (final_success(data, method), final_success(data, reference));
    let units = mine.units().min(theirs.units());
    Comparison {
        method,
        improvement: improvement(data, summary, method, reference),
        difference: difference(data, summary, method, reference),
        p: sign_flip_p(&differences(data, &mine, &theirs), SEED).filter(|_| units > 1),
        corrected: None,
    }
}

/// Mean final success of `method` less that of `other`, paired by seed.
pub(super) fn difference(data: &StudyData, summary: &Summary, method: usize, other: usize) -> Option<Estimate> {
    let (mine, theirs) = (final_success(data, method), final_success(data, other));
    let units = mine.units().min(theirs.units());
    summary.resamples.estimate(units, |counts| Some(mine.mean(counts)? - theirs.mean(counts)?))
}

fn improvement(data: &StudyData, summary: &Summary, method: usize, reference: usize) -> Option<Estimate> {
    let samples = |task| (final_success_in(data, method, task), final_success_in(data, reference, task));
    let pairs: Vec<(Sample, Sample)> = (0..data.manifest.tasks.len())
        .map(samples)
        .filter(|(mine, theirs)| !mine.is_empty() && !theirs.is_empty())
        .collect();
    let units = pairs.iter().map(|(mine, theirs)| mine.units().min(theirs.units())).min()?;
    summary.few.estimate(units, |counts| {
        let chances = pairs.iter().map(|(mine, theirs)| probability_of_improvement(mine, theirs, counts));
        Some(chances.sum::<Option<f64>>()? / pairs.len() as f64)
    })
}

/// Differences of the means of each seed that both have.
fn differences(data: &StudyData, mine: &Sample, theirs: &Sample) -> Vec<f64> {
    let seeds = data.manifest.seeds.len();
    let alone = |seed: usize| -> Vec<u16> { (0..seeds).map(|other| u16::from(other == seed)).collect() };
    (0..seeds).filter_map(|seed| Some(mine.mean(&alone(seed))? - theirs.mean(&alone(seed))?)).collect()
}
