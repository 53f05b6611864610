//! The ground station of a flight, which sends what the script says when it says so, as long as there is a link.

use kestrel_shim::flight_mode::FlightMode;
use kestrel_shim::geodesy::Home;
use kestrel_shim::ground_station::{GroundStation, StationOrder, StatusText};
use kestrel_shim::link::memory::MemoryLink;
use kestrel_shim::link::{DATAGRAM_LIMIT, Link, LinkError};

use super::case::{Case, CasePilot, ScriptStep};
use super::fault::{Fault, FaultKind};

/// Time between two of a stream of set-points \[s\]: ten a second, where PX4 wants two at least.
const STREAM_SECS: f64 = 0.1;

/// MAVLink system of the vehicle.
pub(crate) const VEHICLE: u8 = 1;

/// A ground station that follows a script.
pub(crate) struct ScriptedStation<'a> {
    station: GroundStation,
    link: MemoryLink,
    faults: &'a [Fault],
    grace_secs: f64,
    waiting: Vec<Due<'a>>,
}

/// A step of the script and when it is sent next \[s\].
struct Due<'a> {
    step: &'a ScriptStep,
    next_secs: f64,
}

/// Sent before everything else where the cascade flies.
const CASCADE: ScriptStep =
    ScriptStep { at_secs: 0.0, for_secs: 0.0, order: StationOrder::Mode(FlightMode::Cascade) };

impl<'a> ScriptedStation<'a> {
    /// The ground station of a case at its end of a link.
    pub(crate) fn new(case: &'a Case, link: MemoryLink, control_secs: f64) -> Self {
        let chosen = match case.pilot {
            CasePilot::Cascade => Some(&CASCADE),
            CasePilot::Policy(_) => None,
        };
        let steps = chosen.into_iter().chain(&case.script);
        Self {
            station: GroundStation::new(VEHICLE, Home::default()),
            link,
            faults: &case.faults,
            grace_secs: 0.5 * control_secs,
            waiting: steps.map(|step| Due { step, next_secs: step.at_secs }).collect(),
        }
    }

    /// Hears what the vehicle said and sends what is due at a time \[s\].
    ///
    /// # Errors
    /// If the link fails.
    pub(crate) fn advance(&mut self, now_secs: f64) -> Result<(), LinkError> {
        let Self { station, link, faults, grace_secs, waiting } = self;
        let lost =
            faults.iter().any(|fault| fault.kind == FaultKind::LinkLoss && fault.acts_at(now_secs, *grace_secs));
        let mut sent: Vec<Vec<u8>> = Vec::new();
        let mut send = |frame: &[u8]| sent.push(frame.to_vec());
        let mut buffer = [0; DATAGRAM_LIMIT];
        while let Some(received) = link.receive(&mut buffer)? {
            if !lost {
                station.hear(received.datagram, &mut send);
            }
        }
        station.advance(now_secs, &mut send);
        waiting.retain_mut(|due| {
            if due.next_secs > now_secs + *grace_secs {
                return true;
            }
            station.order(&due.step.order, &mut send);
            due.next_secs += STREAM_SECS;
            due.next_secs < due.step.at_secs + due.step.for_secs
        });
        if !lost {
            for frame in &sent {
                link.send(frame);
            }
        }
        Ok(())
    }

    /// What the vehicle said.
    pub(crate) fn texts(&self) -> &[StatusText] {
        self.station.texts()
    }
}
