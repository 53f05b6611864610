//! A flight from the command line: the options, the vehicle and its links, and the text that says how to connect.

mod announcement;
mod fleet;

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::slice;
use std::time::Duration;

use kestrel_core::airframe::Airframe;
use kestrel_core::pilot::{Pilot, StatePolicy};
use kestrel_core::policy_file::PolicyError;
use kestrel_onboard::endpoint::Counts;

pub use self::fleet::Fleet;
use crate::geodesy::Home;

use self::announcement::announcement;
use crate::crtp::link::CrtpLink;
use crate::flight_log::{self, FlightLog, FlightLogError};
use crate::link::faulty::{FaultPlan, FaultyLink};
use crate::link::serial::{SerialLink, SerialPort};
use crate::link::tcp::{self, TcpLink};
use crate::link::udp::{UdpAddresses, UdpLink};
use crate::link::{Link, LinkCounts, LinkError, Links};
use crate::lockstep::{self, ControlPeriod, FlightError, Next, SimulatedVehicle, SimulationRate, Timing};
use crate::message::sent::camera::CameraProfile;
use crate::message::sent::identity::PolicyIdentity;
use crate::persistent_store::{PersistentStore, PersistentStoreError};
use crate::personality::Personality;
use crate::plant::Plant;
use crate::policy_backend::PolicyBackend;
use crate::policy_bytes::PolicyBytes;
use crate::vehicle::{PolicyRole, Vehicle, VehicleProfile};

/// Latest start of a log, the year 2100 \[s since 1970\]: its microseconds are of 64 bits.
const LOG_START_LIMIT: u64 = 4_102_444_800;

/// Options of every command that flies.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct SessionOptions {
    /// UDP address of the vehicle itself, for clients that speak first
    #[arg(long, value_name = "ADDRESS", default_value_t = UdpAddresses::default().vehicle)]
    pub listen: SocketAddr,

    /// UDP address where a ground station listens; the vehicle speaks to it first
    #[arg(long, value_name = "ADDRESS", default_value_t = UdpAddresses::default().ground_station)]
    pub ground_station: SocketAddr,

    /// TCP address of the vehicle, for clients that connect; port 5760 unless it says another
    #[arg(long, value_name = "ADDRESS", value_parser = tcp_address)]
    pub tcp: Option<SocketAddr>,

    /// Serial device that the vehicle speaks on, at 57600 baud unless it says another rate
    #[arg(long, value_name = "PATH[:BAUD]")]
    pub serial: Option<SerialPort>,

    /// Make every link a bad one: loss=0.1,duplicate=0.05,reorder=0.2,delay=0.03,corrupt=0.01,seed=1, any of them;
    /// with "received." or "sent." before the name for one direction
    #[arg(long, value_name = "FAULTS")]
    pub link_faults: Option<FaultPlan>,

    /// Write every frame received, its answers, and what the first peer is told to this file, as pymavlink does (.tlog)
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,

    /// Begin the log at this time in seconds since 1970, so that the same flight has the same log [default: now]
    #[arg(long, value_name = "SECONDS", requires = "log", value_parser = clap::value_parser!(u64).range(..=LOG_START_LIMIT))]
    pub log_start: Option<u64>,

    /// UDP address for clients of a Crazyflie (cflib, cfclient), such as 127.0.0.1:19850 [default: none]
    #[arg(long, value_name = "ADDRESS")]
    pub crtp: Option<SocketAddr>,

    /// MAVLink system number of the vehicle
    #[arg(long, value_name = "NUMBER", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=250))]
    pub system: u8,

    /// Autopilot that the vehicle says it is
    #[arg(long, value_enum, default_value_t)]
    pub personality: Personality,

    /// Place of the world's origin on Earth, in degrees and metres above sea level
    #[arg(long, value_name = "LATITUDE,LONGITUDE,ALTITUDE", allow_hyphen_values = true, default_value_t = Home::default())]
    pub home: Home,

    /// File of the parameters, as ground stations write them (.params): read if it is there, written when a peer sets one
    #[arg(long, value_name = "FILE")]
    pub parameters: Option<PathBuf>,

    /// File of a key, 64 hexadecimal digits: frames are signed with it, and only frames signed with it are heard
    #[arg(long, value_name = "FILE", conflicts_with = "crtp")]
    pub signing_key: Option<PathBuf>,

    /// Simulated seconds per second, 0.01 to 1000, or "max" for as fast as it goes
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, default_value = "1")]
    pub speed: SimulationRate,

    /// End after so many simulated seconds [default: fly until Ctrl-C]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = positive_secs)]
    pub for_secs: Option<f64>,
}

/// Why there is no flight.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The policy file is damaged or of another version.
    #[error(transparent)]
    Policy(#[from] PolicyError),
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
        "policy \"{name}\" has the observation `{observation}`, which shows what sensors measure: this vehicle has none and needs one trained with `pilot`; \
         `kestrel fly RUN` has those of its task"
    )]
    SensorsMissing {
        /// Of the policy.
        name: String,
        /// Name of its layout.
        observation: &'static str,
    },
    /// No socket, or no serial line.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// No flight log.
    #[error(transparent)]
    Log(#[from] FlightLogError),
    /// Parameters or a key are no such thing.
    #[error(transparent)]
    PersistentStore(#[from] PersistentStoreError),
    /// The options cannot be those of several vehicles.
    #[error("cannot fly {count} vehicles: expected {expected}, found {found}")]
    Fleet {
        /// How many.
        count: u8,
        /// What goes with so many.
        expected: &'static str,
        /// What was asked for.
        found: String,
    },
    /// It was cut short.
    #[error(transparent)]
    Flight(#[from] FlightError),
}

/// A vehicle on the air.
pub struct Session<P> {
    vehicle: Vehicle<P>,
    links: Links,
    log: Option<FlightLog>,
    store: PersistentStore,
    crtp: Option<CrtpLink>,
    options: SessionOptions,
    bound: Bound,
    announcement: String,
    timing: Timing,
}

/// Where a vehicle can be spoken to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    /// MAVLink system number.
    pub system: u8,
    /// UDP address.
    pub udp: SocketAddr,
    /// TCP address, if it has one.
    pub tcp: Option<SocketAddr>,
    /// UDP address of the Crazyflie's protocol, if it has one.
    pub crtp: Option<SocketAddr>,
}

impl Default for SessionOptions {
    fn default() -> Self {
        let UdpAddresses { vehicle, ground_station } = UdpAddresses::default();
        Self {
            listen: vehicle,
            ground_station,
            tcp: None,
            serial: None,
            link_faults: None,
            log: None,
            log_start: None,
            crtp: None,
            system: 1,
            personality: Personality::default(),
            home: Home::default(),
            parameters: None,
            signing_key: None,
            speed: SimulationRate::Speed(1.0),
            for_secs: None,
        }
    }
}

impl SessionOptions {
    fn profile(&self, policy: PolicyIdentity) -> VehicleProfile {
        let Self { system, personality, home: origin, .. } = *self;
        VehicleProfile { system, personality, origin, policy }
    }

    /// The links of one vehicle.
    fn open_links(&self) -> Result<(Links, Bound), LinkError> {
        let mut links = Links::default();
        let addresses = UdpAddresses { vehicle: self.listen, ground_station: self.ground_station };
        let udp = UdpLink::open(&addresses)?;
        let mut bound = Bound { system: self.system, udp: udp.address(), tcp: None, crtp: None };
        self.attach(&mut links, 0, Box::new(udp))?;
        if let Some(address) = self.tcp {
            let tcp = TcpLink::open(address)?;
            bound.tcp = Some(tcp.address());
            self.attach(&mut links, 1, Box::new(tcp))?;
        }
        if let Some(port) = &self.serial {
            self.attach(&mut links, 2, Box::new(SerialLink::open(port)?))?;
        }
        Ok((links, bound))
    }

    /// Attaches a link, behind faults of its own if any are wanted.
    fn attach(&self, links: &mut Links, number: u64, link: Box<dyn Link>) -> Result<(), LinkError> {
        let Some(plan) = self.link_faults else { return links.attach(link) };
        let plan = FaultPlan { seed: plan.seed.wrapping_add(number), ..plan };
        links.attach(Box::new(FaultyLink::new(link, &plan)))
    }

    fn open_log(&self) -> Result<Option<FlightLog>, FlightLogError> {
        let start = self.log_start.map_or_else(flight_log::now, Duration::from_secs);
        self.log.as_deref().map(|path| FlightLog::create(path, start)).transpose()
    }
}

impl<'a> Session<Pilot<'a, StatePolicy<'a>>> {
    /// Tests the policy and opens the vehicle's links and log.
    ///
    /// # Errors
    /// If the policy is none, fails its self-test, sees no goal or needs sensors, or a link or the log cannot be had.
    pub fn open(
        bytes: &'a PolicyBytes,
        airframe: &Airframe,
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        let mut pilot = Pilot::with_runner(bytes.policy()?.on(airframe));
        let name = pilot.metadata().name;
        let identity = PolicyIdentity::of(name, bytes.bytes());
        pilot.self_test().map_err(|reason| SessionError::SelfTest { name: name.to_owned(), reason })?;
        Self::with(pilot, &identity, airframe, options)
    }
}

impl<P: PolicyBackend> Session<P> {
    /// As [`Session::open`], with a tested policy on any processor.
    ///
    /// # Errors
    /// If the policy sees no goal or needs sensors, or a link or the log cannot be had.
    pub fn with(
        backend: P,
        policy: &PolicyIdentity,
        airframe: &Airframe,
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        let name = policy.name.as_str();
        let layout = backend.observation();
        if !layout.shows_goal() {
            return Err(SessionError::GoalUnseen { name: name.to_owned(), observation: layout.name() });
        }
        if layout.measured_len() > 0 {
            return Err(SessionError::SensorsMissing { name: name.to_owned(), observation: layout.name() });
        }
        Self::unchecked(backend, policy, airframe, options)
    }

    /// As [`Self::with`], with a policy that flies nothing but the task of the plant: else the cascade flies.
    ///
    /// # Errors
    /// If a link or the log cannot be had.
    pub fn for_task(
        backend: P,
        policy: &PolicyIdentity,
        airframe: &Airframe,
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        let mut session = Self::unchecked(backend, policy, airframe, options)?;
        session.vehicle.offer_task(PolicyRole::TaskAlone);
        Ok(session)
    }

    /// Lets peers ask for the task of the plant.
    pub fn offer_task(&mut self) {
        self.vehicle.offer_task(PolicyRole::SetPointsToo);
    }

    fn unchecked(
        backend: P,
        policy: &PolicyIdentity,
        airframe: &Airframe,
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        let name = policy.name.as_str();
        let mut vehicle = Vehicle::new(backend, airframe, options.profile(policy.clone()));
        let store = PersistentStore::open(&mut vehicle, options.parameters.clone(), options.signing_key.clone())?;
        let (links, mut bound) = options.open_links()?;
        let crtp = options.crtp.map(CrtpLink::open).transpose()?;
        bound.crtp = crtp.as_ref().map(CrtpLink::address).transpose()?;
        Ok(Self {
            links,
            crtp,
            store,
            log: options.open_log()?,
            announcement: announcement(name, options, &[bound]),
            bound,
            timing: Timing::default(),
            vehicle,
            options: options.clone(),
        })
    }

    /// What flies, and how to connect to it.
    pub fn announcement(&self) -> &str {
        &self.announcement
    }

    /// Lets the vehicle be spoken to by one more link, of which `words` tell.
    ///
    /// # Errors
    /// [`LinkError::TooMany`].
    pub fn attach(&mut self, link: Box<dyn Link>, words: &str) -> Result<(), LinkError> {
        self.announcement = format!("{words}\n{}", self.announcement);
        self.links.attach(link)
    }

    /// Has a camera on board, of which peers are told.
    pub fn carry_camera(&mut self, profile: CameraProfile) {
        let words = format!("Its camera streams to {}: any player, QGroundControl by itself.", profile.url);
        self.announcement = format!("{words}\n{}", self.announcement);
        self.vehicle.carry_camera(profile);
    }

    /// Where the vehicle can be spoken to.
    pub fn bound(&self) -> Bound {
        self.bound
    }

    /// What became of the datagrams that reached the vehicle.
    pub fn counts(&self) -> Counts {
        self.vehicle.counts()
    }

    /// How the last flight kept its pace.
    pub fn timing(&self) -> Timing {
        self.timing
    }

    /// What did not reach it.
    pub fn link_counts(&self) -> LinkCounts {
        self.links.counts()
    }

    /// Flies in `plant` until the time is up or `watch`, which sees every control period before the plant moves, ends
    /// the flight.
    ///
    /// # Errors
    /// If a link fails or the log cannot be written.
    pub fn fly(
        &mut self,
        plant: &mut dyn Plant,
        watch: &mut dyn FnMut(&ControlPeriod) -> Next,
    ) -> Result<Counts, SessionError> {
        fly_together(slice::from_mut(self), &mut [plant], watch)?;
        Ok(self.counts())
    }
}

/// Flies every session in its plant until the first one's time is up or `watch` ends the flight.
fn fly_together<P: PolicyBackend>(
    sessions: &mut [Session<P>],
    plants: &mut [&mut dyn Plant],
    watch: &mut dyn FnMut(&ControlPeriod) -> Next,
) -> Result<(), SessionError> {
    let Some(first) = sessions.first() else { return Ok(()) };
    let (pace, limit_secs) = (first.options.speed, first.options.for_secs.unwrap_or(f64::INFINITY));
    // Half a period of grace: times are sums of rounded periods.
    let limit_secs = limit_secs - 0.5 * first.vehicle.control_period().as_secs_f64();
    let mut until = |period: &ControlPeriod| {
        let next = watch(period);
        if period.secs < limit_secs { next } else { Next::End }
    };
    let pairs = sessions.iter_mut().zip(plants);
    let mut vehicles: Vec<SimulatedVehicle<'_, P>> = pairs
        .map(|(session, plant)| {
            let Session { vehicle, links, crtp, log, store, .. } = session;
            SimulatedVehicle::new(vehicle, &mut **plant, links)
                .with_crtp(crtp.as_mut())
                .with_log(log.as_mut())
                .with_store(store)
        })
        .collect();
    let timing = lockstep::fly(&mut vehicles, pace, &mut until)?;
    drop(vehicles);
    for session in sessions {
        session.timing = timing;
    }
    Ok(())
}

fn tcp_address(text: &str) -> Result<SocketAddr, String> {
    let with_port = |_| text.parse::<IpAddr>().map(|address| SocketAddr::new(address, tcp::DEFAULT_PORT));
    text.parse().or_else(with_port).map_err(|_| "expected an IP address, with or without a port".to_owned())
}

pub(crate) fn positive_secs(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(secs) if secs > 0.0 && f64::is_finite(secs) => Ok(secs),
        Ok(_) | Err(_) => Err("expected a positive number of seconds".to_owned()),
    }
}

#[cfg(test)]
mod tests;
