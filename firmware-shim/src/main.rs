//! `kestrel-shim`: a policy file as a MAVLink vehicle above an endless floor.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::{Parser, ValueEnum};
use kestrel_core::airframe::{Airframe, CF2P, CF2X};
use kestrel_shim::lockstep::Next;
use kestrel_shim::plant::FlatFloor;
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_shim::session::{SessionOptions, Squadron};
use kestrel_shim::true_state::TrueStateLog;

/// Exit status of everything the user can mend, as of clap's own errors.
const USER_ERROR: u8 = 2;

/// Fly an exported policy as a MAVLink vehicle
///
/// The drone starts at rest on an endless flat floor, in still air, with the nominal dynamics of its airframe; no
/// simulator is linked in. `kestrel fly` flies the same vehicle in the aviary that its policy was trained in.
///
/// Example: kestrel-shim runs/hover-seed0-1/policy.kestrel --speed 5
///
/// Then connect QGroundControl or pymavlink (the addresses are printed), arm, take off, send set-points,
/// land. Exit status: 0 after a flight, 2 if it cannot begin or is cut short.
#[derive(Parser)]
#[command(name = "kestrel-shim", version)]
struct Arguments {
    /// Policy file, as `kestrel export` writes it
    policy: PathBuf,

    /// Airframe that flies
    #[arg(long, value_enum, default_value_t = AirframeName::Cf2x)]
    airframe: AirframeName,

    /// Fly so many vehicles, one metre apart: each listens one port and has one system number above the one before it,
    /// and all speak to the same ground station
    #[arg(long, value_name = "NUMBER", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=250))]
    vehicles: u8,

    /// Write the true state in every control period to this file, one JSON object per line
    #[arg(long, value_name = "FILE")]
    true_state_log: Option<PathBuf>,

    #[command(flatten)]
    session: SessionOptions,
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
    match fly(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(USER_ERROR)
        }
    }
}

fn fly(arguments: &Arguments) -> anyhow::Result<()> {
    let bytes = PolicyBytes::read(&arguments.policy)?;
    let policy = bytes.policy().with_context(|| format!("policy {}", arguments.policy.display()))?;
    let control_secs = policy.metadata().control_period_secs;
    let airframe = arguments.airframe.airframe();
    let mut squadron = Squadron::open(&bytes, airframe, arguments.vehicles, &arguments.session)?;
    let mut log = TrueStateLog::create(arguments.true_state_log.as_deref())?;
    let mut output = io::stdout();
    writeln!(output, "{}", squadron.announcement()).and_then(|()| output.flush())?;
    let floor = FlatFloor::new(airframe, control_secs);
    let places = (0..arguments.vehicles).map(|number| grid(number, arguments.vehicles));
    let mut plants: Vec<FlatFloor> = places.map(|place| floor.clone().at(place)).collect();
    let mut failure = None;
    squadron.fly(&mut plants, &mut |moment| {
        failure = log.write(moment).err();
        if failure.is_some() { Next::End } else { Next::Fly }
    })?;
    let (flooding, commands) = squadron.sessions().iter().fold((0, 0), |(flooding, commands), session| {
        let counts = session.link_counts();
        (flooding + counts.flooding, commands + counts.commands)
    });
    if flooding + commands > 0 {
        eprintln!("Not heard: {flooding} datagrams of floods, {commands} with too many commands.");
    }
    failure.map_or(Ok(()), |failure| Err(failure.into()))
}

/// Place of a vehicle in a square of rows, one metre apart \[m, world x and y\].
fn grid(number: u8, count: u8) -> [f32; 2] {
    let side = f32::from(count).sqrt().ceil() as u8;
    [f32::from(number % side), f32::from(number / side)]
}
