//! The simulation of a flight, in which things go wrong.

use std::cell::Cell;
use std::rc::Rc;
use std::sync::Arc;

use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use kestrel_shim::plant::{Plant, Ranges};
use kestrel_sim::contact::{Arena, ContactReport, Motion};
use kestrel_sim::flight::Flight;
use kestrel_sim::world::{Floor, Pose, World};
use nalgebra::Vector3;

use super::case::Case;
use super::fault::{EstimateFault, Fault, FaultKind};
use crate::fly::SimulatedFlight;

/// A flight that goes on as faults let it.
pub(crate) struct FailingPlant<'a> {
    flight: SimulatedFlight,
    faults: &'a [Fault],
    /// Walls and furniture without the floor, on which drones may stand.
    obstacles: Arc<Arena>,
    /// Wind without gusts \[m/s, world\].
    wind: Vector3<f64>,
    /// What the drone carries beside itself \[kg\].
    load: f64,
    /// What the vehicle knows of its state.
    known: State<f32>,
    control_secs: f64,
    periods: u64,
    clock: Rc<Cell<f64>>,
    /// After each control period, beginning with what there is before the first.
    scenes: Vec<Surroundings>,
}

/// What is around the drone.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Surroundings {
    /// Whether it touches a wall, furniture or a movable body.
    pub(crate) touching: bool,
    /// Where the movable bodies are.
    pub(crate) movables: Vec<Pose>,
}

impl<'a> FailingPlant<'a> {
    /// The drone of a case at rest, and a `clock` that it drives.
    pub(crate) fn new(case: &'a Case, clock: &Rc<Cell<f64>>) -> Self {
        let scenario = &*case.scenario;
        let flight = match case.seed {
            None => Flight::landed(scenario),
            Some(seed) => Flight::randomised(scenario, seed),
        };
        let world = World { floor: Floor::Absent, ..scenario.in_room(0).aviary.world };
        let mut plant = Self {
            faults: &case.faults,
            obstacles: Arena::shared(&world, &scenario.airframe, ContactReport::Touch, None),
            wind: flight.wind() + case.wind,
            load: 0.0,
            known: *flight.known_state(),
            control_secs: 1.0 / scenario.physics.control_rate_hz,
            periods: 0,
            clock: Rc::clone(clock),
            scenes: Vec::new(),
            flight: SimulatedFlight::new(flight),
        };
        plant.look_around();
        plant.estimate();
        plant
    }

    /// What was around the drone before every control period and after the last.
    pub(crate) fn into_scenes(self) -> Vec<Surroundings> {
        self.scenes
    }

    fn acting(&self) -> impl Iterator<Item = FaultKind> {
        let (now_secs, grace_secs) = (self.clock.get(), 0.5 * self.control_secs);
        self.faults.iter().filter(move |fault| fault.acts_at(now_secs, grace_secs)).map(|fault| fault.kind)
    }

    /// What the rotors are told, as far as they can.
    fn limited(&self, mut rotor_targets: [f32; 4]) -> [f32; 4] {
        let greatest = self.flight.flight.scenario().airframe.rotor_speed_limit as f32;
        for fault in self.acting() {
            match fault {
                FaultKind::Motor { rotor, share } => {
                    rotor_targets[rotor] = rotor_targets[rotor].min(share * greatest);
                }
                FaultKind::Thrust { rotor: Some(rotor), share } => rotor_targets[rotor] *= share.sqrt(),
                FaultKind::Thrust { rotor: None, share } => {
                    rotor_targets = rotor_targets.map(|target| target * share.sqrt());
                }
                FaultKind::LinkLoss
                | FaultKind::Estimate(_)
                | FaultKind::Load(_)
                | FaultKind::Battery(_)
                | FaultKind::Gust(_)
                | FaultKind::Policy(_) => {}
            }
        }
        rotor_targets
    }

    fn gusts(&self) -> Vector3<f64> {
        let mut wind = self.wind;
        for fault in self.acting() {
            if let FaultKind::Gust(gust) = fault {
                wind += gust;
            }
        }
        wind
    }

    /// Takes up what is to be carried, or puts it down.
    fn carry(&mut self) {
        let mut load = 0.0;
        for fault in self.acting() {
            if let FaultKind::Load(mass) = fault {
                load += mass;
            }
        }
        if load != self.load {
            self.flight.flight.add_load(load - self.load);
            self.load = load;
        }
    }

    /// What the vehicle knows from now on.
    fn estimate(&mut self) {
        let mut known = *self.flight.known_state();
        for fault in self.acting() {
            match fault {
                FaultKind::Estimate(EstimateFault::Frozen) => known = self.known,
                FaultKind::Estimate(EstimateFault::Lost) => known = known.map(|_: f32| f32::NAN),
                FaultKind::LinkLoss
                | FaultKind::Motor { .. }
                | FaultKind::Thrust { .. }
                | FaultKind::Load(_)
                | FaultKind::Battery(_)
                | FaultKind::Gust(_)
                | FaultKind::Policy(_) => {}
            }
        }
        self.known = known;
    }

    fn look_around(&mut self) {
        let movables = self.flight.flight.movables();
        let bodies: Vec<Motion> = movables.iter().map(|pose| Motion::at_rest(*pose)).collect();
        let touching = self.obstacles.touch(&pose(self.flight.state()), &bodies).obstacle;
        self.scenes.push(Surroundings { touching, movables });
    }
}

impl Plant for FailingPlant<'_> {
    fn state(&self) -> &State<f32> {
        self.flight.state()
    }

    fn known_state(&self) -> &State<f32> {
        &self.known
    }

    fn ranges(&self) -> Option<Ranges> {
        self.flight.ranges()
    }

    fn battery(&self) -> Option<f32> {
        self.acting().find_map(|fault| match fault {
            FaultKind::Battery(left) => Some(left),
            FaultKind::LinkLoss
            | FaultKind::Estimate(_)
            | FaultKind::Motor { .. }
            | FaultKind::Thrust { .. }
            | FaultKind::Load(_)
            | FaultKind::Gust(_)
            | FaultKind::Policy(_) => None,
        })
    }

    fn step(&mut self, rotor_targets: &[f32; 4]) {
        self.flight.flight.set_wind(self.gusts());
        self.carry();
        self.flight.step(&self.limited(*rotor_targets));
        self.periods += 1;
        self.clock.set(self.periods as f64 * self.control_secs);
        self.estimate();
        self.look_around();
    }
}

fn pose(state: &State<f32>) -> Pose {
    let world_from_body: Attitude<f64> = state.world_from_body.map(f64::from);
    Pose { position: state.position.cast(), world_from_body }
}
