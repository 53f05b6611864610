//! Which share of its thrust each rotor made in recorded flights: a worn propeller, a tired motor, a load, an empty battery.
//!
//! `cargo run --release -p kestrel-identify --example rotor_shares -- FLIGHT...` reads logs of a Crazyflie 2.1 with its
//! motion, of any format that `kestrel identify` reads. Shares are those of its commands with a full battery.

use std::error::Error;
use std::path::Path;

use kestrel_core::airframe::CRAZYFLIE_2_1;
use kestrel_core::effectiveness::RotorEffectiveness;
use kestrel_core::policy_file::PolicyAirframe;
use kestrel_core::vehicle::State;
use kestrel_identify::flight::{Flight, Motion};
use kestrel_identify::log;

/// Voltage of a full battery \[V\].
const FULL_VOLTS: f64 = 4.2;

/// Time in which the rotors are found \[s\], and are not reported.
const FINDING_SECS: f64 = 6.0;

fn main() -> Result<(), Box<dyn Error>> {
    println!(
        "flight: share of each rotor (standard deviation); all four beside the square of the battery's voltage"
    );
    for path in std::env::args().skip(1) {
        let flight = log::read(Path::new(&path))?;
        match Shares::of(&flight) {
            Some(shares) => println!("{}: {shares}", flight.name),
            None => println!("{}: no motion, or too short", flight.name),
        }
    }
    Ok(())
}

/// Over a flight.
struct Shares {
    means: [f64; 4],
    deviations: [f64; 4],
    /// Mean square of the voltage, as a share of the full one.
    charge: Option<f64>,
}

impl Shares {
    fn of(flight: &Flight) -> Option<Self> {
        let motion = flight.motion.as_ref()?;
        let [hover, limit] =
            [CRAZYFLIE_2_1.hover_rotor_speed(), CRAZYFLIE_2_1.rotor_speed_limit].map(|speed| speed as f32);
        let mut effectiveness =
            RotorEffectiveness::new(&PolicyAirframe::from(&CRAZYFLIE_2_1), hover * hover, limit);
        let (mut found, mut squares) = (Vec::new(), Vec::new());
        for row in 0..flight.rows() {
            if !flight.measured[row] {
                effectiveness.pause();
                continue;
            }
            let commanded = flight.commands[row].map(|share| share as f32 * limit);
            effectiveness.learn(&state(flight, motion, row), &commanded, flight.period_secs as f32);
            if row as f64 * flight.period_secs > FINDING_SECS {
                found.push(effectiveness.shares().map(f64::from));
                squares.extend(flight.battery_volts.as_ref().map(|volts| (volts[row] / FULL_VOLTS).powi(2)));
            }
        }
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / found.len() as f64;
        let means = core::array::from_fn(|rotor| mean(&mut found.iter().map(|shares| shares[rotor])));
        let spread =
            |rotor: usize| mean(&mut found.iter().map(|shares| (shares[rotor] - means[rotor]).powi(2))).sqrt();
        let charge = (!squares.is_empty()).then(|| squares.iter().sum::<f64>() / squares.len() as f64);
        (!found.is_empty()).then(|| Self { means, deviations: core::array::from_fn(spread), charge })
    }
}

fn state(flight: &Flight, motion: &Motion, row: usize) -> State<f32> {
    State {
        position: motion.positions[row].cast(),
        world_from_body: motion.attitudes[row].map(|part: f64| part as f32),
        velocity: motion.velocities[row].cast(),
        body_rates: flight.body_rates[row].cast(),
        rotor_speeds: [0.0; 4],
    }
}

impl std::fmt::Display for Shares {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (mean, deviation) in self.means.iter().zip(self.deviations) {
            write!(formatter, "{mean:.2} ({deviation:.2})  ")?;
        }
        write!(formatter, "all {:.3}", self.means.iter().sum::<f64>() / 4.0)?;
        self.charge.map_or(Ok(()), |charge| write!(formatter, ", voltage {charge:.3}"))
    }
}

#[test]
fn a_worn_rotor_is_found_in_a_recorded_flight() {
    use kestrel_core::attitude::Attitude;
    use kestrel_identify::flight::CommandRecord;
    use nalgebra::Vector3;
    let rows = 2000;
    let hovering = (CRAZYFLIE_2_1.hover_rotor_speed() / CRAZYFLIE_2_1.rotor_speed_limit).powi(2);
    // The third is told more, so that it carries as much as the others.
    let commands = [hovering, hovering, hovering / 0.85, hovering].map(f64::sqrt);
    let flight = Flight {
        name: "worn".to_owned(),
        start_secs: 0.0,
        period_secs: 0.01,
        measured: vec![true; rows],
        commands: vec![commands; rows],
        command_record: CommandRecord::Complete,
        rotor_speeds: None,
        body_rates: vec![Vector3::zeros(); rows],
        specific_forces: None,
        motion: Some(Motion {
            positions: vec![Vector3::z(); rows],
            attitudes: vec![Attitude::level(); rows],
            velocities: vec![Vector3::zeros(); rows],
        }),
        battery_volts: None,
        set_points: None,
    };
    let shares = Shares::of(&flight).unwrap();
    for (found, expected) in shares.means.iter().zip([1.0, 1.0, 0.85, 1.0]) {
        assert!((found - expected).abs() < 0.02, "{shares}");
    }
    assert!(Shares::of(&Flight { motion: None, ..flight }).is_none());
}
