//! A plant lent to an autopilot from the command line: the bridge, its log, and words for what happens.

use std::io;
use std::path::Path;

use kestrel_core::airframe::Airframe;

use super::event::{Counts, Event};
use super::{Bridge, BridgeError, BridgeOptions};
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
    let mut log = TrueStateLog::create(log)?;
    let mut bridge = Bridge::open(options, airframe)?;
    (audience.say)(bridge.announcement()).map_err(BridgeError::Output)?;
    let mut failure = None;
    let counts = bridge.fly(plant, &mut |event| {
        failure = note(event, &mut log, audience).err();
        if failure.is_some() || (audience.interrupted)() { Next::End } else { Next::Fly }
    })?;
    failure.map_or(Ok(counts), Err)
}

fn note(event: &Event<'_>, log: &mut TrueStateLog, audience: &mut Audience<'_>) -> Result<(), BridgeError> {
    let words = match event {
        Event::Stepped(step) => return Ok(log.write_step(step)?),
        Event::Connected(address) => format!("An autopilot has connected from {address}."),
        Event::Engaged => "It commands the motors: from now on both go in step.".to_owned(),
        Event::Gone => "The autopilot has gone; the drone waits for it to come back.".to_owned(),
        Event::Waiting | Event::Unanswered => return Ok(()),
    };
    (audience.say)(&words).map_err(BridgeError::Output)
}
