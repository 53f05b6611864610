//! A flight from the command line: the options, the vehicle and its link, the words that say how to connect.

use std::net::SocketAddr;

use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{PolicyError, PolicyFile};

use crate::link::{Addresses, LinkError, UdpLink};
use crate::lockstep::{self, Moment, Next, Pace};
use crate::plant::Plant;
use crate::processor::Processor;
use crate::vehicle::{Counts, MavlinkVehicle};

/// Options of every command that flies.
#[derive(Clone, Copy, Debug, PartialEq, clap::Args)]
pub struct SessionOptions {
    /// UDP address of the vehicle itself, for clients that speak first
    #[arg(long, value_name = "ADDRESS", default_value_t = Addresses::default().vehicle)]
    pub listen: SocketAddr,

    /// UDP address where a ground station listens; the vehicle speaks to it first
    #[arg(long, value_name = "ADDRESS", default_value_t = Addresses::default().ground_station)]
    pub ground_station: SocketAddr,

    /// MAVLink system number of the vehicle
    #[arg(long, value_name = "NUMBER", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=250))]
    pub system: u8,

    /// Simulated seconds per second, 0.01 to 1000, or "max" for as fast as it goes
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, default_value = "1")]
    pub speed: Pace,

    /// End after so many simulated seconds [default: fly until Ctrl-C]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = positive_secs)]
    pub for_secs: Option<f64>,
}

/// Why there is no flight.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The policy does not reproduce its golden vectors.
    #[error("policy \"{name}\" does not compute here what it did when it was exported: {reason}")]
    SelfTest {
        /// Of the policy.
        name: String,
        /// The first deviation.
        reason: PolicyError,
    },
    /// The policy flies to where it was trained to fly, or sees what no MAVLink peer sends.
    #[error(
        "policy \"{name}\" has the observation `{observation}`, which does not show where to fly: a vehicle that takes commands needs one trained with `pilot`"
    )]
    GoalUnseen {
        /// Of the policy.
        name: String,
        /// Name of its layout.
        observation: &'static str,
    },
    /// The policy needs sensors that the vehicle has not.
    #[error(
        "policy \"{name}\" has the observation `{observation}`, which shows what sensors measure: this vehicle has none and needs one trained with `pilot`"
    )]
    SensorsMissing {
        /// Of the policy.
        name: String,
        /// Name of its layout.
        observation: &'static str,
    },
    /// No socket.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// A vehicle on the air.
pub struct Session<P> {
    vehicle: MavlinkVehicle<P>,
    link: UdpLink,
    options: SessionOptions,
    announcement: String,
}

impl Default for SessionOptions {
    fn default() -> Self {
        let Addresses { vehicle, ground_station } = Addresses::default();
        Self { listen: vehicle, ground_station, system: 1, speed: Pace::Speed(1.0), for_secs: None }
    }
}

impl<'a> Session<Pilot<'a>> {
    /// Tests the policy and binds the vehicle's address.
    ///
    /// # Errors
    /// If the policy fails its self-test, sees no goal or needs sensors, or the address cannot be had.
    pub fn open(policy: PolicyFile<'a>, options: &SessionOptions) -> Result<Self, SessionError> {
        let name = policy.metadata().name;
        policy.self_test().map_err(|reason| SessionError::SelfTest { name: name.to_owned(), reason })?;
        Self::with(Pilot::new(policy), name, options)
    }
}

impl<P: Processor> Session<P> {
    /// As [`Session::open`], with a tested policy of this name on any processor.
    ///
    /// # Errors
    /// If the policy sees no goal or needs sensors, or the address cannot be had.
    pub fn with(processor: P, name: &str, options: &SessionOptions) -> Result<Self, SessionError> {
        let layout = processor.observation();
        if !layout.shows_goal() {
            return Err(SessionError::GoalUnseen { name: name.to_owned(), observation: layout.name() });
        }
        if layout.measured_len() > 0 {
            return Err(SessionError::SensorsMissing { name: name.to_owned(), observation: layout.name() });
        }
        let link = UdpLink::open(&Addresses { vehicle: options.listen, ground_station: options.ground_station })?;
        let announcement = announcement(name, link.address()?, options);
        let vehicle = MavlinkVehicle::new(processor, options.system);
        Ok(Self { vehicle, link, options: *options, announcement })
    }

    /// What flies, and how to connect to it.
    pub fn announcement(&self) -> &str {
        &self.announcement
    }

    /// Flies in `plant` until the time is up or `watch`, which sees every control period before the plant moves, ends
    /// the flight.
    ///
    /// # Errors
    /// If the socket fails.
    pub fn fly(
        &mut self,
        plant: &mut dyn Plant,
        watch: &mut dyn FnMut(&Moment) -> Next,
    ) -> Result<Counts, SessionError> {
        let limit_secs = self.options.for_secs.unwrap_or(f64::INFINITY);
        // Half a period of grace: times are sums of rounded periods.
        let limit_secs = limit_secs - 0.5 * self.vehicle.control_period().as_secs_f64();
        let mut until = |moment: &Moment| {
            let next = watch(moment);
            if moment.secs < limit_secs { next } else { Next::End }
        };
        lockstep::fly(&mut self.vehicle, plant, &mut self.link, self.options.speed, &mut until)?;
        Ok(self.vehicle.counts())
    }
}

fn announcement(name: &str, address: SocketAddr, options: &SessionOptions) -> String {
    let SessionOptions { ground_station, system, speed, .. } = options;
    let pace = match speed {
        Pace::Speed(1.0) => "in real time".to_owned(),
        Pace::Speed(factor) => format!("at {factor} times real time"),
        Pace::Unthrottled => "as fast as it goes".to_owned(),
    };
    format!(
        "Policy \"{name}\" flies as MAVLink system {system}, {pace}.\n\
         It speaks to {ground_station}; connect there or at {address}:\n  \
         QGroundControl  listens on port 14550 by itself\n  \
         pymavlink       mavutil.mavlink_connection(\"udpin:{ground_station}\")\n  \
         or              mavutil.mavlink_connection(\"udpout:{address}\")\n\
         Ctrl-C ends the flight."
    )
}

pub(crate) fn positive_secs(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(secs) if secs > 0.0 && f64::is_finite(secs) => Ok(secs),
        Ok(_) | Err(_) => Err("expected a positive number of seconds".to_owned()),
    }
}

#[cfg(test)]
mod tests;
