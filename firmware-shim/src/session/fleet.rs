//! Several vehicles of one policy in one place, in one process and thread, with one clock.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use kestrel_core::airframe::Airframe;
use kestrel_core::pilot::{Pilot, StatePolicy};

use super::{Session, SessionError, SessionOptions, announcement, fly_together};
use crate::link::LINKS;
use crate::link::faulty::FaultPlan;
use crate::lockstep::{ControlPeriod, Next};
use crate::plant::Plant;
use crate::policy_backend::PolicyBackend;
use crate::policy_bytes::PolicyBytes;

/// Greatest MAVLink system of a vehicle, by custom; ground stations have those above.
const SYSTEM_LIMIT: u8 = 250;

/// Vehicles that fly together, numbered from 0.
///
/// Vehicle N has the first one's options with N added to the system, to the ports on which it listens and to the seed of
/// its links' faults, and its system in the name of its log. The ground station is the same for all of them.
pub struct Fleet<P> {
    sessions: Vec<Session<P>>,
    announcement: String,
}

impl<'a> Fleet<Pilot<'a, StatePolicy<'a>>> {
    /// Opens `count` vehicles.
    ///
    /// # Errors
    /// As [`Session::open`], and [`SessionError::Fleet`] if there are not so many systems or ports, or a serial line is
    /// wanted by several.
    pub fn open(
        bytes: &'a PolicyBytes,
        airframe: &Airframe,
        count: u8,
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        let each = (0..count).map(|number| options.of_vehicle(number, count)).collect::<Result<Vec<_>, _>>()?;
        let opened = each.iter().map(|options| Session::open(bytes, airframe, options));
        let sessions = opened.collect::<Result<Vec<_>, _>>()?;
        let bound: Vec<_> = sessions.iter().map(Session::bound).collect();
        Ok(Self { announcement: announcement(bytes.policy()?.metadata().name, options, &bound), sessions })
    }
}

impl<P: PolicyBackend> Fleet<P> {
    /// What flies, and how to connect to it.
    pub fn announcement(&self) -> &str {
        &self.announcement
    }

    /// The vehicles, in the order of their numbers.
    pub fn sessions(&self) -> &[Session<P>] {
        &self.sessions
    }

    /// Flies each vehicle in the plant of its number, as [`Session::fly`]; `watch` ends the flight of all.
    ///
    /// # Errors
    /// If a link fails or a log cannot be written.
    pub fn fly(
        &mut self,
        plants: &mut [impl Plant],
        watch: &mut dyn FnMut(&ControlPeriod) -> Next,
    ) -> Result<(), SessionError> {
        let mut plants: Vec<&mut dyn Plant> = plants.iter_mut().map(|plant| plant as &mut dyn Plant).collect();
        fly_together(&mut self.sessions, &mut plants, watch)
    }
}

impl SessionOptions {
    /// The options of one of `count` vehicles.
    fn of_vehicle(&self, number: u8, count: u8) -> Result<Self, SessionError> {
        let refused = |expected, found| SessionError::Fleet { count, expected, found };
        let system = self.system.saturating_add(number);
        if system > SYSTEM_LIMIT {
            let first = format!("the first to be system {}", self.system);
            return Err(refused("systems up to 250", first));
        }
        let listens = |first: SocketAddr| {
            let found = || format!("the first to listen at {first}");
            nth_address(first, number).ok_or_else(|| refused("ports up to 65535", found()))
        };
        if let (Some(port), 2..) = (&self.serial, count) {
            return Err(refused("no serial line", port.path.display().to_string()));
        }
        let log = self.log.as_deref().map(|log| if count == 1 { log.to_owned() } else { nth_log(log, system) });
        let faults =
            |plan: FaultPlan| FaultPlan { seed: plan.seed.wrapping_add(LINKS as u64 * u64::from(number)), ..plan };
        Ok(Self {
            system,
            listen: listens(self.listen)?,
            tcp: self.tcp.map(listens).transpose()?,
            crtp: self.crtp.map(listens).transpose()?,
            log,
            link_faults: self.link_faults.map(faults),
            ..self.clone()
        })
    }
}

/// The address so many ports on; port 0 stays any port.
fn nth_address(first: SocketAddr, number: u8) -> Option<SocketAddr> {
    let port = match first.port() {
        0 => 0,
        port => port.checked_add(u16::from(number))?,
    };
    Some(SocketAddr::new(first.ip(), port))
}

/// `flight.tlog` becomes `flight-3.tlog`.
fn nth_log(log: &Path, system: u8) -> PathBuf {
    let mut name = log.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{system}"));
    if let Some(extension) = log.extension() {
        name.push(".");
        name.push(extension);
    }
    log.with_file_name(name)
}
