//! What an autopilot behind a bridge flies: a plant with motors and instruments.

use kestrel_core::vehicle::State;

use super::event::{BridgeEvent, BridgeStep};
use super::motors::Motors;
use super::sensors::{Instruments, Measurement};
use crate::plant::Plant;

/// A drone that obeys throttles and measures.
pub struct Drone<'p> {
    plant: &'p mut dyn Plant,
    motors: Motors,
    instruments: Instruments,
    measurement: Measurement,
    rotor_targets: [f32; 4],
}

impl<'p> Drone<'p> {
    /// The drone of a plant, at rest.
    pub fn new(plant: &'p mut dyn Plant, motors: Motors, mut instruments: Instruments) -> Self {
        let state = *plant.state();
        let measurement = measure(plant, &mut instruments, &state);
        Self { plant, motors, instruments, measurement, rotor_targets: [0.0; 4] }
    }

    /// Advances one control period of the plant with throttles from 0 to 1, in the autopilot's order.
    pub fn step(&mut self, throttles: &[f32; 4]) {
        let before = *self.plant.state();
        self.rotor_targets = self.motors.rotor_targets(throttles);
        self.plant.step(&self.rotor_targets);
        self.measurement = measure(self.plant, &mut self.instruments, &before);
    }

    /// Has its instruments switched on anew: what they measure from now on depends on nothing before.
    pub fn restart_instruments(&mut self) {
        self.instruments.restart();
        let state = *self.plant.state();
        self.measurement = measure(self.plant, &mut self.instruments, &state);
    }

    /// The true state.
    pub fn state(&self) -> &State<f32> {
        self.plant.state()
    }

    /// What the instruments measured at the end of the last step.
    pub fn measurement(&self) -> &Measurement {
        &self.measurement
    }

    /// The last step as an event, at the simulated time of its end \[s\].
    pub fn stepped(&self, secs: f64) -> BridgeEvent<'_> {
        BridgeEvent::Stepped(BridgeStep { secs, state: self.state(), rotor_targets: self.rotor_targets })
    }

    /// What the rotors were told with the last step \[rad/s\].
    pub fn rotor_targets(&self) -> [f32; 4] {
        self.rotor_targets
    }
}

/// The next sample of all instruments of a drone that was in a state one sample before.
fn measure(plant: &dyn Plant, instruments: &mut Instruments, before: &State<f32>) -> Measurement {
    let ranges = if instruments.rangers_are_due() { plant.ranges() } else { None };
    Measurement { ranges, ..instruments.measure(before, plant.state()) }
}
