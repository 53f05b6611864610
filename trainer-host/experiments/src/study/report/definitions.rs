//! How to read the report, and what every measure is.

use crate::study::data::StudyData;

/// What intervals and letters mean.
pub(super) fn how_to_read(data: &StudyData) -> String {
    let seeds = data.manifest.seeds.len();
    let caution = match seeds {
        1..=3 => " This study has too few seeds: little is known about chance, and no number has an interval.",
        4..=7 => " With so few seeds intervals are too narrow too often, and no claim is decided.",
        _ => "",
    };
    format!(
        "## How to read this\n\n* A seed decides everything random about a run: first weights, starts, exploration. It is the \
         unit of chance: intervals come from drawing whole seeds again, each with all its orders and tasks (bootstrap, \
         BCa of Efron 1987, widened for few seeds as Hesterberg 2015 says, 95 %, 50,000 draws; 5,000 for probabilities of improvement, forward transfer and steps to a \
         threshold).{caution}\n* `98.4 % [97.9, 98.8]` is an estimate and its 95 % interval. Without brackets there were fewer than four seeds. \
         `–` stands where a number does not exist or its rows are missing. The number of seeds behind a method's \
         numbers is in the first table of results, unless a table has its own.\n* All methods share their draws, so an interval of a \
         difference is paired by seed.\n* When every seed has the same value, its interval is a point: that is what the seeds \
         say, not a proof.\n* Success is the task's own criterion, from starts that no training has seen. Return is what \
         training maximises, undiscounted; it can be high without success.\n"
    )
}

/// Formulas, with a success threshold in words.
pub(super) fn definitions(threshold: &str) -> String {
    format!(
        "## Definitions\n\nR[i, j] is the success rate in the j-th task of a run's order after stage i, with N tasks; R[0, j] is \
         before training. Measures are taken per run, then averaged over runs.\n\n\
         * **Mean success**: A = 1/N · Σ over j of R[N, j]. Joint training has one stage, and R[1, j] stands for R[N, j]; of experts it is \
         the success of each task's own.\n\
         * **Interquartile mean**: mean of all R[N, j] of all runs without the lowest and the highest quarter (Agarwal et al. \
         2021). Less moved by single runs than the mean.\n\
         * **Worst task**: min over j of R[N, j].\n\
         * **Shortfall**: mean of max(0, {threshold} − R[N, j]) over runs and tasks, in points (optimality gap).\n\
         * **Normalised return**: (return − random) / (expert − random), cut to [0, 1.2], averaged over tasks; random is the \
         random pilot's mean return, expert the interquartile mean of the experts' returns in that task.\n\
         * **Forgetting**: 1/(N−1) · Σ over j < N of (max over stages i ≥ 1 of R[i, j] − R[N, j]); never negative, and noise makes it a little larger \
         (Chaudhry et al. 2018).\n\
         * **Backward transfer**: 1/(N−1) · Σ over j < N of (R[N, j] − R[j, j]); negative when later tasks harm earlier ones (Lopez-Paz and \
         Ranzato 2017).\n\
         * **Plasticity**: 1/N · Σ over j of R[j, j]: what is learned when it is a task's turn.\n\
         * **Zero-shot transfer**: 1/(N−1) · Σ over j > 1 of (R[j−1, j] − R[0, j]): what earlier tasks teach about later ones.\n\
         * **Forward transfer**: mean over tasks of (a − b)/(1 − b), with a the mean success during the task's stage (area under \
         the learning curve over the budget) and b that of the experts, which start anew (Wołczyk et al. 2021). Above 0: faster \
         than from scratch.\n\
         * **Joint gap**: 1 − A / A(joint training). **Of the experts**: A / A(experts).\n\
         * **Probability of improvement**: chance that a run of the method ends with more success than one of the reference, \
         ties as halves: U/(nm) of Mann and Whitney, averaged over tasks.\n\
         * **Difference**: of the mean success. Its p is that of flipping the signs of the seeds' differences (Fisher 1935; two-sided, all flips up to \
         16 seeds, 65,536 random ones above). **Holm**: corrected for all comparisons of the table.\n\
         * **Performance profile**: share of runs and tasks with R[N, j] above a threshold, over all thresholds.\n\
         * **Reached, median, restricted mean**: of the steps until test flights of the training task first succeed in {threshold}, by \
         Kaplan and Meier's estimate S(t) of the share that still waits after t steps: the median is the first t with S(t) ≤ ½, \
         the restricted mean ∫ S dt from 0 to the budget. The log-rank test is stratified by task and takes stages for \
         independent, which those of one seed are not quite.\n"
    )
}
