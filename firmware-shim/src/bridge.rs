//! Simulator bridges (SITL, HIL): our simulator behind another autopilot, and our autopilot behind another simulator.
//!
//! A [`Plant`] with [`motors`] and [`sensors`] is a [`drone`]; PX4 ([`px4`]), ArduPilot ([`ardupilot`]), Betaflight
//! ([`betaflight`]) or Bitcraze's firmware ([`crazyflie`]) flies it. What they say and are told is pure logic, as everywhere in
//! this crate: bytes in, bytes out, simulated time; only the modules called `server` and `client`, and [`datagram`], know
//! sockets and clocks. The other direction is a plant of its own: [`px4::client::ExternalSimulator`].
//!
//! Not there: batteries (none of these interfaces carries one), airspeed, magnetic disturbances, more than four motors.

pub mod ardupilot;
pub mod betaflight;
pub mod crazyflie;
pub mod datagram;
pub mod drone;
pub mod event;
mod frames;
pub mod magnetic_field;
pub mod motors;
pub mod noise;
pub mod px4;
pub mod radio;
pub mod sensors;
pub mod session;
#[cfg(test)]
mod testing;

use std::io::{self, ErrorKind};
use std::net::SocketAddr;
use std::time::Duration;

use kestrel_core::airframe::Airframe;

use crate::crtp::link::DEFAULT_PORT;
use crate::geodesy::Home;
use crate::lockstep::{Next, SimulationRate};
use crate::plant::Plant;
use crate::session::positive_secs;
use crate::true_state::TrueStateLogError;
use betaflight::BetaflightBuild;
use datagram::DatagramSocket;
use drone::Drone;
use event::{BridgeCounts, BridgeEvent};
use motors::{MotorError, MotorOrder, Motors, ThrustCurve};
use noise::Noise;
use px4::server::Listener;
use radio::Radio;
use sensors::Instruments;

/// The autopilots that can fly the simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ExternalAutopilot {
    /// PX4 in software in the loop, TCP 4560 and up
    Px4,
    /// ArduPilot Copter with `--model JSON`, UDP 9002 and up
    Ardupilot,
    /// Betaflight's SITL target, UDP 9001, 9003 and 9004
    Betaflight,
    /// The same, built with `ENABLE_GAZEBO_BRIDGE=0`
    BetaflightLegacy,
    /// Bitcraze's firmware, built for a host as CrazySim builds it, UDP 19950 and up; clients at UDP 19850 and up
    Crazyflie,
}

/// Options of every command that bridges its simulation to an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, clap::Args)]
pub struct BridgeOptions {
    /// Autopilot that flies
    #[arg(long, value_enum)]
    pub peer: ExternalAutopilot,

    /// Which of several autopilots on this machine, 0 to 99: chooses the port
    #[arg(long, value_name = "NUMBER", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=99))]
    pub instance: u16,

    /// Address to listen at instead of the peer's own
    #[arg(long, value_name = "ADDRESS")]
    pub listen: Option<SocketAddr>,

    /// Steps per simulated second, 50 to 2000 [default: 250 for PX4, 1200 for ArduPilot, 500 for Betaflight, 1000 for
    /// Crazyflie]
    #[arg(long, value_name = "HERTZ", value_parser = clap::value_parser!(u32).range(50..=2000))]
    pub rate_hz: Option<u32>,

    /// How the peer numbers its motors [default: quad-x, betaflight for Betaflight, crazyflie for Crazyflie]
    #[arg(long, value_enum, value_name = "ORDER")]
    pub motors: Option<MotorOrder>,

    /// Thrust that the peer takes for the greatest of a motor, in newtons [default: 0.12 for Crazyflie, `THRUST_MAX` of its
    /// firmware; else the airframe's]
    #[arg(long, value_name = "NEWTONS", value_parser = positive_newtons)]
    pub motor_thrust: Option<f64>,

    /// Share of the square in thrust over motor output, 0 to 1: PX4's `THR_MDL_FAC`, ArduPilot's `MOT_THST_EXPO` [default: 0 for
    /// PX4 and Crazyflie, 0.65 for ArduPilot, 1 for Betaflight]
    #[arg(long, value_name = "SHARE", value_parser = square_share)]
    pub thrust_curve: Option<f32>,

    /// Seed of the instruments' noise, or "off"
    #[arg(long, value_name = "SEED", default_value_t = Noise::Seeded(0))]
    pub noise: Noise,

    /// Place of the world's origin on Earth, in degrees and metres above sea level
    #[arg(long, value_name = "LATITUDE,LONGITUDE,ALTITUDE", allow_hyphen_values = true, default_value_t = Home::default())]
    pub home: Home,

    /// Pulses in microseconds of a remote control that nobody moves, for PX4 and Betaflight [default: no remote control]
    #[arg(long, value_name = "PULSES")]
    pub radio: Option<Radio>,

    /// Simulated seconds per second, 0.01 to 1000, or "max" for as fast as the autopilot answers
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, default_value = "1")]
    pub speed: SimulationRate,

    /// End after so many simulated seconds [default: until Ctrl-C]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = positive_secs)]
    pub for_secs: Option<f64>,
}

/// Why a bridge does not stand.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// Another program has the port.
    #[error(
        "{protocol} address {address} is in use by another program (another simulator?); expected a free port: choose another --instance, or end it"
    )]
    Busy {
        /// Of the socket.
        protocol: &'static str,
        /// Wanted address.
        address: SocketAddr,
    },
    /// The address cannot be bound.
    #[error("cannot open {protocol} address {address}: {reason}")]
    Open {
        /// Of the socket.
        protocol: &'static str,
        /// Wanted address.
        address: SocketAddr,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// A socket fails.
    #[error("the socket of the bridge fails: {0}")]
    Socket(io::Error),
    /// The autopilot cannot be told apart from another on this machine.
    #[error("Betaflight's ports are fixed: expected --instance 0, found {0}")]
    Instance(u16),
    /// The autopilot takes no remote control from its simulator.
    #[error("{peer} takes no remote control from its simulator: expected no --radio, found {radio}")]
    Radio {
        /// Who does not.
        peer: &'static str,
        /// What it would be.
        radio: Radio,
    },
    /// The autopilot has a clock of its own.
    #[error("Bitcraze's firmware has a clock of its own: expected --rate-hz 1000 and --speed 1, found {0}")]
    Clock(String),
    /// The airframe is none that autopilots fly.
    #[error(transparent)]
    Motors(#[from] MotorError),
    /// The true-state log cannot be written.
    #[error(transparent)]
    Log(#[from] TrueStateLogError),
    /// The standard output refuses.
    #[error("cannot write to the standard output: {0}")]
    Output(io::Error),
}

/// A simulation that waits for its autopilot.
#[derive(Debug)]
pub struct SimulatorBridge {
    options: BridgeOptions,
    motors: Motors,
    socket: Socket,
    announcement: String,
}

#[derive(Debug)]
enum Socket {
    Tcp(Listener),
    Udp(DatagramSocket),
    /// The autopilot's, and the one at which its clients look for it.
    UdpWithClients(DatagramSocket, DatagramSocket),
}

impl BridgeError {
    fn opening(protocol: &'static str, address: SocketAddr, reason: io::Error) -> Self {
        if reason.kind() == ErrorKind::AddrInUse {
            return Self::Busy { protocol, address };
        }
        Self::Open { protocol, address, reason }
    }
}

impl ExternalAutopilot {
    const fn name(self) -> &'static str {
        match self {
            Self::Px4 => "PX4",
            Self::Ardupilot => "ArduPilot",
            Self::Betaflight | Self::BetaflightLegacy => "Betaflight",
            Self::Crazyflie => "Bitcraze's firmware",
        }
    }

    const fn rate_hz(self) -> u32 {
        match self {
            Self::Px4 => 250,
            Self::Ardupilot => 1200,
            Self::Betaflight | Self::BetaflightLegacy => 500,
            Self::Crazyflie => crazyflie::RATE_HZ,
        }
    }

    const fn motors(self) -> (MotorOrder, ThrustCurve) {
        match self {
            Self::Px4 => (MotorOrder::QuadX, ThrustCurve::PX4),
            Self::Ardupilot => (MotorOrder::QuadX, ThrustCurve::ARDUPILOT),
            Self::Betaflight | Self::BetaflightLegacy => (MotorOrder::Betaflight, ThrustCurve::BETAFLIGHT),
            // Battery compensation makes thrust of the ratios.
            Self::Crazyflie => (MotorOrder::Crazyflie, ThrustCurve::PX4),
        }
    }

    /// Thrust that it takes for the greatest of a motor \[N\], if it has its own idea of it: `THRUST_MAX` of a Crazyflie 2.1.
    const fn motor_thrust(self) -> Option<f64> {
        match self {
            Self::Px4 | Self::Ardupilot | Self::Betaflight | Self::BetaflightLegacy => None,
            Self::Crazyflie => Some(0.12),
        }
    }

    /// Its simulator's address; PX4 counts ports by one, ArduPilot by ten.
    fn address(self, instance: u16) -> SocketAddr {
        let port = match self {
            Self::Px4 => 4560 + instance,
            Self::Ardupilot => 9002 + 10 * instance,
            Self::Betaflight | Self::BetaflightLegacy => {
                return betaflight::server::BetaflightAddresses::default().outputs;
            }
            Self::Crazyflie => 19950 + instance,
        };
        SocketAddr::from(([127, 0, 0, 1], port))
    }
}

impl BridgeOptions {
    /// Steps per simulated second.
    pub fn rate_hz(&self) -> u32 {
        self.rate_hz.unwrap_or(self.peer.rate_hz())
    }

    /// The control period that the plant must have \[s\].
    pub fn control_secs(&self) -> f32 {
        1.0 / self.rate_hz() as f32
    }

    fn check(&self) -> Result<(), BridgeError> {
        let peer = self.peer.name();
        match (self.peer, self.radio) {
            (ExternalAutopilot::Betaflight | ExternalAutopilot::BetaflightLegacy, _) if self.instance > 0 => {
                Err(BridgeError::Instance(self.instance))
            }
            (ExternalAutopilot::Ardupilot | ExternalAutopilot::Crazyflie, Some(radio)) => {
                Err(BridgeError::Radio { peer, radio })
            }
            (ExternalAutopilot::Crazyflie, None) if self.rate_hz() != crazyflie::RATE_HZ => {
                Err(BridgeError::Clock(format!("--rate-hz {}", self.rate_hz())))
            }
            (ExternalAutopilot::Crazyflie, None) if self.speed != SimulationRate::Speed(1.0) => {
                Err(BridgeError::Clock("another --speed".to_owned()))
            }
            (
                ExternalAutopilot::Px4
                | ExternalAutopilot::Ardupilot
                | ExternalAutopilot::Betaflight
                | ExternalAutopilot::BetaflightLegacy
                | ExternalAutopilot::Crazyflie,
                _,
            ) => Ok(()),
        }
    }

    fn motors(&self, airframe: &Airframe) -> Result<Motors, MotorError> {
        let (order, curve) = self.peer.motors();
        let curve = self.thrust_curve.map_or(curve, ThrustCurve::with_square_share);
        let motors = Motors::new(airframe, self.motors.unwrap_or(order), curve)?;
        Ok(match self.motor_thrust.or(self.peer.motor_thrust()) {
            Some(newtons) => motors.with_greatest_thrust(newtons, airframe),
            None => motors,
        })
    }

    /// Where clients of Bitcraze's firmware look for it.
    fn clients_address(&self) -> SocketAddr {
        let chosen = |address: SocketAddr| if address.port() == 0 { 0 } else { DEFAULT_PORT + self.instance };
        let port = self.listen.map_or(DEFAULT_PORT + self.instance, chosen);
        SocketAddr::from(([127, 0, 0, 1], port))
    }
}

/// A thrust curve on the command line.
fn square_share(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        Ok(_) | Err(_) => Err(format!("expected a share from 0 to 1, found \"{text}\"")),
    }
}

/// A thrust on the command line.
fn positive_newtons(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(newtons) if newtons > 0.0 && newtons <= 1000.0 => Ok(newtons),
        Ok(_) | Err(_) => Err(format!("expected a thrust above 0 and up to 1000 N, found \"{text}\"")),
    }
}

impl SimulatorBridge {
    /// Binds the address at which the peer looks for its simulator.
    ///
    /// # Errors
    /// If the options or the airframe do not fit the peer, or the address cannot be had.
    pub fn open(options: &BridgeOptions, airframe: &Airframe) -> Result<Self, BridgeError> {
        options.check()?;
        let motors = options.motors(airframe)?;
        let address = options.listen.unwrap_or_else(|| options.peer.address(options.instance));
        let socket = match options.peer {
            ExternalAutopilot::Px4 => Socket::Tcp(Listener::open(address)?),
            ExternalAutopilot::Ardupilot | ExternalAutopilot::Betaflight | ExternalAutopilot::BetaflightLegacy => {
                Socket::Udp(DatagramSocket::open(address)?)
            }
            ExternalAutopilot::Crazyflie => Socket::UdpWithClients(
                DatagramSocket::open(address)?,
                DatagramSocket::open(options.clients_address())?,
            ),
        };
        let announcement = announcement(options, socket.address()?);
        Ok(Self { options: *options, motors, socket, announcement })
    }

    /// What waits here, and how to start the autopilot.
    pub fn announcement(&self) -> &str {
        &self.announcement
    }

    /// Has the peer fly `plant`, whose control period is that of the options, until the time is up or `watch` ends it.
    ///
    /// # Errors
    /// If a socket fails.
    pub fn fly(
        &mut self,
        plant: &mut dyn Plant,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Result<BridgeCounts, BridgeError> {
        let options = &self.options;
        let (rate_hz, home) = (options.rate_hz(), options.home);
        let period = Duration::from_secs_f64(1.0 / f64::from(rate_hz));
        let mut drone = Drone::new(plant, self.motors, Instruments::new(home, options.noise, rate_hz));
        // Half a period of grace: times are sums of rounded periods.
        let limit_secs = options.for_secs.unwrap_or(f64::INFINITY) - 0.5 * period.as_secs_f64();
        let mut until = |event: &BridgeEvent<'_>| match (watch(event), event) {
            (Next::Fly, BridgeEvent::Stepped(step)) if step.secs >= limit_secs => Next::End,
            (next, _) => next,
        };
        match (&mut self.socket, options.peer) {
            (Socket::Tcp(listener), _) => {
                let simulator = px4::Px4Simulator::new(home, rate_hz, options.radio);
                px4::server::Px4Server::new(&mut drone, simulator, period, options.speed)
                    .serve(listener, &mut until)
            }
            (Socket::UdpWithClients(socket, clients), _) => {
                let simulator = crazyflie::CrazyflieSimulator::new(options.noise);
                crazyflie::server::CrazyflieServer::new(&mut drone, simulator, period, clients)
                    .serve(socket, &mut until)
            }
            (
                Socket::Udp(socket),
                ExternalAutopilot::Px4 | ExternalAutopilot::Ardupilot | ExternalAutopilot::Crazyflie,
            ) => ardupilot::server::serve(&mut drone, socket, period, options.speed, &mut until),
            (Socket::Udp(socket), ExternalAutopilot::Betaflight | ExternalAutopilot::BetaflightLegacy) => {
                let build = if options.peer == ExternalAutopilot::Betaflight {
                    BetaflightBuild::Gazebo
                } else {
                    BetaflightBuild::Legacy
                };
                let simulator = betaflight::BetaflightSimulator::new(home, build, options.radio);
                let addresses = betaflight::server::BetaflightAddresses::default();
                betaflight::server::BetaflightServer::new(&mut drone, simulator, addresses, period, options.speed)
                    .serve(socket, &mut until)
            }
        }
    }
}

impl Socket {
    fn address(&self) -> Result<SocketAddr, BridgeError> {
        match self {
            Self::Tcp(listener) => listener.address(),
            Self::Udp(socket) | Self::UdpWithClients(socket, _) => socket.address(),
        }
    }
}

fn announcement(options: &BridgeOptions, address: SocketAddr) -> String {
    let BridgeOptions { peer, instance, speed, home, noise, .. } = options;
    let pace = match speed {
        SimulationRate::Speed(1.0) => "in real time".to_owned(),
        SimulationRate::Speed(factor) => format!("at {factor} times real time"),
        SimulationRate::Unthrottled => "as fast as the autopilot answers".to_owned(),
    };
    let errors = match noise {
        Noise::Off => "without noise".to_owned(),
        Noise::Seeded(seed) => format!("with noise of seed {seed}"),
    };
    let (rate_hz, name) = (options.rate_hz(), peer.name());
    let protocol = match peer {
        ExternalAutopilot::Px4 => "TCP",
        ExternalAutopilot::Ardupilot
        | ExternalAutopilot::Betaflight
        | ExternalAutopilot::BetaflightLegacy
        | ExternalAutopilot::Crazyflie => "UDP",
    };
    let how = match peer {
        ExternalAutopilot::Px4 => format!(
            "PX4_SYS_AUTOSTART=10016 bin/px4 -i {instance}   (or, the first one: make px4_sitl none_iris)\n  \
             parameters for a Crazyflie: assets/autopilots/px4.params\n  \
             parameter IMU_INTEG_RATE: {rate_hz}"
        ),
        ExternalAutopilot::Ardupilot => format!(
            "arducopter --model JSON:127.0.0.1 -I {instance} --defaults assets/autopilots/ardupilot.parm\n  \
             GPS needs about 40 s before it flies"
        ),
        ExternalAutopilot::Betaflight => {
            "obj/betaflight_SITL.elf, once with --config assets/autopilots/betaflight.cli, then without\n  \
             sticks: --radio, or any program that sends to UDP 9004"
                .to_owned()
        }
        ExternalAutopilot::BetaflightLegacy => {
            "obj/betaflight_SITL.elf, built with ENABLE_GAZEBO_BRIDGE=0\n  sticks: --radio, or any program that sends to UDP 9004"
                .to_owned()
        }
        ExternalAutopilot::Crazyflie => format!(
            "cf2 {} 127.0.0.1, built as CrazySim builds crazyflie-firmware for a host\n  \
             clients, such as cflib: udp://127.0.0.1:{}",
            address.port(),
            DEFAULT_PORT + instance
        ),
    };
    format!(
        "A drone waits for {name} at {protocol} {address}: {rate_hz} steps per second, {pace}, {errors}, home {home}.\n\
         Start the autopilot, and connect a ground station to it:\n  {how}\n\
         Ctrl-C ends the simulation."
    )
}

#[cfg(test)]
mod tests;
