//! The same flights everywhere: the whole autopilot in the core's simulation, commanded by MAVLink through noise and damage,
//! with everything going wrong that it watches for.

mod flight;
mod line;

use core::cell::Cell;

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{Arithmetic, PolicyError, PolicyFile};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_onboard::controller::Controller;
use kestrel_onboard::fence::{ZoneError, ZoneKind, Zones};
use kestrel_onboard::flight_controller::{FlightController, VehicleIdentity};
use kestrel_onboard::geodesy::Home;
use kestrel_onboard::plant::{FlatFloor, Plant};
use kestrel_onboard::policy_backend::PolicyBackend;
use kestrel_onboard::signature::{SignatureTime, Signer, SigningKey};
use kestrel_onboard::signature_guard::{SignatureGuard, Verifier};
use nalgebra::{Vector2, Vector3};

use crate::digest::Digest;
use crate::machine::{Verdict, hexadecimal, print};
use crate::policy::{Artifact, PILOTS};
use flight::{FLIGHTS, Flight, ScriptEvent};
use line::Line;

/// The policy that flies, in fixed point.
const NAME: &str = "hover";

const IDENTITY: VehicleIdentity = VehicleIdentity {
    system: line::VEHICLE,
    origin: Home { latitude_deg: 47.397_742, longitude_deg: 8.545_594, altitude_m: 488.0 },
};

/// What the policy's processor does.
#[derive(Clone, Copy)]
enum Health {
    /// It computes the policy.
    Works,
    /// It gives no answer.
    Hangs,
    /// It wants all there is from every motor.
    Saturates,
}

/// A policy whose processor may fail.
struct Fallible<'a> {
    pilot: Pilot<'a>,
    health: &'a Cell<Health>,
}

impl PolicyBackend for Fallible<'_> {
    fn control_secs(&self) -> f32 {
        self.pilot.control_secs()
    }

    fn observation(&self) -> &ObservationLayout {
        self.pilot.observation()
    }

    fn healthy(&mut self) -> bool {
        self.pilot.healthy()
    }

    fn reset(&mut self) {
        self.pilot.reset();
    }

    fn tick(&mut self, state: &State<f32>, setpoint: &Setpoint<f32>) -> Option<[f32; 4]> {
        match self.health.get() {
            Health::Works => Some(self.pilot.tick_towards(&[], state, setpoint)),
            Health::Hangs => None,
            Health::Saturates => Some([CF2X.rotor_speed_limit as f32; 4]),
        }
    }
}

/// A flight on its way.
struct Scene<'a> {
    controller: FlightController<Fallible<'a>>,
    plant: FlatFloor,
    line: Line,
    battery: f32,
    /// Control periods for which the state is no number, and for which the drone is turned upside down.
    blind: u32,
    tumbling: u32,
    digest: Digest,
}

/// Prints the digest of every flight: what was answered, what was done in which mode, what went wrong, where it flew; refused
/// if one does not go as it should.
pub fn run() -> Verdict {
    PILOTS.iter().filter(|artifact| artifact.name == NAME).map(check).fold(Verdict::Passed, Verdict::and)
}

fn check(artifact: &Artifact) -> Verdict {
    match PolicyFile::parse(artifact.bytes) {
        Ok(policy) if policy.arithmetic() == Arithmetic::Fixed16 => {
            FLIGHTS.iter().map(|flight| fly(flight, &policy)).fold(Verdict::Passed, Verdict::and)
        }
        // Without floating point it would take minutes.
        Ok(_) => Verdict::Passed,
        Err(error) => refused(&error),
    }
}

fn refused(_: &PolicyError) -> Verdict {
    print(&["autopilot: the policy is refused\n"]);
    Verdict::Failed
}

fn fly(flight: &Flight, policy: &PolicyFile<'_>) -> Verdict {
    let health = Cell::new(Health::Works);
    let mut scene = Scene::new(flight, policy, &health);
    let control_secs = scene.controller.autopilot().control_secs();
    let mut expected = flight.events.iter();
    let mut right = true;
    for tick in 0..periods(flight.secs, control_secs) {
        for (secs, event) in flight.script {
            if periods(*secs, control_secs) == tick {
                scene.act(event, &health);
            }
        }
        scene.tick(tick);
        for event in scene.controller.autopilot().events() {
            right &= expected.next() == Some(event);
        }
    }
    right &= expected.next().is_none();
    right &= flight.end == (scene.controller.autopilot().mode(), scene.controller.autopilot().active_controller());
    // Or the line was not as bad as it should be.
    right &= scene.controller.counts().garbage > 0;
    report(flight, &scene);
    if right { Verdict::Passed } else { Verdict::Failed }
}

/// The zone to stay in, and the one to stay out of.
fn zones(flight: &Flight) -> Result<Zones, ZoneError> {
    let mut zones = Zones::default();
    if let Some(corners) = flight.room {
        zones.add_polygon(&corners.map(Vector2::from), ZoneKind::Inside { group: 0 })?;
        zones.add_circle(Vector2::new(-0.8, 0.0), 0.2, ZoneKind::Outside)?;
    }
    Ok(zones)
}

/// Control periods in a time \[s\].
fn periods(secs: f32, control_secs: f32) -> u32 {
    (secs / control_secs + 0.5) as u32
}

fn report(flight: &Flight, scene: &Scene<'_>) {
    let autopilot = scene.controller.autopilot();
    let controller = match autopilot.active_controller() {
        Controller::Policy => "policy",
        Controller::Cascade => "cascade",
    };
    let digits = hexadecimal(scene.digest.value());
    let digits = core::str::from_utf8(&digits).unwrap_or_default();
    print(&["autopilot, ", flight.name, ": ", autopilot.mode().name(), " by the ", controller, " ", digits, "\n"]);
}

impl<'a> Scene<'a> {
    fn new(flight: &Flight, policy: &PolicyFile<'a>, health: &'a Cell<Health>) -> Self {
        let processor = Fallible { pilot: Pilot::new(policy.clone()), health };
        let mut controller = FlightController::new(processor, &CF2X, IDENTITY);
        let mut settings = *controller.autopilot().settings();
        settings.link_loss_secs = 1.0;
        settings.takeoff_altitude_m = flight.altitude_m;
        settings.fence_radius_m = flight.fence_radius_m;
        controller.autopilot_mut().adjust(settings);
        controller.autopilot_mut().enclose(zones(flight).unwrap_or_default());
        let verifier = Verifier::new(SigningKey(line::KEY), line::START, SignatureTime(0));
        controller.secure(SignatureGuard::Signed(verifier), Signer::new(SigningKey(line::KEY), 2, line::START));
        let plant =
            FlatFloor::new(&CF2X, controller.autopilot().control_secs()).with_rate_loop(&policy.metadata().action);
        let line = Line::new();
        Self { controller, plant, line, battery: 1.0, blind: 0, tumbling: 0, digest: Digest::new() }
    }

    fn act(&mut self, event: &ScriptEvent, health: &Cell<Health>) {
        match *event {
            ScriptEvent::Command(command, parameters) => self.line.command(command, parameters),
            ScriptEvent::SetPointStream(stream) => self.line.stream(stream),
            ScriptEvent::GroundStation(station) => self.line.set_presence(station),
            ScriptEvent::Battery(share) => self.battery = share,
            ScriptEvent::Gust(way) => {
                let mut state = *self.plant.state();
                state.position += Vector3::from(way);
                self.plant.put(state);
            }
            ScriptEvent::Blind(periods) => self.blind = periods,
            ScriptEvent::Tumble(periods) => self.tumbling = periods,
            ScriptEvent::Hang => health.set(Health::Hangs),
            ScriptEvent::Saturate => health.set(Health::Saturates),
            ScriptEvent::Intrude => {
                let controller = &mut self.controller;
                line::intrude(&mut |byte| controller.receive(byte));
            }
        }
    }

    /// A control period: what arrives, what is answered, what is done, and where that leads.
    fn tick(&mut self, tick: u32) {
        let controller = &mut self.controller;
        self.line.transmit(tick, &mut |byte| controller.receive(byte));
        while let Some(answer) = self.controller.next_answer() {
            self.line.receive(&answer);
            self.digest.add_bytes(&answer);
        }
        self.disturb();
        let mut state = *self.plant.state();
        if self.blind > 0 {
            self.blind -= 1;
            state.velocity.y = f32::NAN;
        }
        let targets = self.controller.tick(&state, self.battery);
        self.plant.step(&targets);
        let autopilot = self.controller.autopilot();
        self.digest.add_bytes(&[autopilot.mode() as u8, autopilot.active_controller() as u8]);
        for event in autopilot.events() {
            self.digest.add_bytes(&[*event as u8]);
        }
        self.digest.add(&targets);
        let Vector3 { data, .. } = self.plant.state().position;
        self.digest.add(data.0.as_flattened());
    }

    /// Upside down, and turning.
    fn disturb(&mut self) {
        if self.tumbling > 0 {
            self.tumbling -= 1;
            let overturned = Attitude { w: 0.0, x: 1.0, y: 0.0, z: 0.0 };
            let body_rates = Vector3::new(20.0, 0.0, 0.0);
            self.plant.put(State { world_from_body: overturned, body_rates, ..*self.plant.state() });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flight_goes_as_it_should() {
        assert_eq!(run(), Verdict::Passed);
    }
}
