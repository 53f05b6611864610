//! A few drones in a world, free flight by the core and contacts by the solver.

use kestrel_core::airframe::Airframe;
use kestrel_core::reference::bullet::{Bullet, BulletMode, BulletState, Quirks};
use kestrel_core::vehicle::State;
use kestrel_sim::contact::{Arena, ContactMemory, ContactReport, ContactSolver, Motion};
use kestrel_sim::world::{Pose, World};
use nalgebra::Vector3;

/// The reference's physics step \[s\].
pub(crate) const STEP_SECS: f64 = 1.0 / 240.0;

/// Drones of one kind and what they can touch.
pub(crate) struct Flight {
    pub(crate) bullet: Bullet<f64>,
    pub(crate) arena: Arena,
    solver: ContactSolver,
    memory: ContactMemory,
    pub(crate) drones: Vec<BulletState<f64>>,
    pub(crate) movables: Vec<Motion>,
}

impl Flight {
    /// Drones at the given places; as the reference with `ContactReport::Bullet`, else without its quirks.
    pub(crate) fn new(
        world: &World,
        airframe: &Airframe,
        mode: BulletMode,
        report: ContactReport,
        drones: Vec<BulletState<f64>>,
    ) -> Self {
        let quirks = match report {
            ContactReport::Bullet => Quirks::upstream(),
            ContactReport::Touch => Quirks::none(),
        };
        let arena = Arena::new(world, airframe, report);
        Self {
            bullet: Bullet::new(airframe, mode, quirks),
            solver: ContactSolver::new(&arena, world, airframe),
            arena,
            memory: ContactMemory::default(),
            drones,
            movables: world.movables.iter().map(|movable| Motion::let_go(movable.solid.pose)).collect(),
        }
    }

    /// One physics step with the same rotor speeds \[rad/s\] for all drones.
    pub(crate) fn step(&mut self, rotor_speeds: &[f64; 4]) {
        let swarm: Vec<Vector3<f64>> = self.drones.iter().map(|drone| drone.motion.position).collect();
        let before: Vec<Motion> = self.drones.iter().map(|drone| motion(&drone.motion)).collect();
        for drone in &mut self.drones {
            *drone = self.bullet.step(drone, rotor_speeds, &swarm, STEP_SECS);
        }
        let free: Vec<Motion> = self.drones.iter().map(|drone| motion(&drone.motion)).collect();
        let mut after = free.clone();
        self.solver.resolve(&before, &mut after, &mut self.movables, &mut self.memory, STEP_SECS);
        for (drone, (motion, free)) in self.drones.iter_mut().zip(after.iter().zip(&free)) {
            if motion != free {
                drone.motion.position = motion.pose.position;
                drone.motion.world_from_body = motion.pose.world_from_body;
                drone.motion.velocity = motion.velocity;
                drone.motion.body_rates = motion.body_rates;
            }
        }
    }

    /// The only drone, or the first of several.
    pub(crate) fn drone(&self) -> &State<f64> {
        &self.drones[0].motion
    }

    /// Its pose.
    pub(crate) fn pose(&self) -> Pose {
        motion(self.drone()).pose
    }
}

/// A level drone that flies with this velocity \[m/s\].
pub(crate) fn level(position: [f64; 3], velocity: [f64; 3]) -> BulletState<f64> {
    BulletState::placed(State {
        position: position.into(),
        world_from_body: kestrel_core::attitude::Attitude::level(),
        velocity: velocity.into(),
        body_rates: Vector3::zeros(),
        rotor_speeds: [0.0; 4],
    })
}

fn motion(state: &State<f64>) -> Motion {
    Motion {
        pose: Pose { position: state.position, world_from_body: state.world_from_body },
        velocity: state.velocity,
        body_rates: state.body_rates,
    }
}
