//! What a user's own crate can add without a fork: an environment, a regulariser of continual learning, a reward and a
//! termination.
//!
//! `cargo run --manifest-path tests/downstream/Cargo.toml` trains on one task, then on another with the regulariser and
//! without; `tests/downstream/run` a drone too, on a task whose reward and end are its own. Each fails if nothing was
//! learned or nothing kept.

#[cfg(feature = "drones")]
mod climb;

use kestrel_core::seed::{Purpose, Seed, Stream};
use kestrel_learn::actor_critic::Gradient;
use kestrel_learn::environment::{Environment, Episode, Outcome, TaskShape, evaluate};
use kestrel_learn::ppo::{CarryOver, PpoSettings, Trainer};
use kestrel_learn::regulariser::{EndedTask, FineTuning, Learning, Regulariser};
use kestrel_learn::schedule::Schedule;

/// Steps of an episode, which is then truncated.
const STEPS: u32 = 20;

/// Carts on a line, pushed towards a place of the task's; the reward is the negative distance from it.
struct Carts {
    place: f32,
    carts: Vec<(f32, f32, u32)>,
    streams: Vec<Stream>,
    observations: Vec<f32>,
    final_observations: Vec<f32>,
    rewards: Vec<f32>,
    outcomes: Vec<Outcome>,
    episodes: Vec<Episode>,
}

impl Carts {
    fn start(stream: &mut Stream) -> (f32, f32, u32) {
        (stream.between(-0.2, 0.2), 0.0, 0)
    }

    fn observe(&mut self) {
        for (row, cart) in self.carts.iter().enumerate() {
            self.observations[row] = cart.0;
        }
    }
}

impl Environment for Carts {
    type Task = f32;
    type State = Vec<(f32, f32, u32)>;

    fn name(_task: &f32) -> &str {
        "carts"
    }

    fn shape(_task: &f32) -> TaskShape {
        TaskShape { agents: 1, observation_len: 1, action_len: 1, ..TaskShape::default() }
    }

    fn begin(task: &f32, seed: Seed, first: u32, count: usize) -> Self {
        let stream = |index: usize| Stream::new(seed, first + index as u32, Purpose::Reset);
        let mut streams: Vec<_> = (0..count).map(stream).collect();
        let mut carts = Self {
            place: *task,
            carts: streams.iter_mut().map(Self::start).collect(),
            streams,
            observations: vec![0.0; count],
            final_observations: vec![0.0; count],
            rewards: vec![0.0; count],
            outcomes: vec![Outcome::Running; count],
            episodes: Vec::new(),
        };
        carts.observe();
        carts
    }

    fn step(&mut self, actions: &[f32]) {
        for (row, cart) in self.carts.iter_mut().enumerate() {
            cart.0 += 0.1 * actions[row].clamp(-1.0, 1.0);
            self.rewards[row] = -(cart.0 - self.place).abs();
            cart.1 += self.rewards[row];
            cart.2 += 1;
            self.outcomes[row] = Outcome::Running;
            if cart.2 == STEPS {
                self.outcomes[row] = Outcome::Truncated;
                self.final_observations[row] = cart.0;
                let episode = Episode { steps: STEPS, total_reward: cart.1, success: None, terms: Vec::new() };
                self.episodes.push(episode);
                *cart = Self::start(&mut self.streams[row]);
            }
        }
        self.observe();
    }

    fn observations(&self) -> &[f32] {
        &self.observations
    }

    fn rewards(&self) -> &[f32] {
        &self.rewards
    }

    fn outcomes(&self) -> &[Outcome] {
        &self.outcomes
    }

    fn final_observations(&self) -> &[f32] {
        &self.final_observations
    }

    fn take_episodes(&mut self) -> Vec<Episode> {
        std::mem::take(&mut self.episodes)
    }

    fn save(&self) -> Self::State {
        self.carts.clone()
    }

    fn restore(&mut self, state: &Self::State) -> bool {
        self.carts.clone_from(state);
        self.observe();
        true
    }
}

/// The policy stays near the last task's, by plain L2.
struct NearLast {
    strength: f32,
    last: Vec<f32>,
}

impl Regulariser for NearLast {
    fn stored_bytes(&self) -> usize {
        size_of_val(self.last.as_slice())
    }

    fn add_gradient(&mut self, networks: Learning<'_>, gradient: &mut Gradient) {
        let parameters = networks.actor.parameters().iter().zip(&self.last);
        for (gradient, (now, last)) in gradient.actor.iter_mut().zip(parameters) {
            *gradient += self.strength * (now - last);
        }
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        self.last = ended.actor.parameters().to_vec();
    }
}

fn trainer(place: f32, seed: u64) -> Trainer<Carts> {
    let settings = PpoSettings {
        environments: 256,
        steps_per_rollout: STEPS as usize,
        minibatch: 1024,
        discount: 0.9,
        learning_rate: Schedule::Constant(3e-3),
        ..PpoSettings::default()
    };
    Trainer::new(&[place], &settings, Seed(seed))
}

fn mean_return(place: f32, trainer: &Trainer<Carts>) -> f32 {
    let returns = evaluate::<Carts>(&place, trainer.actor(), Seed(9), 64);
    returns.iter().sum::<f32>() / returns.len() as f32
}

/// Returns of the first task before any learning and after it, and how far the second task moves the policy's parameters.
fn two_tasks(regulariser: &mut impl Regulariser) -> [f32; 3] {
    let mut first = trainer(0.5, 0);
    let before = mean_return(0.5, &first);
    (0..20).for_each(|_| drop(first.update_with(regulariser)));
    let learned = mean_return(0.5, &first);
    first.consolidate(regulariser);
    let mut second = trainer(-0.5, 1);
    second.start_from(&first.warm_start(CarryOver::CarriedOver, CarryOver::Reinitialised));
    (0..20).for_each(|_| drop(second.update_with(regulariser)));
    let moved = second.actor().parameters().iter().zip(first.actor().parameters());
    [before, learned, moved.map(|(now, then)| (now - then).powi(2)).sum::<f32>().sqrt()]
}

fn main() {
    let [before, learned, free] = two_tasks(&mut FineTuning);
    let [_, _, near] = two_tasks(&mut NearLast { strength: 10.0, last: Vec::new() });
    println!(
        "return {before:.2} untrained, {learned:.2} learned; another task moves the policy by {free:.2}, regularised by {near:.2}"
    );
    assert!(learned > before + 1.0, "PPO learns the environment");
    assert!(near < 0.5 * free, "the regulariser keeps the policy near the first task's");
    #[cfg(feature = "drones")]
    {
        let [before, learned] = climb::returns().expect("the task is right");
        println!("climb: return {before:.2} untrained, {learned:.2} learned, of 20 for the whole way up");
        assert!(before < 15.0 && learned > 18.0, "PPO learns by a reward and a termination of its user's");
        println!("1 passed; 0 failed");
    }
    println!("2 passed; 0 failed");
}
