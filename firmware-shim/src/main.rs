//! `kestrel-shim`: a policy file as a MAVLink vehicle above an endless floor, or that floor under another autopilot.

use std::env;
use std::io::{self, Write};
use std::net::SocketAddr;
#[cfg(unix)]
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{self, ExitCode};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, bail};
use clap::{Parser, Subcommand, ValueEnum};
use kestrel_core::action::ActionSpace;
use kestrel_core::airframe::{Airframe, CF2P, CF2X};
use kestrel_shim::bridge::BridgeOptions;
use kestrel_shim::bridge::motors::{MotorOrder, Motors, ThrustCurve};
use kestrel_shim::bridge::px4::client::ExternalSimulator;
use kestrel_shim::bridge::session::{self, Callbacks};
use kestrel_shim::lockstep::{ControlPeriod, Next};
use kestrel_shim::plant::FlatFloor;
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_shim::session::{Fleet, SessionOptions};
use kestrel_shim::true_state::TrueStateLog;

/// Exit status of everything the user can mend, as of clap's own errors.
const USER_ERROR: u8 = 2;

/// Exit status of a program that a second interrupt ended: 128 + SIGINT, as shells report it.
const INTERRUPTED: i32 = 130;

/// Fly an exported policy as a MAVLink vehicle
///
/// The drone starts at rest on an endless flat floor, in still air, with the nominal dynamics of its airframe; no
/// simulator is linked in. With --aviary the program `kestrel` beside this one flies the same vehicle among walls.
///
/// Example: kestrel-shim runs/hover-seed0-1/policy.kestrel --speed 5
///
/// Then connect QGroundControl or pymavlink (the addresses are printed), arm, take off, send set-points,
/// land. Exit status: 0 after a flight, 2 if it cannot begin or is cut short.
#[derive(Debug, Parser)]
#[command(
    name = "kestrel-shim",
    version,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    disable_help_subcommand = true
)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,

    /// Policy file, as `kestrel export` writes it
    #[arg(required = true)]
    policy: Option<PathBuf>,

    /// Airframe that flies
    #[arg(long, value_enum, default_value_t = AirframeName::Cf2x)]
    airframe: AirframeName,

    /// Fly so many vehicles, one metre apart: each listens one port and has one system number above the one before it,
    /// and all speak to the same ground station
    #[arg(long, value_name = "NUMBER", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=250))]
    vehicles: u8,

    /// Fly in the aviary of this task, by name or file: the vehicles can collide there, and with what stands in it
    #[arg(long, value_name = "TASK", conflicts_with_all = ["simulator", "airframe"])]
    aviary: Option<PathBuf>,

    /// Write the true state in every control period to this file, one JSON object per line
    #[arg(long, value_name = "FILE")]
    true_state_log: Option<PathBuf>,

    /// Fly in the PX4-compatible simulator that listens at this TCP address (port 4560 by custom), not above the floor;
    /// further vehicles fly at the ports above it
    #[arg(long, value_name = "ADDRESS", conflicts_with = "true_state_log")]
    simulator: Option<SocketAddr>,

    /// How that simulator numbers the motors
    #[arg(long, value_enum, value_name = "ORDER", requires = "simulator", default_value_t = MotorOrder::QuadX)]
    motors: MotorOrder,

    #[command(flatten)]
    session: SessionOptions,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Lend the floor and a Crazyflie with all instruments to another autopilot: PX4, ArduPilot or Betaflight
    ///
    /// Example: kestrel-shim bridge --peer px4
    ///
    /// Then start the autopilot (how is printed). Exit status: 0 when the time is up, 2 if it cannot begin or is cut
    /// short.
    Bridge(BridgeArguments),
}

#[derive(Debug, clap::Args)]
struct BridgeArguments {
    #[command(flatten)]
    bridge: BridgeOptions,

    /// File for the true state of every step, one JSON object per line
    #[arg(long, value_name = "FILE")]
    true_state_log: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum AirframeName {
    /// Crazyflie 2.x, X layout
    Cf2x,
    /// Crazyflie 2.x, plus layout
    Cf2p,
}

impl AirframeName {
    const fn airframe(self) -> &'static Airframe {
        match self {
            Self::Cf2x => &CF2X,
            Self::Cf2p => &CF2P,
        }
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let result = match &arguments.command {
        Some(Command::Bridge(bridge)) => self::bridge(bridge),
        None if arguments.aviary.is_some() => match fly_among_walls() {
            Ok(ended) => return ended,
            Err(error) => Err(error),
        },
        None => fly(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(USER_ERROR)
        }
    }
}

/// Has the program `kestrel`, in the folder of this one, fly with the same arguments; how it ended.
fn fly_among_walls() -> anyhow::Result<ExitCode> {
    let here = env::current_exe().context("cannot find this program")?;
    let kestrel = here.with_file_name(format!("kestrel{}", env::consts::EXE_SUFFIX));
    let mut flight = process::Command::new(&kestrel);
    flight.arg("fly").args(env::args_os().skip(1));
    ended(flight).with_context(|| {
        format!("found no program {}, expected it for --aviary: build the whole workspace", kestrel.display())
    })
}

/// Becomes another program, which is signalled and ends as this one.
#[cfg(unix)]
fn ended(mut program: process::Command) -> io::Result<ExitCode> {
    Err(program.exec())
}

/// Runs another program to its end.
#[cfg(not(unix))]
fn ended(mut program: process::Command) -> io::Result<ExitCode> {
    let code = program.status()?.code();
    Ok(ExitCode::from(code.and_then(|code| u8::try_from(code).ok()).unwrap_or(USER_ERROR)))
}

fn fly(arguments: &Arguments) -> anyhow::Result<()> {
    let path = arguments.policy.as_ref().context("expected a policy file, found none")?;
    let bytes = PolicyBytes::read(path)?;
    let policy = bytes.policy().with_context(|| format!("policy {}", path.display()))?;
    let control_secs = policy.metadata().control_period_secs;
    let airframe = arguments.airframe.airframe();
    let mut fleet = Fleet::open(&bytes, airframe, arguments.vehicles, &arguments.session)?;
    let mut log = TrueStateLog::create(arguments.true_state_log.as_deref())?;
    let interrupted = watch_for_interrupts()?;
    report(fleet.announcement())?;
    let mut failure = None;
    let mut watch = |period: &ControlPeriod| {
        failure = log.write(period).err();
        if failure.is_some() || interrupted.load(Ordering::Relaxed) { Next::End } else { Next::Fly }
    };
    if let Some(first) = arguments.simulator {
        if let ActionSpace::RateLoop(_) = policy.metadata().action {
            bail!(
                "policy {}: found a rate loop, expected none: between two control periods nobody reads the gyroscope of an \
                 external simulator",
                path.display()
            );
        }
        let motors = Motors::new(airframe, arguments.motors, ThrustCurve::PX4)?;
        let addresses = (0..arguments.vehicles).map(|number| nth_address(first, number));
        let mut plants = Vec::new();
        for address in addresses.collect::<anyhow::Result<Vec<_>>>()? {
            report(&format!("It flies in the simulator at TCP {address}, as soon and as long as that is there."))?;
            plants.push(ExternalSimulator::new(address, motors, control_secs));
        }
        fleet.fly(&mut plants, &mut watch)?;
    } else {
        let floor = FlatFloor::new(airframe, control_secs).with_rate_loop(&policy.metadata().action);
        let places = (0..arguments.vehicles).map(|number| grid(number, arguments.vehicles));
        let mut plants: Vec<FlatFloor> = places.map(|place| floor.clone().at(place)).collect();
        fleet.fly(&mut plants, &mut watch)?;
    }
    let (flooding, commands) = fleet.sessions().iter().fold((0, 0), |(flooding, commands), session| {
        let counts = session.link_counts();
        (flooding + counts.flooding, commands + counts.commands)
    });
    if flooding + commands > 0 {
        eprintln!("Not heard: {flooding} datagrams of floods, {commands} with too many commands.");
    }
    failure.map_or(Ok(()), |failure| Err(failure.into()))
}

/// Becomes true with the first Ctrl-C, SIGTERM or SIGHUP, which ends the flight, its logs and what is kept of it; the second
/// ends the program.
fn watch_for_interrupts() -> anyhow::Result<Arc<AtomicBool>> {
    let interrupted = Arc::new(AtomicBool::new(false));
    let handler = Arc::clone(&interrupted);
    let react = move || {
        if handler.swap(true, Ordering::Relaxed) {
            process::exit(INTERRUPTED);
        }
    };
    ctrlc::set_handler(react).context("cannot watch for Ctrl-C")?;
    Ok(interrupted)
}

fn nth_address(first: SocketAddr, number: u8) -> anyhow::Result<SocketAddr> {
    let port = first.port().checked_add(u16::from(number));
    let port = port
        .with_context(|| format!("expected ports of simulators up to 65535, found {first} and {number} more"))?;
    Ok(SocketAddr::new(first.ip(), port))
}

fn bridge(arguments: &BridgeArguments) -> anyhow::Result<()> {
    let interrupted = watch_for_interrupts()?;
    let mut plant = FlatFloor::new(&CF2X, arguments.bridge.control_secs());
    let mut callbacks = Callbacks { print: &mut print, interrupted: &|| interrupted.load(Ordering::Relaxed) };
    let log = arguments.true_state_log.as_deref();
    let counts = session::run(&arguments.bridge, &CF2X, &mut plant, log, &mut callbacks)?;
    report(&counts.to_string())
}

fn report(text: &str) -> anyhow::Result<()> {
    print(text).context("cannot write to the standard output")
}

fn print(text: &str) -> io::Result<()> {
    let mut output = io::stdout();
    writeln!(output, "{text}").and_then(|()| output.flush())
}

/// Place of a vehicle in a square of rows, one metre apart \[m, world x and y\].
fn grid(number: u8, count: u8) -> [f32; 2] {
    let side = f32::from(count).sqrt().ceil() as u8;
    [f32::from(number % side), f32::from(number / side)]
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn parsed(line: &str) -> Result<Arguments, String> {
        let words = ["kestrel-shim"].into_iter().chain(line.split_whitespace());
        Arguments::try_parse_from(words).map_err(|error| error.to_string())
    }

    #[test]
    fn the_command_line_contradicts_itself_nowhere() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn a_policy_alone_is_flown_as_ever() {
        let arguments = parsed("a.kestrel --speed 5 --airframe cf2p").unwrap();
        assert!(arguments.command.is_none() && arguments.simulator.is_none());
        assert_eq!(arguments.policy, Some("a.kestrel".into()));
        assert!(parsed("").unwrap_err().contains("<POLICY>"));
    }

    #[test]
    fn a_policy_flies_in_another_simulator() {
        let arguments = parsed("a.kestrel --simulator 127.0.0.1:4560 --motors crazyflie").unwrap();
        assert_eq!(arguments.simulator, Some("127.0.0.1:4560".parse().unwrap()));
        assert!(parsed("a.kestrel --motors crazyflie").unwrap_err().contains("--simulator"));
    }

    #[test]
    fn simulators_of_several_vehicles_have_ports_in_a_row() {
        let first = "127.0.0.1:65534".parse().unwrap();
        assert_eq!(nth_address(first, 1).unwrap().port(), 65535);
        assert!(nth_address(first, 2).unwrap_err().to_string().contains("found 127.0.0.1:65534 and 2 more"));
    }

    #[test]
    fn an_aviary_has_drones_and_physics_of_its_own() {
        assert_eq!(parsed("a.kestrel --aviary room-1 --vehicles 3").unwrap().aviary, Some("room-1".into()));
        for other in ["--airframe cf2p", "--simulator 127.0.0.1:4560"] {
            assert!(
                parsed(&format!("a.kestrel --aviary room-1 {other}")).unwrap_err().contains("cannot be used with")
            );
        }
    }

    #[test]
    fn a_bridge_needs_a_peer_and_no_policy() {
        let arguments = parsed("bridge --peer px4 --true-state-log a.jsonl").unwrap();
        assert!(matches!(arguments.command, Some(Command::Bridge(_))));
        assert!(parsed("bridge").unwrap_err().contains("--peer"));
        assert!(parsed("a.kestrel bridge --peer px4").is_err());
    }
}
