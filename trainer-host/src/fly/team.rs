//! Several vehicles of one policy in one aviary, where they can collide.

use std::cell::RefCell;
use std::rc::Rc;

use kestrel_core::vehicle::State;
use kestrel_experiments::output::say;
use kestrel_ros::rangers::Rangers;
use kestrel_shim::autopilot::Mode;
use kestrel_shim::lockstep::{ControlPeriod, Next};
use kestrel_shim::plant::{Plant, Ranges};
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_shim::session::Fleet;
use kestrel_shim::true_state::TrueStateLog;
use kestrel_sim::flight::TeamFlight;
use kestrel_sim::scenario::Scenario;

use super::spectators::Spectators;
use super::{FlightSummary, FlyError, FlyOptions, measured};

/// Flies so many vehicles until their time is up or `interrupted` says so.
pub(super) fn fly(
    bytes: &PolicyBytes,
    scenario: &Scenario,
    options: &FlyOptions,
    interrupted: &dyn Fn() -> bool,
    spectators: Spectators,
) -> Result<FlightSummary, FlyError> {
    let count = usize::from(options.vehicles);
    let place = Rc::new(RefCell::new(SharedPlace {
        flight: TeamFlight::landed(scenario, count)?,
        rangers: Rangers::new(scenario),
        rotor_targets: vec![[0.0; 4]; count],
        spectators,
    }));
    let mut plants: Vec<Seat> = (0..count).map(|number| Seat::new(&place, number)).collect();
    let mut fleet = Fleet::open(bytes, &scenario.airframe, options.vehicles, &options.session)?;
    let mut log = TrueStateLog::create(options.true_state_log.as_deref())?;
    say(fleet.announcement())?;
    let mut failure = None;
    let mut last = (0.0, place.borrow().flight.states()[0].position, Mode::Disarmed);
    let mut watch = |period: &ControlPeriod| {
        if period.number == 0 {
            last = (period.secs, period.state.position, period.mode);
        }
        failure = failure.take().or(log.write(period).err());
        if failure.is_some() || interrupted() { Next::End } else { Next::Fly }
    };
    fleet.fly(&mut plants, &mut watch)?;
    if let Some(failure) = failure {
        return Err(failure.into());
    }
    let first = fleet.sessions().first();
    let (counts, timing) = first.map_or_else(Default::default, |first| (first.counts(), first.timing()));
    let (secs, position, mode) = last;
    Ok(FlightSummary { secs, position, mode, counts, timing })
}

/// The aviary, and what each drone's rotors are told.
struct SharedPlace {
    flight: TeamFlight,
    rangers: Rangers,
    rotor_targets: Vec<[f32; 4]>,
    spectators: Spectators,
}

impl SharedPlace {
    /// Tells of the control period that begins now, and flies it.
    fn step(&mut self) {
        let Self { flight, rotor_targets, spectators, .. } = self;
        spectators.tell(flight.states(), || flight.movables(), flight.scenario());
        flight.step(rotor_targets);
    }
}

/// One of the drones there, as a plant of its own.
struct Seat {
    place: Rc<RefCell<SharedPlace>>,
    number: usize,
    state: State<f32>,
    known_state: State<f32>,
}

impl Seat {
    fn new(place: &Rc<RefCell<SharedPlace>>, number: usize) -> Self {
        let state = place.borrow().flight.states()[number];
        Self { place: Rc::clone(place), number, state, known_state: state }
    }
}

impl Plant for Seat {
    fn state(&self) -> &State<f32> {
        &self.state
    }

    fn known_state(&self) -> &State<f32> {
        &self.known_state
    }

    /// Of the aviary; the others are not seen.
    fn ranges(&self) -> Option<Ranges> {
        Some(measured(&self.place.borrow().rangers, &self.state))
    }

    fn step(&mut self, rotor_targets: &[f32; 4]) {
        let mut place = self.place.borrow_mut();
        place.rotor_targets[self.number] = *rotor_targets;
        // The last one to say what it does moves all.
        if self.number + 1 == place.rotor_targets.len() {
            place.step();
        }
    }

    fn settle(&mut self) {
        let place = self.place.borrow();
        self.state = place.flight.states()[self.number];
        self.known_state = place.flight.known_states()[self.number];
    }
}
