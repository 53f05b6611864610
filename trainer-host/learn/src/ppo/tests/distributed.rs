//! Several processes on one run.

use super::*;
use crate::ranks::threads::run_as;
use crate::ranks::{self, Order};
use crate::regulariser::{
    Coupling, Curvature, GradientTerm, Learning, QuadraticSettings, RegulariserSettings, ShippedRegulariser,
    Strength,
};

fn shared() -> PpoSettings {
    PpoSettings { environments: 4 * ENV_BATCH, minibatch: 6 * ENV_BATCH, ..settings() }
}

/// What matters of a run of three updates, a task's end, and three more with what was kept of it.
fn course(ranks: &Arc<dyn Ranks>) -> (TrainerState, Vec<UpdateMetrics>, ShippedRegulariser) {
    let settings = shared();
    let mut trainer = Trainer::new(&[task(true)], &settings, Seed(5));
    trainer.work_with(ranks).unwrap();
    let anchor = QuadraticSettings {
        curvature: Curvature::Kronecker,
        gradient: GradientTerm::Balance,
        coupling: Coupling::Gradient,
        strength: Strength::Fixed(0.5),
        decay: 1.0,
    };
    let mut regulariser = RegulariserSettings::Quadratic(anchor)
        .begin(Learning { actor: trainer.actor(), critic: trainer.critic() });
    let mut metrics: Vec<UpdateMetrics> = (0..3).map(|_| trainer.update()).collect();
    trainer.consolidate(&mut regulariser);
    metrics.extend((0..3).map(|_| trainer.update_with(&mut regulariser)));
    for metrics in &mut metrics {
        (metrics.rollout_secs, metrics.update_secs) = (0.0, 0.0);
    }
    (trainer.save(), metrics, regulariser)
}

#[test]
fn any_number_of_ranks_comes_to_the_same_bits() {
    let alone = course(&ranks::alone());
    assert!(alone.1.iter().any(|metrics| metrics.episode_return.is_some()), "episodes end on the way");
    for size in [1, 2, 4] {
        for found in run_as(size, |ranks| course(&ranks)) {
            assert_eq!(found.0, alone.0, "{size} ranks");
            assert_eq!(format!("{:?}", found.1), format!("{:?}", alone.1), "{size} ranks");
            assert_eq!(found.2, alone.2, "{size} ranks");
        }
    }
}

#[test]
fn ranks_show_each_other_what_their_policies_remember() {
    let memory = Some(MemorySettings { units: 8, steps_per_window: 2 });
    let settings = PpoSettings { minibatch: 8 * ENV_BATCH, memory, ..shared() };
    let course = |ranks: &Arc<dyn Ranks>| {
        let mut trainer = Trainer::new(&[task(true)], &settings, Seed(5));
        trainer.work_with(ranks).unwrap();
        let ended: u64 = (0..4).map(|_| trainer.update().episodes).sum();
        (trainer.save(), ended)
    };
    let alone = course(&ranks::alone());
    assert!(alone.1 > 0, "something is forgotten on the way");
    for size in [2, 4] {
        for found in run_as(size, |ranks| course(&ranks)) {
            assert!(found == alone, "{size} ranks");
        }
    }
}

#[test]
fn work_that_cannot_be_dealt_equally_is_refused() {
    let mut messages = run_as(3, |ranks| {
        let mut trainer = Trainer::new(&[task(true)], &shared(), Seed(5));
        trainer.work_with(&ranks).unwrap_err().to_string()
    });
    messages.dedup();
    assert_eq!(messages, ["3 ranks cannot share 4 environment batches equally: use as many as divide them"]);
}

#[test]
fn orders_reach_every_rank() {
    let heard = run_as(3, |ranks| {
        if ranks.rank() == 0 {
            ranks::order(&ranks, &Order::Begin(Box::new(7_u32)));
            ranks::end(&ranks);
            return String::new();
        }
        format!("{:?}, {:?}", ranks::hear::<u32>(&ranks), ranks::hear::<u32>(&ranks))
    });
    assert_eq!(heard, ["", "Begin(7), End", "Begin(7), End"]);
}
