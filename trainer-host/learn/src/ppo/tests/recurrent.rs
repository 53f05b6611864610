//! Policies that remember.

use super::vision::seeing;
use super::*;
use crate::actor_critic::{Actor, Critic};

const MEMORY: MemorySettings = MemorySettings { units: 8, steps_per_window: 4 };

fn remembering() -> PpoSettings {
    let memory = Some(MEMORY);
    PpoSettings { environments: 2 * ENV_BATCH, minibatch: 4 * ENV_BATCH, memory, ..settings() }
}

fn differentiated(index: usize, trainer: &Trainer, (actor, critic): (&Actor, &Critic)) -> Shard {
    let mut encoders = EncoderWeights::default();
    encoders.arrange(actor, critic);
    let networks = Networks { actor, critic, encoders: &encoders };
    let mut shard = Shard::new(actor, critic);
    let settings = PpoSettings { clip_range: 10.0, ..remembering() };
    let columns = trainer.columns();
    let sample_weight = 1.0 / (4 * columns) as f32;
    let loss = Loss { settings: &settings, sample_weight, imitation_weight: 0.0 };
    let window = trainer.env_batches[0].rollout().window(index);
    loss.differentiate(window, &networks, &mut SliceWorkspace::new(&networks, columns), &mut shard);
    shard
}

fn loss(index: usize, trainer: &Trainer, networks: (&Actor, &Critic)) -> f64 {
    let sums = differentiated(index, trainer, networks).sums;
    (sums.policy_loss + f64::from(trainer.settings.value_weight) * sums.value_loss) / sums.samples
}

/// Along the gradient of a part of the parameters the loss rises as fast as that part is long, squared: through four steps,
/// and episodes that end between them.
#[test]
fn the_gradient_goes_back_through_time() {
    goes_back_through_time(task(true));
}

/// And through what was seen at each of them.
#[test]
fn the_gradient_goes_back_to_the_images_of_all_steps() {
    goes_back_through_time(seeing());
}

fn goes_back_through_time(task: Task) {
    let mut trainer = Trainer::new(&[task], &remembering(), Seed(21));
    trainer.update();
    trainer.collect();
    trainer.normalise_advantages();
    let mut stream = Stream::new(Seed(22), 0, Purpose::Weights);
    trainer.actor.parameters_mut().iter_mut().for_each(|value| *value += 0.03 * stream.normal());
    let (actor, critic) = (trainer.actor.clone(), trainer.critic.clone());
    let mut ended = 0;
    for index in 0..trainer.env_batches[0].rollout().windows() {
        let window: Vec<_> = trainer.env_batches[0].rollout().window(index).collect();
        assert_eq!((window.len(), window[0].batch.hidden.len()), (4, 8 * trainer.columns()));
        ended +=
            window.iter().flat_map(|slice| slice.outcomes).filter(|outcome| **outcome != Outcome::Running).count();
        let gradient = differentiated(index, &trainer, (&actor, &critic)).gradient;
        let (log_std, critic_len) = (actor.log_std_places(), critic.parameters().len());
        let (features, seen) =
            actor.encoder().map_or((0, 0), |encoder| (encoder.outputs(), encoder.parameter_count()));
        let eye = log_std.end..log_std.end + seen;
        let memory = eye.end..actor.parameters().len();
        assert_eq!(memory.len(), 3 * 8 * (OBSERVATION_LEN + features + 8 + 1));
        let parts = [(0..log_std.start, 0..0), (eye, 0..0), (memory, 0..0), (0..0, 0..critic_len)];
        for (of_actor, of_critic) in
            parts.into_iter().filter(|(of_actor, _)| !(of_actor.is_empty() && of_actor.start > 0))
        {
            let along = [&gradient.actor[of_actor.clone()], &gradient.critic[of_critic.clone()]].concat();
            let length = along.iter().map(|value| f64::from(value * value)).sum::<f64>().sqrt();
            let at = |distance: f64| {
                let (mut actor, mut critic) = (actor.clone(), critic.clone());
                let moved = actor.parameters_mut()[of_actor.clone()].iter_mut();
                for (value, slope) in moved.chain(&mut critic.parameters_mut()[of_critic.clone()]).zip(&along) {
                    *value += (distance * f64::from(*slope) / length) as f32;
                }
                loss(index, &trainer, (&actor, &critic))
            };
            let slope = (at(3e-3) - at(-3e-3)) / 6e-3;
            assert!(length > 1e-4 && (slope / length - 1.0).abs() < 0.02, "{of_actor:?}: {slope}, not {length}");
        }
    }
    assert!(ended > 100, "only {ended} episodes ended in the windows");
}

#[test]
fn threads_and_interruptions_do_not_change_a_bit_of_what_a_recurrent_policy_learns() {
    let on = |task: Task, minibatch: usize, threads: usize, resumed: bool| {
        let settings = PpoSettings { minibatch, ..remembering() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let mut trainer = Trainer::new(&[task], &settings, Seed(5));
            trainer.update();
            if resumed {
                let bytes = postcard::to_allocvec(&trainer.save()).expect("a state serialises");
                let state = postcard::from_bytes(&bytes).expect("and back");
                trainer = Trainer::restore(&[task], &settings, state).expect("it is the same run");
            }
            trainer.update();
            trainer.save()
        })
    };
    let whole = remembering().minibatch;
    for (task, minibatch) in [(task(true), whole), (task(true), 4 * 32), (task(true), 4 * 128), (seeing(), whole)]
    {
        let reference = on(task, minibatch, 1, false);
        assert!(reference.hidden.iter().any(|value| *value != 0.0), "something is remembered");
        assert_eq!(reference, on(task, minibatch, 2, true));
        assert_eq!(reference, on(task, minibatch, 5, false));
    }
}

/// What was chosen while flying is chosen again when the window is differentiated: the ratio of probabilities is one.
#[test]
fn a_window_remembers_what_was_remembered_in_flight() {
    for task in [task(false), seeing()] {
        remembers_what_was_remembered_in_flight(task);
    }
}

fn remembers_what_was_remembered_in_flight(task: Task) {
    let mut trainer = Trainer::new(&[task], &remembering(), Seed(3));
    trainer.update();
    trainer.collect();
    trainer.normalise_advantages();
    let (actor, critic) = (trainer.actor.clone(), trainer.critic.clone());
    for index in 0..trainer.env_batches[0].rollout().windows() {
        let sums = differentiated(index, &trainer, (&actor, &critic)).sums;
        assert!(sums.approx_kl.abs() / sums.samples < 1e-9, "window {index}: {}", sums.approx_kl);
    }
}

#[test]
fn sizes_that_are_no_whole_windows_are_refused() {
    let said = |settings: PpoSettings| settings.check().unwrap_err().to_string();
    let steps = PpoSettings { steps_per_rollout: 10, ..remembering() };
    assert_eq!(said(steps), "steps_per_rollout is 10, expected a multiple of 4: whole windows of a memory");
    let samples = PpoSettings { minibatch: 384, ..remembering() };
    let expected = "a multiple of 1024, or an eighth, a quarter or half of it: whole windows of a memory";
    assert_eq!(said(samples), format!("minibatch is 384, expected {expected}"));
    let none = PpoSettings { memory: Some(MemorySettings { units: 0, ..MEMORY }), ..remembering() };
    assert_eq!(said(none), "memory.units is 0, expected at least 1");
}
