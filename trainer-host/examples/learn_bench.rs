//! bench
use kestrel_core::{
    action::{ActionSpace, RotorSpeeds},
    airframe::CF2X,
    dynamics::Integrator,
    observation::{ObservationLayout, PilotLayout},
    vehicle::Ground,
};
use kestrel_sim::{scenario::*, seed::Seed};
use kestrel_train::{ppo::*, schedule::Schedule};
use nalgebra::Vector3;
use std::time::Instant;

fn hover() -> Scenario {
    Scenario {
        name: "hover".into(),
        aviary: Aviary { goal: Vector3::new(0.0, 0.0, 1.5), solids: vec![], floor: Floor::Solid },
        airframe: CF2X,
        physics: Physics {
            integrator: Integrator::SemiImplicitEuler,
            substeps: 1,
            control_secs: 0.01,
            ground: Ground::Distant,
        },
        action: ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.3)),
        observation: ObservationLayout::Pilot(PilotLayout {
            position_scale_m: 1.0,
            velocity_scale: 2.0,
            body_rates_scale: 10.0,
        }),
        critic: CriticView::Observation,
        start: Start {
            position: StartPosition::AroundGoal { nearest_m: 0.0, farthest_m: 0.5 },
            tilt_limit: 1.57,
            speed_limit: 1.0,
            body_rates_limit: 3.0,
        },
        randomisation: Randomisation { mass: 0.1, inertia: 0.1, thrust: 0.1, rotor_lag: 0.3, wind_speed: 0.0 },
        rewards: vec![
            WeightedTerm { term: RewardTerm::Proximity { scale_m: 0.1 }, weight: 1.0 },
            WeightedTerm { term: RewardTerm::Alive, weight: 1.0 },
            WeightedTerm { term: RewardTerm::Distance, weight: -1.0 },
            WeightedTerm { term: RewardTerm::BodyRates, weight: -0.005 },
            WeightedTerm { term: RewardTerm::Velocity, weight: -0.05 },
            WeightedTerm { term: RewardTerm::Failure, weight: -2.0 },
        ],
        terminations: vec![Termination::Collision, Termination::Distance { limit_m: 1.4 }],
        episode_secs: 5.0,
        success: Success::Settle { radius_m: 0.05, within_secs: 4.0 },
    }
}

fn main() {
    let args: Vec<usize> = std::env::args().skip(1).map(|a| a.parse().unwrap()).collect();
    let (envs, steps, epochs, minibatch, updates, threads) =
        (args[0], args[1], args[2], args[3], args[4], args[5]);
    let settings = PpoSettings {
        environments: envs,
        steps_per_rollout: steps,
        total_steps: (envs * steps * updates) as u64,
        epochs: epochs as u32,
        minibatch,
        discount: 0.99,
        gae_lambda: 0.95,
        clip_range: 0.2,
        learning_rate: Schedule::Linear { from: 1e-3, to: 1e-4 },
        entropy_weight: 0.0,
        value_weight: 0.5,
        gradient_norm_limit: 1.0,
        initial_log_std: -0.7,
        lowest_log_std: -2.5,
        highest_log_std: 0.5,
        actor_hidden: vec![64, 64],
        critic_hidden: vec![64, 64],
        target_kl: None,
        reward_scale: 1.0,
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut trainer = Trainer::new(&hover(), &settings, Seed(1));
        let mut sums = (0.0, 0.0);
        let start = Instant::now();
        for update in 0..updates {
            let m = trainer.update();
            sums = (sums.0 + m.rollout_secs, sums.1 + m.update_secs);
            if update % (updates / 15).max(1) == 0 {
                println!("{:9} return {:?} len {:?} success {:?} kl {:.4} clip {:.3} ev {:.3} logstd {:.2} vl {:.4} gn {:.3}", m.steps, m.episode_return, m.episode_length, m.success_rate, m.approx_kl, m.clip_fraction, m.explained_variance, m.log_std, m.value_loss, m.gradient_norm);
            }
        }
        let n = (envs * steps * updates) as f64;
        println!("wall {:.2}s, {:.0} k steps/s; rollout {:.0} ns/step wall, update {:.0} ns/(step epoch) wall", start.elapsed().as_secs_f64(), n / start.elapsed().as_secs_f64() / 1e3, sums.0 / n * 1e9, sums.1 / n * 1e9 / epochs as f64);
    });
}
