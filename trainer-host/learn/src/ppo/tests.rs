mod distributed;
mod probe;
mod recurrent;
mod special_cases;
mod teaching;
mod teams;
mod vision;

use std::iter;

use kestrel_core::activation::Activation;

use super::*;
use crate::network::{InputBatch, Mlp};
use crate::rollout::{ENV_BATCH, MinibatchSlice, Rollout};
use crate::schedule::Schedule;
use probe::{OBSERVATION_LEN, PRIVILEGED_LEN, Probe, Task};

type Trainer = super::Trainer<Probe>;
type TrainerState = super::TrainerState<Vec<probe::Point>>;

/// Points on their own; critics may know their drift. Short episodes, so that a rollout sees truncations too.
fn task(is_privileged: bool) -> Task {
    Task { agents: 1, is_privileged, image: None, has_teacher: false, episode_steps: 20 }
}

fn settings() -> PpoSettings {
    PpoSettings {
        environments: 3 * ENV_BATCH,
        steps_per_rollout: 12,
        total_steps: 1_000_000,
        epochs: 2,
        minibatch: 5 * ENV_BATCH,
        discount: 0.98,
        gae_lambda: 0.95,
        clip_range: 0.2,
        learning_rate: Schedule::KlAdaptive { initial: 1e-3, target: 0.01, low: 1e-4, high: 1e-2 },
        entropy_weight: 0.01,
        value_weight: 0.5,
        gradient_norm_limit: 0.5,
        initial_log_std: -0.7,
        lowest_log_std: -2.5,
        highest_log_std: 0.5,
        actor_hidden: vec![16, 16],
        critic_hidden: vec![16],
        activation: Activation::Tanh,
        encoder: EncoderSettings::default(),
        memory: None,
        target_kl: None,
        critic_scope: CriticScope::Own,
        value_scale: ValueScaling::Fixed,
        quantised_from: None,
        teacher: None,
        reward_scale: 0.5,
    }
}

fn on_threads(threads: usize, updates: u32, critic: bool) -> TrainerState {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(|| {
        let mut trainer = Trainer::new(&[task(critic)], &settings(), Seed(5));
        for _ in 0..updates {
            trainer.update();
        }
        trainer.save()
    })
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let reference = on_threads(1, 3, true);
    assert_eq!(reference, on_threads(2, 3, true));
    assert_eq!(reference, on_threads(7, 3, true));
}

#[test]
fn a_resumed_run_comes_to_the_same_bits() {
    let (task, settings) = (task(false), settings());
    let mut straight = Trainer::new(&[task], &settings, Seed(6));
    (0..2).for_each(|_| drop(straight.update()));
    let bytes = postcard::to_allocvec(&straight.save()).expect("a state serialises");
    let state = postcard::from_bytes(&bytes).expect("and back");
    let mut resumed = Trainer::restore(&[task], &settings, state).expect("it is the same run");
    assert_eq!(resumed.updates(), 2);
    for _ in 0..2 {
        let (expected, found) = (straight.update(), resumed.update());
        let timeless = |metrics: UpdateMetrics| UpdateMetrics { rollout_secs: 0.0, update_secs: 0.0, ..metrics };
        assert_eq!(timeless(found), timeless(expected));
    }
    assert_eq!(resumed.save(), straight.save());
}

#[test]
fn from_its_share_on_a_policy_learns_with_the_weights_of_its_export() {
    let task = task(false);
    let batch = settings().batch() as u64;
    let with = |quantised_from| PpoSettings { quantised_from, total_steps: 4 * batch, ..settings() };
    let after = |updates: u32, settings: &PpoSettings| {
        let mut trainer = Trainer::new(&[task], settings, Seed(8));
        (0..updates).for_each(|_| drop(trainer.update()));
        trainer.save()
    };
    let (exact, late) = (with(None), with(Some(0.5)));
    assert_eq!(after(2, &exact), after(2, &late));
    assert_ne!(after(3, &exact), after(3, &late));

    let mut resumed = Trainer::restore(&[task], &late, after(3, &late)).expect("the same run");
    resumed.update();
    assert_eq!(resumed.save(), after(4, &late));
}

#[test]
fn other_seeds_are_other_runs() {
    let first = |seed| Trainer::new(&[task(false)], &settings(), Seed(seed)).save();
    assert_eq!(first(1), first(1));
    assert_ne!(first(1).actor(), first(2).actor());
}

#[test]
fn a_state_of_another_run_is_refused() {
    let (flown, asked) = (task(false), settings());
    let state = Trainer::new(&[flown], &asked, Seed(7)).save();
    let refuse = |task: &Task, settings: &PpoSettings, state: &TrainerState| {
        Trainer::restore(&[*task], settings, state.clone()).expect_err("it must be refused").to_string()
    };
    let more = PpoSettings { environments: 4 * ENV_BATCH, ..asked.clone() };
    assert_eq!(refuse(&flown, &more, &state), "the saved run has 3 environment batches, the settings ask for 4");
    let wider = PpoSettings { actor_hidden: vec![16, 32], ..asked.clone() };
    assert_eq!(
        refuse(&flown, &wider, &state),
        "the saved actor has layers [6, 16, 16, 2], the settings ask for [6, 16, 32, 2]"
    );
    let privileged = task(true);
    assert_eq!(
        refuse(&privileged, &asked, &state),
        "the saved critic has layers [6, 16, 1], the settings ask for [8, 16, 1]"
    );
    let bad = PpoSettings { minibatch: 100, ..asked };
    assert_eq!(
        refuse(&flown, &bad, &state),
        "minibatch is 100, expected a positive multiple of 256, or 32, 64 or 128"
    );
}

#[test]
fn settings_out_of_range_are_named() {
    let refuse = |settings: PpoSettings| settings.check().expect_err("it must be refused").to_string();
    assert_eq!(settings().check(), Ok(()));
    assert_eq!(
        refuse(PpoSettings { environments: 0, ..settings() }),
        "environments is 0, expected a positive multiple of 256"
    );
    assert_eq!(refuse(PpoSettings { epochs: 0, ..settings() }), "epochs is 0, expected at least 1");
    assert_eq!(refuse(PpoSettings { discount: 1.5, ..settings() }), "discount is 1.5, expected 0 to 1");
    assert_eq!(
        refuse(PpoSettings { clip_range: f32::NAN, ..settings() }),
        "clip_range is NaN, expected a positive number"
    );
    let learning_rate = Schedule::KlAdaptive { initial: 1.0, target: 0.01, low: 1e-4, high: 1e-2 };
    assert_eq!(
        refuse(PpoSettings { learning_rate, ..settings() }),
        "learning_rate.initial is 1, expected low to high"
    );
}

#[test]
fn a_shuffle_keeps_every_sample_and_differs_between_epochs() {
    let trainer = Trainer::new(&[task(false)], &settings(), Seed(8));
    let flat = |epoch| -> Vec<usize> {
        trainer.shuffled(epoch).iter().map(|index| index.env_batch * 12 + index.window).collect()
    };
    let mut sorted = flat(0);
    assert_ne!(sorted, flat(1));
    sorted.sort_unstable();
    assert!(sorted.iter().copied().eq(0..36));
}

#[test]
fn nothing_has_moved_before_the_first_step() {
    let unmoving = PpoSettings { minibatch: 36 * ENV_BATCH, epochs: 1, ..settings() };
    let metrics = Trainer::new(&[task(false)], &unmoving, Seed(9)).update();
    assert_eq!((metrics.approx_kl, metrics.clip_fraction), (0.0, 0.0));
    // Normalised advantages sum to nothing.
    assert!(metrics.policy_loss.abs() < 1e-5);
}

#[test]
fn a_target_divergence_stops_the_update() {
    let strict = PpoSettings { target_kl: Some(1e-9), learning_rate: Schedule::Constant(1e-2), ..settings() };
    let mut trainer = Trainer::new(&[task(false)], &strict, Seed(10));
    trainer.update();
    // Adam's first step is nearly the learning rate; there was no second.
    for log_std in trainer.actor().log_std() {
        let moved = (log_std - strict.initial_log_std).abs();
        assert!(moved > 0.9e-2 && moved < 1.000_1e-2, "{moved}");
    }
}

/// The whole loss of Schulman et al. 2017 in `f64`, sample by sample, without any of the kernels.
mod reference {
    use super::*;

    pub(super) struct Batch<'a> {
        pub(super) slice: MinibatchSlice<'a>,
        pub(super) settings: &'a PpoSettings,
        pub(super) actor: Mlp,
        pub(super) critic: Mlp,
    }

    impl Batch<'_> {
        /// Clipped surrogate + value error - entropy bonus, from the parameters of actor and critic in one slice.
        pub(super) fn loss(&self, parameters: &[f64]) -> f64 {
            let (actor, critic) = parameters.split_at(self.actor.parameter_count() + self.actor.outputs());
            let (network, log_std) = actor.split_at(self.actor.parameter_count());
            let sample = |index: usize| {
                let input: Vec<f64> = Self::column(self.slice.batch.values, index);
                let means = forward(&self.actor, network, &input[..self.actor.inputs()]);
                let value = forward(&self.critic, critic, &input)[0];
                let error = value - f64::from(self.slice.returns[index]);
                self.surrogate(&means, log_std, index) + f64::from(self.settings.value_weight) * error * error
            };
            let entropy: f64 = log_std.iter().sum();
            (0..ENV_BATCH).map(sample).sum::<f64>() / ENV_BATCH as f64
                - f64::from(self.settings.entropy_weight) * entropy
        }

        fn surrogate(&self, means: &[f64], log_std: &[f64], index: usize) -> f64 {
            let actions = Self::column(self.slice.actions, index);
            let log_prob: f64 = (0..self.actor.outputs())
                .map(|row| {
                    let deviation = (actions[row] - means[row]) / libm::exp(log_std[row]);
                    -0.5 * deviation * deviation - log_std[row] - 0.5 * libm::log(2.0 * std::f64::consts::PI)
                })
                .sum();
            let ratio = libm::exp(log_prob - f64::from(self.slice.log_probs[index]));
            let range = f64::from(self.settings.clip_range);
            let advantage = f64::from(self.slice.advantages[index]);
            -(ratio * advantage).min(ratio.clamp(1.0 - range, 1.0 + range) * advantage)
        }

        fn column(rows: &[f32], index: usize) -> Vec<f64> {
            rows.chunks_exact(ENV_BATCH).map(|row| f64::from(row[index])).collect()
        }
    }

    fn forward(mlp: &Mlp, parameters: &[f64], input: &[f64]) -> Vec<f64> {
        let (mut values, mut rest) = (input.to_vec(), parameters);
        for (index, pair) in mlp.widths().windows(2).enumerate() {
            let (weights, left) = rest.split_at(pair[0] * pair[1]);
            let (biases, left) = left.split_at(pair[1]);
            let dot = |row: &[f64]| row.iter().zip(&values).map(|(a, b)| a * b).sum::<f64>();
            let sums: Vec<f64> =
                weights.chunks_exact(pair[0]).zip(biases).map(|(row, bias)| dot(row) + bias).collect();
            let is_hidden = index + 2 < mlp.widths().len();
            values = sums.into_iter().map(|sum| if is_hidden { libm::tanh(sum) } else { sum }).collect();
            rest = left;
        }
        values
    }
}

/// A slice whose old log-probabilities are off by up to ±0.5, so that about half of the samples are clipped.
struct Samples {
    observations: Vec<f32>,
    actions: Vec<f32>,
    log_probs: Vec<f32>,
    advantages: Vec<f32>,
    returns: Vec<f32>,
}

impl Samples {
    fn new(actor: &Actor, features: usize) -> Self {
        let mut stream = Stream::new(Seed(12), 0, Purpose::Actions);
        let mut normals = |count: usize| -> Vec<f32> { (0..count).map(|_| stream.normal()).collect() };
        let (observations, actions) = (normals(features * ENV_BATCH), normals(actor.action_len() * ENV_BATCH));
        let (advantages, returns, shifts) = (normals(ENV_BATCH), normals(ENV_BATCH), normals(ENV_BATCH));
        let mut means = vec![0.0; actor.action_len() * ENV_BATCH];
        actor.act_mean(InputBatch::without_images(&observations), &mut means);
        let mut log_probs = vec![0.0; ENV_BATCH];
        actor.gaussian().log_probs(&means, &actions, &mut log_probs);
        for (log_prob, shift) in log_probs.iter_mut().zip(shifts) {
            *log_prob += 0.3 * shift;
        }
        Self { observations, actions, log_probs, advantages, returns }
    }

    fn slice(&self) -> MinibatchSlice<'_> {
        MinibatchSlice {
            task: 0,
            batch: InputBatch::without_images(&self.observations),
            actions: &self.actions,
            teacher_actions: &[],
            log_probs: &self.log_probs,
            advantages: &self.advantages,
            returns: &self.returns,
            outcomes: &[],
        }
    }
}

#[test]
fn the_gradient_of_the_whole_loss_is_that_of_finite_differences() {
    for action_len in [1, 3, 4, 6] {
        check_gradient(action_len);
    }
}

fn check_gradient(action_len: usize) {
    let settings = PpoSettings { entropy_weight: 0.02, ..settings() };
    let mut stream = Stream::new(Seed(13), 0, Purpose::Weights);
    let mut actor =
        Actor::state_based(ActorLengths { observation: 5, action: action_len }, &[8, 8], -0.3, &mut stream);
    for parameter in actor.parameters_mut() {
        *parameter += 0.1 * stream.normal();
    }
    let critic = Critic::state_based(7, &[9], 1, &mut stream);
    let samples = Samples::new(&actor, 7);
    let mut shard = Shard::new(&actor, &critic);
    let networks = Networks { actor: &actor, critic: &critic, encoders: &EncoderWeights::default() };
    let mut workspace = SliceWorkspace::new(&networks, ENV_BATCH);
    let loss = Loss { settings: &settings, sample_weight: 1.0 / ENV_BATCH as f32, imitation_weight: 0.0 };
    loss.differentiate(iter::once(samples.slice()), &networks, &mut workspace, &mut shard);
    assert!(shard.sums.clipped > 0.3 * ENV_BATCH as f64 && shard.sums.clipped < 0.7 * ENV_BATCH as f64);
    let log_std = actor.mlp().parameter_count();
    shard.gradient.actor[log_std..].iter_mut().for_each(|gradient| *gradient -= settings.entropy_weight);
    let gradient = [shard.gradient.actor, shard.gradient.critic].concat();
    let parameters: Vec<f64> =
        actor.parameters().iter().chain(critic.parameters()).copied().map(f64::from).collect();
    let (actor, critic) = (actor.mlp().clone(), critic.mlp().clone());
    let batch = reference::Batch { slice: samples.slice(), settings: &settings, actor, critic };
    let mut shifted = parameters.clone();
    for (index, found) in gradient.iter().enumerate() {
        let mut at = |shift: f64| {
            shifted[index] = parameters[index] + shift;
            batch.loss(&shifted)
        };
        let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
        at(0.0);
        assert!(
            (f64::from(*found) - expected).abs() < 2e-5 + 1e-4 * expected.abs(),
            "{index}: {found}, not {expected}"
        );
    }
}

#[test]
fn the_logged_losses_are_those_of_the_reference() {
    let settings = PpoSettings { entropy_weight: 0.0, ..settings() };
    let mut stream = Stream::new(Seed(14), 0, Purpose::Weights);
    let (actor, critic) = (
        Actor::state_based(ActorLengths { observation: 5, action: 4 }, &[8], -0.3, &mut stream),
        Critic::state_based(5, &[8], 1, &mut stream),
    );
    let samples = Samples::new(&actor, 5);
    let mut shard = Shard::new(&actor, &critic);
    let networks = Networks { actor: &actor, critic: &critic, encoders: &EncoderWeights::default() };
    let mut workspace = SliceWorkspace::new(&networks, ENV_BATCH);
    let loss = Loss { settings: &settings, sample_weight: 1.0 / ENV_BATCH as f32, imitation_weight: 0.0 };
    loss.differentiate(iter::once(samples.slice()), &networks, &mut workspace, &mut shard);
    let parameters: Vec<f64> =
        actor.parameters().iter().chain(critic.parameters()).copied().map(f64::from).collect();
    let (actor, critic) = (actor.mlp().clone(), critic.mlp().clone());
    let expected =
        reference::Batch { slice: samples.slice(), settings: &settings, actor, critic }.loss(&parameters);
    let found = (shard.sums.policy_loss + 0.5 * shard.sums.value_loss) / shard.sums.samples;
    assert!((found - expected).abs() < 1e-5, "{found}, not {expected}");
    assert!(shard.sums.approx_kl > 0.0);
}

#[test]
fn its_weight_falls_in_a_straight_line() {
    let teacher = TeacherSettings { weight: 3.0, until: 0.5 };
    assert_eq!([0.0, 0.25, 0.5, 1.0].map(|progress| teacher.weight_at(progress)), [3.0, 1.5, 0.0, 0.0]);
}
