use std::collections::BTreeMap;
use std::path::Path;

use byteorder::LittleEndian;
use kestrel_experiments::evaluation::Flyer;
use kestrel_experiments::experiment_config::{self, Experiment};
use kestrel_experiments::recording::Recording;
use kestrel_experiments::results::record_pilot;
use serde::Deserialize;

use super::mcap;

/// The beginning of messages that have a header.
#[derive(Deserialize)]
struct Stamped {
    sec: i32,
    nanosec: u32,
    frame_id: String,
}

fn flown(task: &str) -> (Recording, Experiment) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(task);
    let experiment = experiment_config::load(&path, &[]).unwrap();
    (record_pilot(&experiment, Flyer::Scripted), experiment)
}

fn written(recording: &Recording, experiment: &Experiment) -> Vec<u8> {
    mcap(recording, experiment, Path::new("flight.recording")).unwrap()
}

#[test]
fn every_moment_of_every_drone_has_its_messages() {
    let (recording, experiment) = flown("aviaries/multi-hover.yaml");
    let file = written(&recording, &experiment);
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut last = 0;
    for message in ::mcap::MessageStream::new(&file).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= 1_000_000_000 && message.data.starts_with(&[0, 1, 0, 0]));
        assert_eq!(message.channel.message_encoding, "cdr");
        let is_late = message.channel.topic.ends_with("outcome");
        assert!(is_late || message.log_time >= last, "{}", message.channel.topic);
        last = if is_late { last } else { message.log_time };
        *counts.entry(message.channel.topic.clone()).or_default() += 1;
    }
    assert!(recording.drones.len() > 1);
    for (index, track) in recording.drones.iter().enumerate() {
        for (topic, expected) in [
            ("odom", track.moments.len()),
            ("imu", track.moments.len()),
            ("range/down", track.moments.len()),
            ("action", track.steps.len()),
            ("outcome", 1),
        ] {
            assert_eq!(counts.get(&format!("/drone{index}/{topic}")), Some(&expected), "drone {index}: {topic}");
        }
        let rewards = counts.iter().filter(|(topic, _)| topic.starts_with(&format!("/drone{index}/reward/")));
        let rewards: Vec<usize> = rewards.map(|(_, count)| *count).collect();
        // Two terms of one kind have topics of their own.
        assert_eq!(rewards, vec![track.steps.len(); recording.components.len()]);
    }
}

#[test]
fn headers_say_when_and_in_which_frame() {
    let (recording, experiment) = flown("hover.yaml");
    let file = written(&recording, &experiment);
    let messages = ::mcap::MessageStream::new(&file).unwrap().map(Result::unwrap);
    let odometry: Vec<_> = messages.filter(|message| message.channel.topic == "/drone0/odom").collect();
    let header = |index: usize| {
        let data = &odometry[index].data[4..];
        cdr_encoding::from_bytes::<Stamped, LittleEndian>(data).unwrap().0
    };
    let second = header(1);
    assert_eq!((second.sec, second.nanosec, second.frame_id.as_str()), (1, 20_000_000, "world"));
    assert_eq!(odometry[1].log_time, 1_020_000_000);
    let schema = odometry[0].channel.schema.as_ref().unwrap();
    assert_eq!((schema.name.as_str(), schema.encoding.as_str()), ("nav_msgs/msg/Odometry", "ros2msg"));
}

#[test]
fn the_same_flight_gives_the_same_bytes() {
    let (recording, experiment) = flown("hover.yaml");
    assert_eq!(written(&recording, &experiment), written(&recording, &experiment));
}
