use super::*;
use crate::network::InputBatch;
use crate::pendulum::{Pendulum, SwingUp};
use crate::ppo::CarryOver;
use crate::ranks::threads::run_as;
use crate::regulariser::{
    Boundaries, CompactCoresetSettings, CoresetSettings, EndedTask, Flight, RegulariserSettings,
    ShippedRegulariser, Strength,
};

fn settings() -> AnalyticSettings {
    AnalyticSettings { environments: 128, steps_per_window: 20, adjoint_limit: 1e9, ..AnalyticSettings::default() }
}

fn remembering() -> AnalyticSettings {
    AnalyticSettings { memory_units: 8, actor_hidden: vec![16], steps_per_window: 10, ..settings() }
}

fn trainer(settings: &AnalyticSettings) -> AnalyticTrainer<Pendulum> {
    AnalyticTrainer::new(&[SwingUp], settings, Seed(1)).unwrap()
}

/// Rewards of the first window with a policy.
fn rewards(settings: &AnalyticSettings, actor: &Actor) -> f64 {
    let mut trainer = trainer(settings);
    trainer.batches.iter_mut().for_each(|batch| batch.fly(actor));
    trainer.batches.iter().map(|batch| batch.reward).sum()
}

#[test]
fn the_gradient_of_a_window_is_that_of_differences() {
    check_gradient(&settings());
}

#[test]
fn the_gradient_through_a_memory_is_that_of_differences() {
    check_gradient(&remembering());
}

fn check_gradient(settings: &AnalyticSettings) {
    let mut trainer = trainer(settings);
    // The first actions are nearly zero; larger ones show more.
    trainer.actor.parameters_mut().iter_mut().for_each(|parameter| *parameter *= 1.5);
    let actor = trainer.actor.clone();
    let mut gradient = vec![0.0; actor.parameters().len()];
    for batch in &mut trainer.batches {
        batch.fly(&actor);
        batch.differentiate(&actor, 1e9);
        gradient.iter_mut().zip(&batch.gradient).for_each(|(sum, value)| *sum += value);
    }
    let mut stream = Stream::new(Seed(2), 0, Purpose::Weights);
    for _ in 0..4 {
        let direction: Vec<f32> = gradient.iter().map(|_| stream.normal()).collect();
        let expected: f64 = gradient.iter().zip(&direction).map(|(one, other)| f64::from(one * other)).sum();
        let moved = |by: f32| {
            let mut actor = actor.clone();
            actor.parameters_mut().iter_mut().zip(&direction).for_each(|(value, way)| *value += by * way);
            rewards(settings, &actor)
        };
        let found = (moved(1e-3) - moved(-1e-3)) / 2e-3;
        assert!((found - expected).abs() < 0.01 * expected.abs() + 1.0, "{found} {expected}");
    }
}

#[test]
fn bits_depend_neither_on_threads_nor_on_an_interruption() {
    check_bits(&settings());
    check_bits(&remembering());
}

fn check_bits(settings: &AnalyticSettings) {
    let run = |threads: usize, is_interrupted: bool| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut trainer = trainer(settings);
            for _ in 0..3 {
                trainer.update();
                if is_interrupted {
                    trainer = AnalyticTrainer::restore(&[SwingUp], settings, trainer.save()).unwrap();
                }
            }
            trainer.actor.parameters().to_vec()
        })
    };
    let bits = run(1, false);
    assert_eq!(run(3, false), bits);
    assert_eq!(run(2, true), bits);
}

#[test]
fn any_number_of_ranks_comes_to_the_same_bits() {
    for settings in [settings(), remembering()] {
        let course = |ranks: &Arc<dyn Ranks>| {
            let mut trainer = trainer(&AnalyticSettings { environments: 256, ..settings.clone() });
            trainer.work_with(ranks).unwrap();
            let kept = RegulariserSettings::CompactCoreset(compact(8192));
            let networks = Learning { actor: &trainer.actor, critic: &trainer.critic };
            let mut regulariser = kept.begin(networks);
            (0..12).for_each(|_| drop(trainer.update()));
            trainer.consolidate(&mut regulariser);
            let mut metrics = trainer.update_with(&mut regulariser);
            (metrics.rollout_secs, metrics.update_secs) = (0.0, 0.0);
            (trainer.save(), format!("{metrics:?}"), regulariser)
        };
        let alone = course(&ranks::alone());
        for size in [2, 4] {
            for found in run_as(size, |ranks| course(&ranks)) {
                assert!(found == alone, "{size} ranks");
            }
        }
    }
}

#[test]
fn ranks_that_cannot_have_the_same_share_are_refused() {
    let mut messages = run_as(3, |ranks| trainer(&settings()).work_with(&ranks).unwrap_err().to_string());
    messages.dedup();
    assert_eq!(messages.len(), 1);
    assert!(messages[0].contains("3 ranks cannot share") && messages[0].contains("batches of"), "{messages:?}");
}

#[test]
fn several_tasks_are_dealt_to_the_batches() {
    let learn = |tasks: &[SwingUp]| {
        let mut trainer = AnalyticTrainer::<Pendulum>::new(tasks, &settings(), Seed(1)).unwrap();
        (0..3).for_each(|_| drop(trainer.update()));
        trainer.actor.clone()
    };
    assert_eq!(learn(&[SwingUp, SwingUp]), learn(&[SwingUp]));
}

/// A policy that has learned for a while, and what is to be kept of it.
fn at_the_end_of_a_task(kept: &RegulariserSettings) -> (AnalyticTrainer<Pendulum>, ShippedRegulariser) {
    let mut trainer = trainer(&settings());
    (0..10).for_each(|_| drop(trainer.update()));
    let mut memory = kept.begin(Learning { actor: &trainer.actor, critic: &trainer.critic });
    trainer.consolidate(&mut memory);
    (trainer, memory)
}

#[test]
fn what_is_kept_of_a_task_holds_the_policy() {
    let kept = RegulariserSettings::Coreset(CoresetSettings { bytes: Some(8192), strength: 100.0 });
    let (before, memory) = at_the_end_of_a_task(&kept);
    let moved = |mut memory: ShippedRegulariser| {
        let mut trainer = before.clone();
        (0..30).for_each(|_| drop(trainer.update_with(&mut memory)));
        let slice = before.batches[0].steps[7].inputs.clone();
        let act = |actor: &Actor| {
            let mut actions = vec![0.0; slice.len() / 3];
            actor.act_mean(InputBatch::without_images(&slice), &mut actions);
            actions
        };
        let actions = act(trainer.actor()).into_iter().zip(act(before.actor()));
        actions.map(|(one, other)| (one - other).powi(2)).sum::<f32>()
    };
    let (held, free) = (moved(memory), moved(ShippedRegulariser::None));
    assert!(held < 0.1 * free, "{held} {free}");
}

fn compact(bytes: usize) -> CompactCoresetSettings {
    CompactCoresetSettings { bytes, strength: Strength::Fixed(100.0), boundaries: Boundaries::Told }
}

#[test]
fn the_gradient_at_the_end_of_a_task_is_that_of_its_loss() {
    let (mut trainer, _) = at_the_end_of_a_task(&RegulariserSettings::None);
    let samples = trainer.steps_in_update() as f32;
    let (gradient, visited) = trainer.ended(|ended| {
        let sizes = ended.visited.iter().map(|batch| (batch.columns, batch.slices.len())).collect::<Vec<_>>();
        (ended.gradient.to_vec(), sizes)
    });
    assert_eq!(visited, [(64, 20), (64, 20)]);
    let sums =
        trainer.batches.iter().map(|batch| &batch.gradient).fold(vec![0.0; gradient.len()], |sums, batch| {
            sums.iter().zip(batch).map(|(sum, value)| sum + value).collect()
        });
    assert!(gradient.iter().zip(&sums).all(|(value, sum)| *value == -sum / samples));
}

#[test]
fn a_task_begins_with_what_another_has_learned() {
    let (earlier, _) = at_the_end_of_a_task(&RegulariserSettings::None);
    for learner in [CarryOver::CarriedOver, CarryOver::Reinitialised] {
        let mut later = trainer(&settings());
        later.start_from(&earlier.warm_start(CarryOver::Reinitialised, learner));
        assert_eq!(later.actor, earlier.actor);
        assert_eq!(later.optimiser == earlier.optimiser, learner == CarryOver::CarriedOver);
    }
}

/// Counts the windows that it is shown, and what they hold.
#[derive(Default)]
struct Watcher(Vec<(usize, usize)>);

impl Regulariser for Watcher {
    fn stored_bytes(&self) -> usize {
        0
    }

    fn add_gradient(&mut self, _networks: Learning<'_>, _gradient: &mut Gradient) {}

    fn consolidate(&mut self, _ended: &EndedTask<'_>) {}

    fn watches(&self) -> bool {
        true
    }

    fn watch(&mut self, flight: &Flight<'_>) -> bool {
        self.0.push((flight.visited.len(), flight.visited[0].slices.len()));
        self.0.len() == 2
    }
}

#[test]
fn a_regulariser_that_watches_is_shown_every_window_and_its_word_is_passed_on() {
    let (mut trainer, mut watcher) = (trainer(&settings()), Watcher::default());
    let found = [(); 3].map(|()| trainer.update_with(&mut watcher).boundary);
    assert_eq!(found, [false, true, false]);
    assert_eq!(watcher.0, [(2, 20); 3]);
}

#[test]
fn what_does_not_fit_is_refused() {
    let odd = AnalyticSettings { environments: 100, ..settings() };
    let refusal = AnalyticTrainer::<Pendulum>::new(&[SwingUp], &odd, Seed(0)).unwrap_err();
    assert_eq!(refusal.to_string(), "100 environments: expected a multiple of 64");
    let wide = AnalyticSettings { actor_hidden: vec![8], ..settings() };
    let refusal =
        AnalyticTrainer::<Pendulum>::restore(&[SwingUp], &wide, trainer(&settings()).save()).unwrap_err();
    assert!(refusal.to_string().contains("the saved actor has layers [3, 64, 64, 1]"), "{refusal}");
}

#[test]
fn an_ended_episode_is_forgotten() {
    let mut trainer = trainer(&remembering());
    for _ in 0..3 {
        trainer.update();
    }
    let batch = &mut trainer.batches[0];
    batch.restart(0.5, &mut Stream::new(Seed(5), 0, Purpose::Shuffle));
    let hidden = &batch.memory.as_ref().unwrap().hidden;
    let fresh = (0..Pendulum::ENVIRONMENTS).filter(|row| hidden[*row] == 0.0).collect::<Vec<_>>();
    assert!(fresh.len() > 16 && fresh.len() < 48, "{fresh:?}");
    assert!(
        fresh.iter().all(|row| hidden
            .iter()
            .skip(*row)
            .step_by(Pendulum::ENVIRONMENTS)
            .all(|value| *value == 0.0))
    );
}

#[test]
fn an_action_beyond_its_limit_hears_the_way_back_only() {
    assert_eq!([heard(1.5, 1.0), heard(1.5, -1.0), heard(-1.5, -1.0), heard(-1.5, 1.0)], [0.0, -1.0, 0.0, 1.0]);
    assert_eq!(heard(0.5, 1.0), 1.0);
}
