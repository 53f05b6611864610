//! The film of a flight.

use kestrel_draw::recorded_flight::{DroneFlight, FlightRecording, Placement};
use kestrel_draw::video::{VideoError, VideoFormat, flight_video};

use super::case::Case;
use super::expectation::Failure;
use super::flight::{FlownCase, Moment};

/// The flight of a case as GIF, which ends with what failed.
///
/// # Errors
/// When the drone went where no camera can follow, or the encoder fails.
pub(crate) fn film(case: &Case, flown: &FlownCase, failures: &[Failure]) -> Result<Vec<u8>, VideoError> {
    let drone = DroneFlight {
        goal: Some(case.goal),
        frames: flown.moments.iter().map(placement).collect(),
        rewards: Vec::new(),
        ending: failures.first().map_or_else(String::new, |failure| format!("failed: {}", failure.name)),
        success: failures.is_empty(),
    };
    let recording = FlightRecording {
        title: case.full_name(),
        control_secs: flown.control_secs as f32,
        drones: vec![drone],
        movables: flown.movables.iter().map(|poses| poses.iter().map(Placement::of).collect()).collect(),
    };
    flight_video(recording, &case.scenario.in_room(0), &case.full_name(), VideoFormat::Gif)
}

/// A name of a file for a flight: letters, digits, and dashes for everything else.
pub(crate) fn file_name(case: &Case) -> String {
    let name = case.full_name();
    let kept = |letter: char| if letter.is_ascii_alphanumeric() || "._".contains(letter) { letter } else { '-' };
    let name: String = name.chars().map(kept).collect();
    format!("{}.gif", name.trim_end_matches('-'))
}

fn placement(moment: &Moment) -> Placement {
    Placement { position: moment.state.position, attitude: moment.state.world_from_body }
}
