//! Runs the jobs of studies on all cores, until all are done or the user stops it.
//!
//! A worker is a thread with a pool of its own; each takes the next job when it is done with one. What a finished job
//! leaves is written at once, whole or not at all; of an unfinished one there is a checkpoint. Nothing is kept of jobs
//! that are done, so that memory does not grow with their number. With several ranks there is one worker, whose jobs all
//! ranks do together.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::directory::{RunError, StudyDirectory, lock};
use super::job::{JobRun, JobState};
use super::{JobId, Study};
use crate::interrupt::Interrupt;
use crate::progress::Progress;
use crate::training_run::End;
use kestrel_learn::analytic::AnalyticError;
use kestrel_learn::ranks::{self, Order, Ranks, UnequalShares};

/// Time between checkpoints of a job; a kill costs no more.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(10);

/// What workers share.
struct Shared<'a> {
    directories: &'a [StudyDirectory<'a>],
    /// Jobs to be done: which directory, and which of its jobs.
    pending: Vec<(usize, JobId)>,
    next: AtomicUsize,
    meter: Mutex<Meter>,
    failure: Mutex<Option<RunError>>,
    interrupt: &'a Interrupt,
    ranks: &'a Arc<dyn Ranks>,
}

/// How far all jobs are together.
struct Meter {
    progress: Progress,
    /// Steps that need not be done any more.
    steps: u64,
    jobs_done: usize,
    jobs: usize,
}

impl Meter {
    fn advance(&mut self, steps: u64) {
        self.steps += steps;
        let (done, jobs) = (self.jobs_done, self.jobs);
        self.progress.show_steps(self.steps, || format!("{done} of {jobs} jobs done"));
    }
}

/// Runs what is left of all studies, as the first of the ranks; with several, the others [`follow`] the only study.
///
/// # Errors
/// The first thing that went wrong; all finished jobs and all checkpoints are kept.
pub fn run(
    directories: &[StudyDirectory<'_>],
    threads: usize,
    interrupt: &Interrupt,
    ranks: &Arc<dyn Ranks>,
) -> Result<End, RunError> {
    let shared = shared(directories, interrupt, ranks);
    let workers = if ranks.size() > 1 { 1 } else { threads.min(shared.pending.len()).max(1) };
    std::thread::scope(|scope| -> Result<(), RunError> {
        for worker in 0..workers {
            // Where there are fewer jobs than cores, a job has several.
            let cores = threads / workers + usize::from(worker < threads % workers);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(cores.max(1)).build()?;
            let shared = &shared;
            scope.spawn(move || pool.install(|| work(shared)));
        }
        Ok(())
    })?;
    lock(&shared.meter).progress.finish();
    directories.iter().for_each(StudyDirectory::remove_empty);
    match shared.failure.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        Some(failure) => Err(failure),
        None if interrupt.requested() => Ok(End::Interrupted),
        None => Ok(End::Finished),
    }
}

fn shared<'a>(
    directories: &'a [StudyDirectory<'a>],
    interrupt: &'a Interrupt,
    ranks: &'a Arc<dyn Ranks>,
) -> Shared<'a> {
    let (mut pending, mut steps, mut total, mut jobs) = (Vec::new(), 0, 0, 0);
    for (index, directory) in directories.iter().enumerate() {
        for id in directory.study().jobs() {
            let job_steps = directory.study().steps_of(id);
            total += job_steps;
            jobs += 1;
            if directory.is_done(id) {
                steps += job_steps;
            } else {
                pending.push((index, id));
            }
        }
    }
    let meter = Meter { progress: Progress::new(total, steps), steps, jobs_done: jobs - pending.len(), jobs };
    Shared {
        directories,
        pending,
        next: AtomicUsize::new(0),
        meter: Mutex::new(meter),
        failure: Mutex::new(None),
        interrupt,
        ranks,
    }
}

impl Shared<'_> {
    fn must_stop(&self) -> bool {
        self.interrupt.requested() || lock(&self.failure).is_some()
    }
}

fn work(shared: &Shared<'_>) {
    while !shared.must_stop() {
        let Some(&(index, id)) = shared.pending.get(shared.next.fetch_add(1, Ordering::Relaxed)) else { return };
        if let Err(failure) = work_on(&shared.directories[index], id, shared) {
            lock(&shared.failure).get_or_insert(failure);
        }
    }
}

fn work_on(directory: &StudyDirectory<'_>, id: JobId, shared: &Shared<'_>) -> Result<(), RunError> {
    let mut run = directory.open_job(id)?;
    if shared.ranks.size() > 1 {
        ranks::order(shared.ranks, &Order::Begin(Box::new((id, run.save()))));
        run.work_with(shared.ranks)?;
    }
    let save = |run: &JobRun<'_>| {
        ranks::order::<()>(shared.ranks, &Order::Save);
        directory.save_job(id, run)
    };
    let mut saved_at = Instant::now();
    let mut known = run.steps();
    lock(&shared.meter).advance(known);
    while !run.is_finished() {
        if shared.must_stop() {
            return save(&run);
        }
        ranks::order::<()>(shared.ranks, &Order::Update);
        if let Some((stage, actor)) = run.advance().ended {
            directory.leave_policy(id, stage, (&actor, run.steps()))?;
        }
        if run.is_finished() {
            break;
        }
        lock(&shared.meter).advance(run.steps() - known);
        known = run.steps();
        if saved_at.elapsed() > CHECKPOINT_INTERVAL {
            save(&run)?;
            saved_at = Instant::now();
        }
    }
    let rest = run.steps() - known;
    directory.leave_job(id, &run.into_result())?;
    let mut meter = lock(&shared.meter);
    meter.jobs_done += 1;
    meter.advance(rest);
    Ok(())
}

/// Does what the first rank says, until that ends the run.
///
/// # Errors
/// When the study is not that of the first rank, or cannot be dealt to so many ranks.
pub fn follow(study: &Study, ranks: &Arc<dyn Ranks>) -> Result<(), FollowError> {
    let mut job: Option<JobRun<'_>> = None;
    loop {
        match (ranks::hear::<(JobId, JobState)>(ranks), &mut job) {
            (Order::Begin(begun), job) => {
                let (id, state) = *begun;
                job.insert(JobRun::restore(study, id, state)?).work_with(ranks)?;
            }
            (Order::Update, Some(job)) => drop(job.advance()),
            (Order::Save, Some(job)) => drop(job.save()),
            (Order::Update | Order::Save, None) | (Order::End, _) => return Ok(()),
        }
    }
}

/// Why a rank cannot do what the first one does.
#[derive(Debug, thiserror::Error)]
pub enum FollowError {
    /// It has another study.
    #[error(transparent)]
    Restore(#[from] AnalyticError),
    /// There are too many of them.
    #[error(transparent)]
    Ranks(#[from] UnequalShares),
}

#[cfg(test)]
mod tests;
