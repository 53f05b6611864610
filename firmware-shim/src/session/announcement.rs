//! The words that say what flies and how to connect.

use std::fmt::Write;

use super::{Bound, SessionOptions};
use crate::flight_mode::FlightMode;
use crate::lockstep::SimulationRate;

/// Of one vehicle, or of several with the policy `name`, each of them `bound`; `options` are those of the first.
pub(super) fn announcement(name: &str, options: &SessionOptions, bound: &[Bound]) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = write(&mut text, name, options, bound);
    text
}

fn write(text: &mut String, name: &str, options: &SessionOptions, bound: &[Bound]) -> std::fmt::Result {
    let ground_station = options.ground_station;
    let pace = match options.speed {
        SimulationRate::Speed(1.0) => "in real time".to_owned(),
        SimulationRate::Speed(factor) => format!("at {factor} times real time"),
        SimulationRate::Unthrottled => "as fast as it goes".to_owned(),
    };
    let (systems, speakers) = match bound {
        [first, .., last] => (format!("systems {} to {}", first.system, last.system), "They speak"),
        [] | [_] => (format!("system {}", options.system), "It speaks"),
    };
    writeln!(text, "Policy \"{name}\" flies as MAVLink {systems}, {pace}.")?;
    let addresses: Vec<String> = bound.iter().map(|bound| bound.udp.to_string()).collect();
    writeln!(text, "{speakers} to {ground_station}; connect there or at {}:", addresses.join(", "))?;
    writeln!(text, "  QGroundControl  listens on port 14550 by itself")?;
    writeln!(text, "  MAVSDK          udpin://{ground_station}")?;
    writeln!(text, "  MAVProxy        mavproxy.py --master=udpin:{ground_station}")?;
    writeln!(text, "  pymavlink       mavutil.mavlink_connection(\"udpin:{ground_station}\")")?;
    for bound in bound {
        writeln!(text, "  or              mavutil.mavlink_connection(\"udpout:{}\")", bound.udp)?;
        if let Some(crtp) = bound.crtp {
            writeln!(text, "  cflib           udp://{crtp}")?;
        }
        if let Some(tcp) = bound.tcp {
            writeln!(text, "  or              mavutil.mavlink_connection(\"tcp:{tcp}\")")?;
        }
    }
    if let Some(port) = &options.serial {
        writeln!(text, "It speaks on serial device {}, too, at {} baud.", port.path.display(), port.baud)?;
    }
    let everywhere = bound.iter().flat_map(|bound| [Some(bound.udp), bound.tcp, bound.crtp]).flatten();
    for address in everywhere.filter(|address| !address.ip().is_loopback()) {
        writeln!(text, "Reachable from other machines: whoever reaches {address} can fly it.")?;
    }
    let modes: Vec<String> = options
        .personality
        .listed()
        .into_iter()
        .map(|mode| if mode == FlightMode::Policy { format!("RL:{name}") } else { mode.name().to_owned() })
        .collect();
    writeln!(text, "Modes: {}.", modes.join(", "))?;
    if options.signing_key.is_some() {
        writeln!(text, "Only frames signed with its key are heard.")?;
    }
    write!(text, "Ctrl-C ends the flight.")
}
