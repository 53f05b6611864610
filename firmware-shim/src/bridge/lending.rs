//! A plant lent to an autopilot from the command line: the bridge, its log, and words for what happens.

use std::io;
use std::path::Path;

use kestrel_core::airframe::Airframe;

use super::event::{Counts, Event};
use super::{Bridge, BridgeError, BridgeOptions, Peer};
use crate::lockstep::Next;
use crate::plant::Plant;
use crate::true_state::TrueStateLog;

/// Who is told what happens, and may end it.
pub struct Audience<'a> {
    /// Prints a line, or several.
    pub say: &'a mut dyn FnMut(&str) -> io::Result<()>,
    /// Whether to end.
    pub interrupted: &'a dyn Fn() -> bool,
}

/// Lends `plant`, whose control period is that of the options, until the time is up or the audience ends it; every step goes to
/// a log, if one is wanted.
///
/// # Errors
/// If the bridge does not stand or fails, or the log or the words cannot be written.
pub fn lend(
    options: &BridgeOptions,
    airframe: &Airframe,
    plant: &mut dyn Plant,
    log: Option<&Path>,
    audience: &mut Audience<'_>,
) -> Result<Counts, BridgeError> {
    let mut chronicle = Chronicle { log: TrueStateLog::create(log)?, options, silence_told: false };
    let mut bridge = Bridge::open(options, airframe)?;
    (audience.say)(bridge.announcement()).map_err(BridgeError::Output)?;
    let mut failure = None;
    let counts = bridge.fly(plant, &mut |event| {
        failure = chronicle.note(event, audience).err();
        if failure.is_some() || (audience.interrupted)() { Next::End } else { Next::Fly }
    })?;
    failure.map_or(Ok(counts), Err)
}

/// Keeps what happens in the log, and tells what is news.
struct Chronicle<'a> {
    log: TrueStateLog,
    options: &'a BridgeOptions,
    /// Whether it was told that this autopilot leaves steps unanswered: it may leave every second one.
    silence_told: bool,
}

impl Chronicle<'_> {
    fn note(&mut self, event: &Event<'_>, audience: &mut Audience<'_>) -> Result<(), BridgeError> {
        let words = match event {
            Event::Stepped(step) => return Ok(self.log.write_step(step)?),
            Event::Connected(address) => {
                self.silence_told = false;
                format!("An autopilot has connected from {address}.")
            }
            Event::Engaged => "It commands the motors: from now on both go in step.".to_owned(),
            Event::Gone => "The autopilot has gone; the drone waits for it to come back.".to_owned(),
            Event::Unanswered if self.options.peer == Peer::Px4 && !self.silence_told => {
                self.silence_told = true;
                let rate_hz = self.options.rate_hz();
                format!(
                    "It left a step unanswered for a second. If that goes on: does its parameter IMU_INTEG_RATE say {rate_hz}?"
                )
            }
            Event::Waiting | Event::Unanswered => return Ok(()),
        };
        (audience.say)(&words).map_err(BridgeError::Output)
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
    fn told(arguments: &str, events: &[Event<'_>]) -> Vec<String> {
        let options = Line::parse_from(["bridge"].into_iter().chain(arguments.split_whitespace())).options;
        let mut chronicle =
            Chronicle { log: TrueStateLog::create(None).unwrap(), options: &options, silence_told: false };
        let mut words = Vec::new();
        let mut say = |line: &str| {
            words.push(line.to_owned());
            Ok(())
        };
        let mut audience = Audience { say: &mut say, interrupted: &|| false };
        for event in events {
            chronicle.note(event, &mut audience).unwrap();
        }
        words
    }

    #[test]
    fn a_px4_that_leaves_steps_unanswered_is_asked_once_for_its_rate() {
        let connected = Event::Connected("127.0.0.1:1".parse().unwrap());
        let events = [Event::Unanswered, Event::Unanswered, connected, Event::Unanswered];
        let words = told("--peer px4 --rate-hz 500", &events);
        assert_eq!(words.len(), 3, "{words:?}");
        assert!(words[0].contains("IMU_INTEG_RATE say 500?") && words[2] == words[0], "{words:?}");
        assert!(told("--peer betaflight", &[Event::Unanswered]).is_empty(), "it does not go in step");
    }
}
