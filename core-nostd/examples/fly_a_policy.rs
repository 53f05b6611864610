//! Flies the trained Crazyflie policy of `assets/pilots` in the core's own physics, without simulator or trainer.
//!
//! Run it with `cargo run -p kestrel-core --example fly_a_policy`.

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use kestrel_core::dynamics::Integrator;
use kestrel_core::nalgebra::Vector3;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{Aligned, PolicyError, PolicyFile};
use kestrel_core::vehicle::{Air, State, Vehicle};

fn main() -> Result<(), PolicyError> {
    let policy = Aligned(*include_bytes!("../../assets/pilots/hover.kestrel"));
    let mut pilot = Pilot::new(PolicyFile::parse(&policy.0)?);
    pilot.self_test()?;
    let (crazyflie, goal) = (Vehicle::<f32>::new(&CF2X), Vector3::new(0.0, 0.0, 1.0));
    let mut drone = State {
        position: Vector3::new(0.3, -0.2, 0.8),
        world_from_body: Attitude::level(),
        velocity: Vector3::zeros(),
        body_rates: Vector3::zeros(),
        rotor_speeds: [CF2X.hover_rotor_speed() as f32; 4],
    };
    let secs = pilot.policy().metadata().control_period_secs;
    for period in 0..(5.0 / secs) as usize {
        let rotor_targets = pilot.tick(&drone, &goal);
        drone = Integrator::SemiImplicitEuler.advance(&crazyflie, &drone, &rotor_targets, &Air::still(), secs);
        if period % 50 == 0 {
            let distance = (drone.position - goal).norm();
            println!("{:4.1} s: {distance:.3} m from the goal", period as f32 * secs);
        }
    }
    assert!((drone.position - goal).norm() < 0.1, "the policy hovers");
    Ok(())
}
