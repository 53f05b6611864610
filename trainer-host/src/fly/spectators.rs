//! Who looks at a flight while it is flown.

use std::sync::Arc;
use std::sync::mpsc::Sender;

use kestrel_core::vehicle::State;
use kestrel_draw::recorded_flight::{DroneFlight, FlightRecording, Frame, Placement};
use kestrel_draw::viewer::Glimpse;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::world::Pose;

/// Windows, films and cameras that are told of a flight; nobody by default.
#[derive(Default)]
pub(super) struct Spectators {
    all: Vec<Sender<Glimpse>>,
    title: String,
    begun: bool,
}

impl Spectators {
    /// All of these, who see a title above the flight.
    pub(super) fn new(all: Vec<Sender<Glimpse>>, title: String) -> Self {
        Self { all, title, begun: false }
    }

    /// Tells of the control period that begins now. Whoever has gone hears nothing.
    pub(super) fn tell(
        &mut self,
        states: &[State<f32>],
        movables: impl FnOnce() -> Vec<Pose>,
        scenario: &Scenario,
    ) {
        if self.all.is_empty() {
            return;
        }
        let placed = |state: &State<f32>| Placement { position: state.position, attitude: state.world_from_body };
        let drones: Vec<Placement> = states.iter().map(placed).collect();
        let movables: Vec<Placement> = movables().iter().map(Placement::of).collect();
        let glimpse = if self.begun {
            Glimpse::GoesOn(Frame { drones, movables, rewards: Vec::new() })
        } else {
            let flight = FlightRecording {
                title: self.title.clone(),
                control_secs: scenario.physics.control_secs(),
                drones: drones.into_iter().map(|drone| DroneFlight::beginning(None, drone)).collect(),
                movables: movables.into_iter().map(|placement| vec![placement]).collect(),
            };
            Glimpse::Begins(Arc::new(scenario.clone()), flight)
        };
        self.begun = true;
        self.all.retain(|spectator| spectator.send(glimpse.clone()).is_ok());
    }
}
