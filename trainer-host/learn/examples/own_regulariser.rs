//! A regulariser of one's own: after a task, the policy stays near the one that learned it, by plain L2.
//!
//! `cargo run --release -p kestrel-learn --example own_regulariser`

use kestrel_core::seed::Seed;
use kestrel_learn::actor_critic::{Actor, Gradient};
use kestrel_learn::pendulum::{Pendulum, SwingUp};
use kestrel_learn::ppo::{CarryOver, PpoSettings, Trainer};
use kestrel_learn::regulariser::{EndedTask, FineTuning, Learning, Regulariser};

/// ½ `strength` ‖θ − θ′‖², θ′ those of the last task's end, of all parameters of the policy.
struct NearLast {
    strength: f32,
    last: Vec<f32>,
}

impl Regulariser for NearLast {
    fn stored_bytes(&self) -> usize {
        size_of_val(self.last.as_slice())
    }

    fn add_gradient(&mut self, networks: Learning<'_>, gradient: &mut Gradient) {
        // Before the first task has ended there is nothing to stay near to.
        let parameters = networks.actor.parameters().iter().zip(&self.last);
        for (gradient, (now, last)) in gradient.actor.iter_mut().zip(parameters) {
            *gradient += self.strength * (now - last);
        }
    }

    fn consolidate(&mut self, ended: &EndedTask<'_>) {
        self.last = ended.actor.parameters().to_vec();
    }
}

/// How far a second training moves the policy of a first.
fn distance(regulariser: &mut impl Regulariser) -> f32 {
    let settings = PpoSettings { environments: 256, minibatch: 1024, discount: 0.9, ..PpoSettings::default() };
    let trainer = |seed| Trainer::<Pendulum>::new(&[SwingUp], &settings, Seed(seed));
    let mut first = trainer(0);
    (0..5).for_each(|_| drop(first.update_with(regulariser)));
    first.consolidate(regulariser);
    let mut second = trainer(1);
    second.start_from(&first.warm_start(CarryOver::CarriedOver, CarryOver::Reinitialised));
    (0..5).for_each(|_| drop(second.update_with(regulariser)));
    let parameters = |actor: &Actor| actor.parameters().to_vec();
    let (then, now) = (parameters(first.actor()), parameters(second.actor()));
    then.iter().zip(&now).map(|(then, now)| (then - now).powi(2)).sum::<f32>().sqrt()
}

fn main() {
    let free = distance(&mut FineTuning);
    let near = distance(&mut NearLast { strength: 1.0, last: Vec::new() });
    println!("five more updates move the policy by {free:.2}, regularised by {near:.2}");
    assert!(near < free, "the penalty keeps the policy near");
}
