//! A simulator bridge from the command line: the bridge, its log, and lines for what happens.

use std::io;
use std::path::Path;

use kestrel_core::airframe::Airframe;

use super::event::{BridgeCounts, BridgeEvent};
use super::{BridgeError, BridgeOptions, ExternalAutopilot, SimulatorBridge};
use crate::lockstep::Next;
use crate::plant::Plant;
use crate::true_state::TrueStateLog;

/// What is called when something happens, and whether to end.
pub struct Callbacks<'a> {
    /// Prints a line, or several.
    pub print: &'a mut dyn FnMut(&str) -> io::Result<()>,
    /// Whether to end.
    pub interrupted: &'a dyn Fn() -> bool,
}

/// Has an autopilot fly `plant`, whose control period is that of the options, until the time is up or a callback ends it;
/// every step goes to a log, if one is wanted.
///
/// # Errors
/// If the bridge does not stand or fails, or the log or a line cannot be written.
pub fn run(
    options: &BridgeOptions,
    airframe: &Airframe,
    plant: &mut dyn Plant,
    log: Option<&Path>,
    callbacks: &mut Callbacks<'_>,
) -> Result<BridgeCounts, BridgeError> {
    let mut reporter = Reporter { log: TrueStateLog::create(log)?, options, silence_reported: false };
    let mut bridge = SimulatorBridge::open(options, airframe)?;
    (callbacks.print)(bridge.announcement()).map_err(BridgeError::Output)?;
    let mut failure = None;
    let counts = bridge.fly(plant, &mut |event| {
        failure = reporter.note(event, callbacks).err();
        if failure.is_some() || (callbacks.interrupted)() { Next::End } else { Next::Fly }
    })?;
    failure.map_or(Ok(counts), Err)
}

/// Keeps what happens in the log, and prints what is new.
struct Reporter<'a> {
    log: TrueStateLog,
    options: &'a BridgeOptions,
    /// Whether it was told that this autopilot leaves steps unanswered: it may leave every second one.
    silence_reported: bool,
}

impl Reporter<'_> {
    fn note(&mut self, event: &BridgeEvent<'_>, callbacks: &mut Callbacks<'_>) -> Result<(), BridgeError> {
        let words = match event {
            BridgeEvent::Stepped(step) => return Ok(self.log.write_step(step)?),
            BridgeEvent::Connected(address) => {
                self.silence_reported = false;
                format!("An autopilot has connected from {address}.")
            }
            BridgeEvent::Engaged => "It commands the motors: from now on both go in step.".to_owned(),
            BridgeEvent::Gone => "The autopilot has gone; the drone waits for it to come back.".to_owned(),
            BridgeEvent::Unanswered if self.options.peer == ExternalAutopilot::Px4 && !self.silence_reported => {
                self.silence_reported = true;
                let rate_hz = self.options.rate_hz();
                format!(
                    "It left a step unanswered for a second. If that goes on: does its parameter IMU_INTEG_RATE say {rate_hz}?"
                )
            }
            BridgeEvent::Waiting | BridgeEvent::Unanswered => return Ok(()),
        };
        (callbacks.print)(&words).map_err(BridgeError::Output)
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        options: BridgeOptions,
    }

    /// What is said of these events.
    fn reported(arguments: &str, events: &[BridgeEvent<'_>]) -> Vec<String> {
        let options = Line::parse_from(["bridge"].into_iter().chain(arguments.split_whitespace())).options;
        let mut reporter =
            Reporter { log: TrueStateLog::create(None).unwrap(), options: &options, silence_reported: false };
        let mut words = Vec::new();
        let mut print = |line: &str| {
            words.push(line.to_owned());
            Ok(())
        };
        let mut callbacks = Callbacks { print: &mut print, interrupted: &|| false };
        for event in events {
            reporter.note(event, &mut callbacks).unwrap();
        }
        words
    }

    #[test]
    fn a_px4_that_leaves_steps_unanswered_is_asked_once_for_its_rate() {
        let connected = BridgeEvent::Connected("127.0.0.1:1".parse().unwrap());
        let events = [BridgeEvent::Unanswered, BridgeEvent::Unanswered, connected, BridgeEvent::Unanswered];
        let words = reported("--peer px4 --rate-hz 500", &events);
        assert_eq!(words.len(), 3, "{words:?}");
        assert!(words[0].contains("IMU_INTEG_RATE say 500?") && words[2] == words[0], "{words:?}");
        assert!(reported("--peer betaflight", &[BridgeEvent::Unanswered]).is_empty(), "it does not go in step");
    }
}
