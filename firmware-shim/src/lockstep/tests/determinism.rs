//! The same flight to the bit, however the wall clock runs.
//!
//! `LOCKSTEP_STEPS=1000000` makes the flights long.

use std::env;
use std::hash::{DefaultHasher, Hash, Hasher};

use super::*;
use crate::testing::hover_policy_every;

/// Control periods of a flight.
const STEPS: u64 = 25_000;

/// Interruptions of a flight that is interrupted, and the longest of them \[ms\].
const INTERRUPTIONS: u64 = 20;
const INTERRUPTION_MS: u64 = 50;

/// The client begins anew after this \[s\].
const ROUND_SECS: f64 = 40.0;

const FAULTS: &str = "loss=0.05,duplicate=0.05,reorder=0.2,delay=0.03,corrupt=0.01,seed=3";

/// How a flight is disturbed from outside.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Disturbance {
    None,
    Interruptions,
}

/// What there was of a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Record {
    /// Digest of all states, modes and rotor targets.
    states: u64,
    /// Digest of all frames that came through to the client.
    frames: u64,
    farthest_m: f32,
    landings: u32,
}

#[test]
fn a_flight_repeats_itself_to_the_bit_whatever_the_wall_clock_does() {
    let steps = env::var("LOCKSTEP_STEPS").map_or(STEPS, |text| text.parse().unwrap());
    for control_secs in [0.004, 0.002] {
        let start = Instant::now();
        let record = conduct(control_secs, steps, SimulationRate::Unthrottled, Disturbance::None);
        let factor = steps as f64 * f64::from(control_secs) / start.elapsed().as_secs_f64();
        println!("{steps} steps of {control_secs} s, {factor:.0} times as fast as real time: {record:?}");
        assert!(record.farthest_m > 0.5 && record.landings > 0, "{record:?}");
        assert_eq!(conduct(control_secs, steps, SimulationRate::Unthrottled, Disturbance::Interruptions), record);
        // At a pace that is too fast to be kept peers may be silent for longer, and are heard when they speak.
        let paced = conduct(control_secs, steps, SimulationRate::Speed(1000.0), Disturbance::Interruptions);
        assert!(paced.farthest_m > 0.5 && paced.landings > 0, "{paced:?}");
    }
}

/// Flies through a bad link as a script says.
fn conduct(control_secs: f32, steps: u64, pace: SimulationRate, disturbance: Disturbance) -> Record {
    let mut flight = Flight::with(hover_policy_every(control_secs), 1, 0.0);
    let mut end = flight.client(FAULTS);
    let [mut states, mut frames] = [DefaultHasher::new(), DefaultHasher::new()];
    let mut record = Record { states: 0, frames: 0, farthest_m: 0.0, landings: 0 };
    let mut mode = Mode::Disarmed;
    let mut left = steps;
    let mut watch = |period: &ControlPeriod| {
        digest(period, &mut states);
        messages(&mut end).hash(&mut frames);
        if let Some(bytes) = script(period.secs, control_secs) {
            end.send(&bytes);
        }
        if disturbance == Disturbance::Interruptions {
            interrupt(left, steps);
        }
        record.farthest_m = record.farthest_m.max(period.state.position.norm());
        record.landings += u32::from(period.mode == Mode::Landed && mode == Mode::Landing);
        mode = period.mode;
        left -= 1;
        if left > 0 { Next::Fly } else { Next::End }
    };
    fly(&mut [flight.simulated()], pace, &mut watch).unwrap();
    Record { states: states.finish(), frames: frames.finish(), ..record }
}

fn digest(period: &ControlPeriod, states: &mut DefaultHasher) {
    let State { position, world_from_body, velocity, body_rates, rotor_speeds } = period.state;
    let vectors = [position, velocity, body_rates];
    vectors.iter().flat_map(|vector| vector.iter()).for_each(|value| value.to_bits().hash(states));
    [world_from_body.w, world_from_body.x, world_from_body.y, world_from_body.z].map(f32::to_bits).hash(states);
    [*rotor_speeds, period.rotor_targets].map(|values| values.map(f32::to_bits)).hash(states);
    (period.mode as u8).hash(states);
}

/// What the client says in this control period: commands several times, set-points twenty times a second.
fn script(secs: f64, control_secs: f32) -> Option<Vec<u8>> {
    let in_round = secs % ROUND_SECS;
    let often = (secs / 0.05).floor() != ((secs - f64::from(control_secs)) / 0.05).floor();
    let arm = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let offboard = [129.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let command = |command, parameters| Some(datagram(&command_long(command, parameters)));
    if !often {
        return None;
    }
    match in_round {
        0.5..0.7 => command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, arm),
        0.9..1.1 => command(MavCmd::MAV_CMD_NAV_TAKEOFF, [f32::NAN; 7]),
        6.0..6.2 => Some(datagram(&set_point([0.6, 0.4, -1.2]))),
        12.0..12.2 => command(MavCmd::MAV_CMD_DO_SET_MODE, offboard),
        10.0..16.0 => Some(datagram(&set_point([(in_round - 10.0) as f32 * 0.1, -0.3, -0.9]))),
        20.0..20.2 => command(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, [0.0; 7]),
        _ => None,
    }
}

/// Sleeps at some steps, which depend on nothing but their number.
fn interrupt(step: u64, steps: u64) {
    let mut hasher = DefaultHasher::new();
    step.hash(&mut hasher);
    let draw = hasher.finish();
    if draw.is_multiple_of((steps / INTERRUPTIONS).max(1)) {
        thread::sleep(Duration::from_millis((draw >> 32) % (INTERRUPTION_MS + 1)));
    }
}
