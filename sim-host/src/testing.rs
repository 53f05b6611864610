//! A small task for the unit tests of this crate.

use kestrel_core::airframe::CF2X;
use kestrel_core::dynamics::Integrator;

use crate::scenario::{
    CriticView, EndRule, Physics, Randomisation, RewardTerm, Scenario, Start, Termination, WeightedTerm,
};

/// Hover one metre above the origin, everything randomised, every kind of dense reward, short episodes.
pub(crate) fn hover() -> Scenario {
    let least = Scenario::hover(&CF2X, Physics::clean(Integrator::SemiImplicitEuler, 2, 100.0));
    Scenario {
        critic: CriticView::Privileged,
        start: Start { tilt_limit: 1.5, speed_limit: 1.0, body_rates_limit: 3.0, ..least.start },
        randomisation: Randomisation { mass: 0.1, inertia: 0.1, thrust: 0.1, rotor_lag: 0.3, wind_speed: 0.5 },
        rewards: vec![
            WeightedTerm::new(RewardTerm::Alive, 1.0),
            WeightedTerm::new(RewardTerm::Proximity { scale_m: 0.5 }, 2.0),
            WeightedTerm::new(RewardTerm::Velocity, -0.1),
            WeightedTerm::new(RewardTerm::BodyRates, -0.01),
            WeightedTerm::new(RewardTerm::ActionChange, -0.1),
            WeightedTerm::new(RewardTerm::Progress, 1.0),
            WeightedTerm::new(RewardTerm::Failure, -1.0),
        ],
        terminations: vec![
            EndRule::terminal(Termination::COLLISION),
            EndRule::terminal(Termination::Distance { limit_m: 1.5 }),
        ],
        episode_secs: 1.0,
        ..least
    }
}
