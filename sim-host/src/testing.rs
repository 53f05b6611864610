//! A small task for the unit tests of this crate.

use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::airframe::CF2X;
use kestrel_core::dynamics::Integrator;
use kestrel_core::observation::{ObservationLayout, PilotLayout};
use nalgebra::Vector3;

use crate::scenario::{
    Agents, Aviary, Clock, CriticView, EndRule, Goals, Physics, Randomisation, RewardTerm, Scenario, Start,
    StartPosition, Success, Termination, TimeLimit, WeightedTerm,
};
use crate::sensor::SensorSuite;
use crate::world::World;

/// Hover one metre above the origin, everything randomised, every kind of dense reward, short episodes.
pub(crate) fn hover() -> Scenario {
    Scenario {
        name: "hover".into(),
        aviary: Aviary { goal: Vector3::new(0.0, 0.0, 1.0), routes: Vec::new(), world: World::empty() },
        airframe: CF2X,
        goals: Goals::Fixed,
        agents: Agents::ONE,
        physics: Physics::clean(Integrator::SemiImplicitEuler, 2, 100.0),
        action: ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.3)),
        sensors: SensorSuite::none(),
        observation: ObservationLayout::Pilot(PilotLayout {
            position_scale_m: 1.0,
            velocity_scale: 2.0,
            body_rates_scale: 10.0,
        }),
        camera: None,
        critic: CriticView::Privileged,
        start: Start {
            position: StartPosition::AroundGoal { nearest_m: 0.0, farthest_m: 0.5 },
            heading_limit: core::f32::consts::PI,
            tilt_limit: 1.5,
            speed_limit: 1.0,
            body_rates_limit: 3.0,
        },
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
        clock: Clock::Elapsed,
        time_limit: TimeLimit::Truncates,
        success: Success::Settle { radius_m: 0.05, within_secs: 4.0 },
    }
}
